#include "scenes/trackers/hand_recording.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "scenes/trackers/leap_csv.h"
#include "scenes/trackers/trajectory.h"
#include "scenes/web/bounded_json.h"

namespace palpate {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

}  // namespace

Matrix3d to_z_up(bool y_up) {
    Matrix3d R = Matrix3d::Identity();
    if (y_up) R << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    return R;
}

void set_finger(HandFrame& frame, int finger, const Vector3d& tracked_joint, const Vector3d& tracked_tip,
                const Matrix3d& tracked_bone, const HandFrameUnits& units) {
    const Matrix3d up = to_z_up(units.y_up), bone = up * tracked_bone;
    const Vector3d joint = units.scale * (up * tracked_joint), tip = units.scale * (up * tracked_tip);
    const Vector3d distal = -bone.col(2).normalized();
    const Vector3d dorsal = (bone.col(1) - bone.col(1).dot(distal) * distal).normalized();
    Matrix3d R;
    R << distal, dorsal.cross(distal), dorsal;
    const Eigen::Quaterniond q(R);
    const Vector3d p = 0.5 * (joint + tip);
    frame.finger[std::size_t(finger)] = {{p.x(), p.y(), p.z()}, {q.w(), q.x(), q.y(), q.z()}};
    frame.length[std::size_t(finger)] = (tip - joint).norm();
    const Vector3d to_tip = (tip - joint).normalized();
    frame.to_tip[std::size_t(finger)] = {to_tip.x(), to_tip.y(), to_tip.z()};
    frame.bones[std::size_t(finger)] = bone_angles(tracked_joint, tracked_tip, tracked_bone);
}

BoneTally bones_of(const HandRecording& recording) {
    BoneTally tally;
    for (const HandFrame& frame : recording.frames)
        if (frame.valid) tally.add(frame.bones);
    return tally;
}

void add_frame(HandRecording& recording, HandFrame frame, double time, const std::filesystem::path& path, int line) {
    frame.time = time;
    if (!recording.frames.empty()) {
        const double gap = time - recording.frames.back().time;
        if (gap < 0) refuse_line(path, line, "time runs backward; sort the frames");
        if (gap == 0) return;  // repeated frame
        recording.largest_gap = std::max(recording.largest_gap, gap);
    }
    recording.frames.push_back(frame);
}

namespace {

/// One line without the carriage return of files written on Windows.
bool next_line(std::istream& in, std::string& line) {
    if (!std::getline(in, line)) return false;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return true;
}

HandRecording read_json_lines(const std::filesystem::path& path, const std::string& hand) {
    std::ifstream in(path);
    skip_byte_order_mark(in);
    std::string line;
    HandRecording recording;
    double first_time = 0;
    bool started = false;
    HandFrameUnits units;
    for (int number = 1; next_line(in, line); ++number) {
        if (line.empty()) continue;
        std::string wrong;
        const auto json = parse_object(line, wrong);
        if (!wrong.empty())
            refuse_line(path, number, wrong + " (half a line at the end is left by a killed recorder: delete it)");
        if (!json.contains("joints") || json["joints"].is_string()) {  // a header
            units = {};
            if (const std::string wrong = read_units(json, units); !wrong.empty()) refuse_line(path, number, wrong);
            continue;
        }
        if (!json.contains("t") || !json["t"].is_number()) refuse_line(path, number, "expected a time \"t\"");
        const double time = json["t"].get<double>();
        if (!started) first_time = time, started = true;
        const auto which = json.find("hand");
        if (which != json.end() && *which != hand) continue;
        HandFrame frame;
        if (const std::string wrong = read_hand_frame(json, units, frame); !wrong.empty())
            refuse_line(path, number, wrong);
        add_frame(recording, frame, time - first_time, path, number);
    }
    return recording;
}

}  // namespace

std::string read_units(const nlohmann::json& json, HandFrameUnits& units) {
    auto text = [&](const char* key, const std::string& fallback) {
        return !json.contains(key) ? fallback : json[key].is_string() ? json[key].get<std::string>() : "";
    };
    const std::string unit = text("units", units.scale == 1 ? "m" : "mm"), axis = text("up", units.y_up ? "y" : "z");
    if (unit != "m" && unit != "mm") return "units: expected \"m\" or \"mm\", found " + shown(json["units"]);
    if (axis != "y" && axis != "z") return "up: expected \"y\" or \"z\", found " + shown(json["up"]);
    units = {unit == "mm" ? 1e-3 : 1, axis == "y"};
    return "";
}

