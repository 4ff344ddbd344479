#pragma once
// Between palpate and the messages of ROS 2. Written for anything that has the fields of std_msgs, geometry_msgs and
// sensor_msgs, so that it is tested where ROS is not installed.

#include <palpate/palpate.h>

#include <cmath>
#include <cstdint>
#include <string>

namespace palpate::ros {

/// Time in whole seconds and nanoseconds below a second.
template <class Stamp>
void to_stamp(double time, Stamp& out) {
    const double whole = std::floor(time);
    auto nanoseconds = std::int64_t(std::llround(1e9 * (time - whole)));
    const bool carries = nanoseconds >= 1000000000;
    out.sec = std::int32_t(whole) + (carries ? 1 : 0);
    out.nanosec = std::uint32_t(carries ? nanoseconds - 1000000000 : nanoseconds);
}

/// A vector of the world in the frame of a pose (position x y z, rotation w x y z): turned back.
inline void into_frame(const double* pose, const double* v, double* out) {
    const double w = pose[3], x = -pose[4], y = -pose[5], z = -pose[6];
    const double cx = y * v[2] - z * v[1] + w * v[0], cy = z * v[0] - x * v[2] + w * v[1],
                 cz = x * v[1] - y * v[0] + w * v[2];
    out[0] = v[0] + 2 * (y * cz - z * cy);
    out[1] = v[1] + 2 * (z * cx - x * cz);
    out[2] = v[2] + 2 * (x * cy - y * cx);
}

/// What a finger feels: force and torque on its skin, in the frame of its bone and about that one's origin, as a wrench
/// is understood (`frame` is the finger's).
template <class WrenchStamped>
void to_wrench(const PalpateFingerState& finger, const std::string& frame, WrenchStamped& out) {
    to_stamp(finger.time, out.header.stamp);
    out.header.frame_id = frame;
    double v[3];
    into_frame(finger.bone_pose, finger.force, v);
    out.wrench.force.x = v[0], out.wrench.force.y = v[1], out.wrench.force.z = v[2];
    into_frame(finger.bone_pose, finger.torque, v);
    out.wrench.torque.x = v[0], out.wrench.torque.y = v[1], out.wrench.torque.z = v[2];
}

/// Where a pose is, as a transform from `world` to `frame`.
template <class TransformStamped>
void to_transform(const double* pose, double time, const std::string& frame, TransformStamped& out) {
    to_stamp(time, out.header.stamp);
    out.header.frame_id = "world";
    out.child_frame_id = frame;
    auto& t = out.transform;
    t.translation.x = pose[0], t.translation.y = pose[1], t.translation.z = pose[2];
    t.rotation.w = pose[3], t.rotation.x = pose[4], t.rotation.y = pose[5], t.rotation.z = pose[6];
}

/// Appends a thimble's joints, "FINGER_joint_1" and so on, where its servos have got to [rad].
template <class JointState>
void add_joints(const PalpateThimbleState& thimble, const std::string& finger, JointState& out) {
    for (std::int32_t k = 0; k < thimble.joint_count; ++k) {
        out.name.push_back(finger + "_joint_" + std::to_string(k + 1));
        out.position.push_back(thimble.reached[k]);
    }
}

/// A pose of a topic (in the world's frame). False where it is none: not finite, or without a rotation.
template <class Pose>
bool from_pose(const Pose& in, double* pose) {
    const double numbers[7] = {in.position.x,    in.position.y,    in.position.z,   in.orientation.w,
                               in.orientation.x, in.orientation.y, in.orientation.z};
    double square = 0;
    for (int k = 0; k < 7; ++k) {
        if (!std::isfinite(numbers[k])) return false;
        if (k >= 3) square += numbers[k] * numbers[k];
    }
    if (square < 1e-12) return false;
    for (int k = 0; k < 7; ++k) pose[k] = k < 3 ? numbers[k] : numbers[k] / std::sqrt(square);
    return true;
}

/// What may stand in the name of a topic or frame: other characters become underscores.
inline std::string topic_name(const std::string& name) {
    std::string out;
    for (const char c : name) {
        const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'), digit = c >= '0' && c <= '9';
        out += letter || c == '_' || (digit && !out.empty()) ? c : '_';
    }
    return out.empty() ? "_" : out;
}

}  // namespace palpate::ros
