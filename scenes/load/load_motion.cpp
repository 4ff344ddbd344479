#include "scenes/load/load_motion.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "meshes/input_error.h"
#include "scenes/trackers/hand_doubts.h"
#include "scenes/trackers/hand_source.h"

namespace palpate {

namespace {

double largest(const Vec3<double>& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// Places of a pose or track, in the unit of the file, as far as it has any.
struct Places {
    Vec3<double> position{0, 0, 0}, rotation{0, 0, 0};  ///< those farthest from zero
    void take(const Vec3<double>& p, const Vec3<double>& r) {
        if (largest(p) > largest(position)) position = p;
        if (largest(r) > largest(rotation)) rotation = r;
    }
};

/// Nobody places a finger within 0.3 mm, but many give metres; nobody turns it by 1.571 degrees.
void doubt_units(Section& s, const std::string& position_key, const std::string& rotation_key, const Places& at) {
    const double far = largest(at.position), turned = largest(at.rotation);
    if (far > 0 && far < 0.3)
        s.doubt(position_key, number_text(far) + " is the farthest from 0 and looks like metres; mm are expected");
    const double five_degrees = 5 * unit::deg.si, steps = std::round(turned / five_degrees);
    if (steps >= 1 && turned < 6.3 && std::abs(turned - steps * five_degrees) < 0.0015)
        s.doubt(rotation_key, number_text(turned) + " looks like " + number_text(5 * steps) +
                                  " degrees in radians; degrees are expected");
}

/// From 170 to -170 degrees is 340 degrees as it is written, and few mean that.
void doubt_long_turn(Section& s, const Vec3<double>& from, const Vec3<double>& to) {
    for (int i = 0; i < 3; ++i) {
        const double a = from[i] / unit::deg.si, b = to[i] / unit::deg.si, turn = b - a;
        if (std::abs(turn) > 180 + 1e-6 && std::abs(turn) < 360 - 1e-6)
            s.doubt("rotation_deg", "turns by " + number_text(turn) + " degrees, from " + number_text(a) + " to " +
                                        number_text(b) + ", as it is written; the shorter way is to " +
                                        number_text(turn > 0 ? b - 360 : b + 360));
    }
}

struct PoseKeys {
    std::optional<Vec3<double>> position, rotation;
    /// The pose, with what is absent taken from another one.
    Pose<double> over(const Pose<double>& other) const {
        Pose<double> pose = other;
        if (position) pose.position = *position;
        if (rotation) pose.rotation = from_roll_pitch_yaw(rotation->x, rotation->y, rotation->z);
        return pose;
    }
};

PoseKeys read_pose_keys(Section& s, const char* position_sentence, Places& places) {
    PoseKeys keys;
    s.vector("position_mm", keys.position, unit::mm, 5000, position_sentence);
    s.vector("rotation_deg", keys.rotation, unit::deg, 3600,
             "Rotation [roll, pitch, yaw]: about the fixed x, then the fixed y, then the fixed z axis. In a track, "
             "an angle that changes alone by half a turn or more, or by a whole one, turns as written; otherwise the "
             "shortest way is taken.");
    const Vec3<double> none{0, 0, 0};
    places.take((1 / unit::mm.si) * keys.position.value_or(none), (1 / unit::deg.si) * keys.rotation.value_or(none));
    return keys;
}

}  // namespace

Pose<double> read_pose(Section& s, const char* position_sentence) {
    Places places;
    const PoseKeys keys = read_pose_keys(s, position_sentence, places);
    doubt_units(s, "position_mm", "rotation_deg", places);
    return keys.over(Pose<double>::identity());
}

std::vector<Keyframe> read_track(Section& owner, const char* sentence) {
    std::vector<Keyframe> track;
    Places places;
    Vec3<double> angles{0, 0, 0};
    for (Section& s : owner.tables("track", sentence)) {
        Keyframe k;
        s.number("t_s", k.time, unit::s, {0, 1e5}, "Time of this place; poses between two times are interpolated.");
        s.require("t_s", "a keyframe needs its time");
        const PoseKeys keys =
            read_pose_keys(s, "Position [x, y, z] at that time; without it, that of the entry before.", places);
        k.pose = keys.over(track.empty() ? Pose<double>::identity() : track.back().pose);
        const Vec3<double> before = std::exchange(angles, keys.rotation.value_or(angles));
        if (!track.empty()) k.turn = written_turn(before, angles);
        if (!k.turn.empty()) doubt_long_turn(s, before, angles);
        if (s.sound("t_s") && !track.empty() && k.time <= track.back().time)
            s.complain("t_s", "keyframes must follow each other in time: " + number_text(k.time) +
                                  " s does not come after " + number_text(track.back().time) + " s");
        s.finish();
        track.push_back(k);
    }
    doubt_units(owner, "track", "track", places);
    return track;
}

namespace {

const std::vector<std::string> hand_words(hand_names.begin(), hand_names.end());

int read_hand_and_place(Section& s, Scene& scene) {
    int hand = 1;
    s.choice("hand", hand, hand_words, "Which hand fingers follow, unless they say otherwise.");
    const Pose<double> pose = read_pose(s, "Where the origin of the hand's frame lies in the world.");
    if (s.in_file()) scene.tracker_pose = pose;
    s.number("tracker_timeout_s", scene.tracker_timeout, unit::s, {0.1, 3600},
             "A thimble whose hand has not been seen for this long is led to rest, slowly.", Likely{0.1, 60, "", "ms"});
    return hand;
}

}  // namespace

HandSource read_hand_source(Section& root, Scene& scene, const std::filesystem::path& folder) {
    HandSource source;
    Section recording = root.table("recording", "A recorded hand that fingers follow (`follow`).");
    if (recording) {
        source.hand = read_hand_and_place(recording, scene);
        std::string file;
        recording.text("file", file,
                       "The recording: JSON lines with 26 OpenXR joints (.jsonl), or the CSV of Leap Motion "
                       "recordings; relative to the scene's folder.");
        recording.require("file", "expected the name of a recording (.jsonl or .csv)");
        recording.number("start_s", scene.recording_start, unit::s, {0, 1e5},
                         "Time in the recording at which the scene begins.");
        recording.number("speed", scene.recording_speed, unit::one, {1e-3, 1e3},
                         "Recorded seconds per simulated second.");
        recording.boolean("loop", source.loop, "Begin again when the recording has ended.");
        source.file = (folder / file).lexically_normal();
        if (!file.empty() && !std::filesystem::is_regular_file(source.file))
            recording.complain("file", source.file.string() + ": no such file");
        source.unusable = !recording.sound("file");
        recording.finish();
    }
    Section tracker = root.table("tracker", "A live hand that fingers follow (`follow`).");
    if (tracker) {
        source.hand = read_hand_and_place(tracker, scene);
        tracker.text("source", scene.tracker,
                     "Where it comes from: \"udp:PORT\", \"websocket:PORT\", \"openxr\", \"ultraleap\" or "
                     "\"ultraleap:HOST:PORT\".");
        tracker.require("source", "expected where the hand comes from, for example \"udp:9000\"");
        if (const std::string wrong = tracker_problem(scene.tracker); !wrong.empty() && tracker.sound("source"))
            tracker.complain("source", wrong);
        source.unusable = source.unusable || !tracker.sound("source");
        tracker.finish();
    }
    if (recording.in_file() && tracker.in_file())
        root.complain("tracker", "a scene has either a [recording] or a [tracker]");
    return source;
}

void read_followed(Section& s, Scene& scene, const HandSource& source, FingerMotion& motion) {
    std::string follow;
    s.text("follow", follow,
           "Finger of the recorded or live hand that this one follows: thumb, index, middle, ring or little.");
    motion.hand = source.hand;
    s.choice("hand", motion.hand, hand_words, "Hand that it follows; by default that of [recording] or [tracker].");
    if (Section fit = s.table("fit", "How the model's finger sits in the tracked one (`palpate tracker` finds it).")) {
        motion.fit = read_pose(fit, "Origin of the model's finger in the frame of the tracked one.");
        fit.finish();
    }
    if (follow.empty()) {
        for (const char* key : {"fit", "hand"})
            if (s.has(key) && s.sound("follow")) s.complain(key, "only a finger that follows a tracked one has it");
        return;
    }
    const auto it = std::find(finger_names.begin(), finger_names.end(), follow);
    if (it == finger_names.end())
        return s.complain("follow", "expected thumb, index, middle, ring or little, found \"" + follow + "\"");
    motion.followed_finger = int(it - finger_names.begin());
    auto& recording = scene.recordings[std::size_t(motion.hand)];
    if (!scene.tracker.empty() || recording || source.unusable) return;
    if (source.file.empty()) return s.complain("follow", "the scene has no [recording] or [tracker] to follow");
    try {
        auto read =
            std::make_shared<HandRecording>(read_hand_recording(source.file, hand_names[std::size_t(motion.hand)]));
        read->loop = source.loop;
        scene.files.push_back(source.file);
        recording = read;  // also where it is refused: other fingers need not say so again
        if (const std::string problem = recorded_time_problem(*read); !problem.empty())
            s.doubt("follow", source.file.string() + ": " + problem);
        const BoneTally bones = bones_of(*read);
        if (const std::string problem = bone_problem(bones); !problem.empty()) {
            const std::string text = source.file.string() + ": " + problem;
            if (bones_are_impossible(bones)) throw InputError(text);  // trackers may be off, but not by so much
            s.doubt("follow", text);
        }
    } catch (const InputError& error) { s.complain_as_found("follow", error.messages); }
}

}  // namespace palpate