std::string read_hand_frame(const nlohmann::json& json, const HandFrameUnits& units, HandFrame& frame) {
    const auto joints = json.find("joints"), valid = json.find("valid");
    if (joints == json.end() || !joints->is_array() || joints->size() != std::size_t(hand_joint_count))
        return "expected 26 \"joints\"";
    frame.valid = valid == json.end() || (valid->is_boolean() && valid->get<bool>());
    std::array<HandJoint, hand_joint_count> read;
    for (int f = 0; f < 5; ++f)
        for (int j = distal_joint(f); j < distal_joint(f) + 2; ++j) {
            const auto& row = (*joints)[std::size_t(j)];
            HandJoint& joint = read[std::size_t(j)];
            for (std::size_t k = 0; k < 7; ++k) {
                if (!row.is_array() || row.size() < 7 || !row[k].is_number())
                    return "joint " + std::to_string(j) + ": expected [x, y, z, qx, qy, qz, qw, radius]";
                (k < 3 ? joint.position[k] : joint.rotation[k - 3]) = row[k].get<double>();
            }
        }
    set_fingers(frame, read, units);
    return "";
}

void set_fingers(HandFrame& frame, const std::array<HandJoint, hand_joint_count>& joints, const HandFrameUnits& units) {
    const auto place = [&](const HandJoint& joint) { return Vector3d(joint.position.data()); };
    const auto finite = [&](const HandJoint& joint) { return (units.scale * place(joint)).allFinite(); };
    for (int f = 0; f < 5; ++f) {
        const HandJoint &distal = joints[std::size_t(distal_joint(f))], &tip = joints[std::size_t(distal_joint(f) + 1)];
        const Eigen::Quaterniond q(distal.rotation[3], distal.rotation[0], distal.rotation[1], distal.rotation[2]);
        if (!(q.norm() > 1e-3) || !std::isfinite(q.norm()) || !finite(distal) || !finite(tip)) {
            frame.valid = false;
            continue;
        }
        set_finger(frame, f, place(distal), place(tip), q.normalized().toRotationMatrix(), units);
    }
}

HandRecording read_hand_recording(const std::filesystem::path& path, const std::string& hand) {
    if (!std::filesystem::is_regular_file(path)) throw InputError(path.string() + ": no such file");
    const std::string kind = path.extension().string();
    HandRecording recording;
    if (kind == ".csv")
        recording = read_leap_csv(path, hand);
    else if (kind == ".jsonl" || kind == ".json")
        recording = read_json_lines(path, hand);
    else
        throw InputError(path.string() + ": unknown kind '" + kind + "'; expected .jsonl or .csv");
    if (recording.frames.size() < 2)
        throw InputError(path.string() + ": fewer than two frames of the " + hand + " hand");
    return recording;
}

std::string hand_header() { return R"({"units": "m", "up": "z", "joints": "XR_EXT_hand_tracking"})"; }

std::string hand_line(int hand, const HandFrame& frame) {
    auto joints = nlohmann::json::array();
    for (int j = 0; j < hand_joint_count; ++j) joints.push_back(nlohmann::json::array());
    for (int f = 0; f < 5; ++f) {
        const Pose<double>& pose = frame.finger[std::size_t(f)];
        const Mat3<double> R = rotation_matrix(pose.rotation);
        const Vec3<double> distal = R.column(0), dorsal = R.column(2);
        const Vec3<double> side = cross(distal, dorsal);
        Matrix3d axes;  // x sideways, y dorsal, z proximal
        axes << side.x, dorsal.x, -distal.x, side.y, dorsal.y, -distal.y, side.z, dorsal.z, -distal.z;
        const Eigen::Quaterniond q(axes);
        const auto first = std::size_t(distal_joint(f));
        for (std::size_t end : {0u, 1u}) {
            // Where they were, also where rotations say otherwise: a recording shows what was sent.
            const Vec3<double> p =
                pose.position + ((end ? 0.5 : -0.5) * frame.length[std::size_t(f)]) * frame.to_tip[std::size_t(f)];
            joints[first + end] = {p.x, p.y, p.z, q.x(), q.y(), q.z(), q.w(), 0};
        }
    }
    return nlohmann::json{{"t", frame.time}, {"hand", hand_names[std::size_t(hand)]}, {"joints", joints}}.dump();
}

TrackerPose::Sample sample_recording(const HandRecording& r, int finger, double time) {
    TrackerPose::Sample s;
    s.time = time;
    if (r.frames.empty()) return s;
    const double first = r.frames.front().time, length = r.frames.back().time - first;
    if (r.loop && time > first) time = first + std::fmod(time - first, length);
    if (time < first || time > r.frames.back().time) return s;
    const auto next = std::lower_bound(r.frames.begin(), r.frames.end(), time,
                                       [](const HandFrame& f, double t) { return f.time < t; });
    const HandFrame& b = *next;
    const HandFrame& a = next == r.frames.begin() ? b : *std::prev(next);
    if (!a.valid || !b.valid || b.time - a.time > 0.1) return s;
    const double share = b.time > a.time ? (time - a.time) / (b.time - a.time) : 0;
    const Pose<double>&pa = a.finger[finger], &pb = b.finger[finger];
    s.pose = {pa.position + share * (pb.position - pa.position), slerp(pa.rotation, pb.rotation, share)};
    s.valid = true;
    return s;
}

}  // namespace palpate
