#pragma once
// Recorded hands, replayed as finger poses.

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "engine/world.h"
#include "scenes/trackers/bone_axes.h"

namespace palpate {

inline constexpr std::array<const char*, 5> finger_names{"thumb", "index", "middle", "ring", "little"};
inline constexpr std::array<const char*, 2> hand_names{"left", "right"};

/// One hand at one time: poses of the five distal segments in the finger frame's convention (x distal, y radial, z to
/// the nail), origin midway between distal joint and tip. World z up.
struct HandFrame {
    double time = 0;  ///< from the first frame [s]
    bool valid = false;
    std::optional<double> own_time{};  ///< by the tracker's clock, if it has one; of live hands [s]
    std::array<Pose<double>, 5> finger;
    std::array<double, 5> length{};        ///< from distal joint to tip [m]
    std::array<Vec3<double>, 5> to_tip{};  ///< unit vector from distal joint to tip, whatever rotations say; 0: none
    std::array<BoneAngles, 5> bones{no_bone_angles, no_bone_angles, no_bone_angles, no_bone_angles, no_bone_angles};
};

struct HandRecording {
    std::vector<HandFrame> frames;
    double largest_gap = 0;  ///< between frames [s]
    bool loop = false;       ///< replayed again and again
    std::string note{};      ///< what was guessed; empty: nothing
};

/// Unit of length and up axis of joints.
struct HandFrameUnits {
    double scale = 1;  ///< metres per unit
    bool y_up = true;
};

/// World axes from a tracker's: z up, from y up where it is so.
Eigen::Matrix3d to_z_up(bool y_up);

/// Puts a finger into a frame by its distal joint and tip, with the bone's axes (columns: x sideways, y dorsal,
/// z proximal, as both OpenXR and Leap Motion give them), all in the tracker's unit and axes.
void set_finger(HandFrame& frame, int finger, const Eigen::Vector3d& joint, const Eigen::Vector3d& tip,
                const Eigen::Matrix3d& bone, const HandFrameUnits& units);

/// A joint as a tracker gives it.
struct HandJoint {
    std::array<double, 3> position{};  ///< in the tracker's unit and axes
    std::array<double, 4> rotation{};  ///< x y z w; zeros: not known
};
inline constexpr int hand_joint_count = 26;  ///< ordered and oriented as in XR_EXT_hand_tracking
/// The ten of them from which finger poses are made: distal joint and tip, of the thumb first.
constexpr int distal_joint(int finger) { return finger == 0 ? 4 : 4 + 5 * finger; }

/// Finger poses from joints. The frame is not valid where one that it takes is not known, or not finite.
void set_fingers(HandFrame& frame, const std::array<HandJoint, hand_joint_count>& joints, const HandFrameUnits& units);

/// Takes units ("m" or "mm") and up axis ("y" or "z") from an object that names them. Returns what is wrong; empty if
/// nothing is.
std::string read_units(const nlohmann::json& json, HandFrameUnits& units);

/// Finger poses from one object {"joints": 26 x [x, y, z, qx, qy, qz, qw, ...], "valid"}. Returns what is wrong; empty
/// if nothing is. Does not set the frame's time.
std::string read_hand_frame(const nlohmann::json& json, const HandFrameUnits& units, HandFrame& frame);

/// Appends a frame [s from the first], one that repeats the last one's time apart. Throws InputError where time runs
/// backward.
void add_frame(HandRecording& recording, HandFrame frame, double time, const std::filesystem::path& path, int line);

/// How far its rotations and positions agree.
BoneTally bones_of(const HandRecording& recording);

/// Reads JSON lines (a header with units and up axis, then {"t", "hand", "valid", "joints": 26 x
/// [x, y, z, qx, qy, qz, qw, radius]}, joints ordered and oriented as in XR_EXT_hand_tracking) or the CSV of the
/// Leap Motion recordings (leap_csv.h). `hand` is "left" or "right". Throws InputError with file and line.
HandRecording read_hand_recording(const std::filesystem::path& path, const std::string& hand);

/// First line of a recording as hand_line writes them, and a frame: the joints that a finger's pose needs, the others
/// empty.
std::string hand_header();
std::string hand_line(int hand, const HandFrame& frame);

/// Pose of a finger at a time, interpolated between frames; not valid outside the recording, at frames
/// marked invalid and in gaps longer than 0.1 s.
TrackerPose::Sample sample_recording(const HandRecording& recording, int finger, double time);

}  // namespace palpate
