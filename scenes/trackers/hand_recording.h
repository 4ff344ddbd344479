#pragma once
// Recorded hands, replayed as finger poses.

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/world.h"

namespace palpate {

inline constexpr std::array<const char*, 5> finger_names{"thumb", "index", "middle", "ring", "little"};

/// Poses of the five distal segments in the finger frame's convention (x distal, y radial, z to the
/// nail), origin midway between distal joint and tip. World z up.
struct HandRecording {
    struct Frame {
        double time = 0;  ///< from the first frame [s]
        bool valid = false;
        std::array<Pose<double>, 5> finger;
    };
    std::vector<Frame> frames;
    double largest_gap = 0;  ///< between frames [s]
};

/// Unit of length and up axis of joints.
struct HandFrameUnits {
    double scale = 1;  ///< metres per unit
    bool y_up = true;
};

/// Takes units ("m" or "mm") and up axis ("y" or "z") from an object that names them. Returns what is wrong; empty if
/// nothing is.
std::string read_units(const nlohmann::json& json, HandFrameUnits& units);

/// Finger poses from one object {"joints": 26 x [x, y, z, qx, qy, qz, qw, ...], "valid"}. Returns what is wrong; empty
/// if nothing is. Does not set the frame's time.
std::string read_hand_frame(const nlohmann::json& json, const HandFrameUnits& units, HandRecording::Frame& frame);

/// Reads JSON lines (a header with units and up axis, then {"t", "hand", "valid", "joints": 26 x
/// [x, y, z, qx, qy, qz, qw, radius]}, joints ordered and oriented as in XR_EXT_hand_tracking) or the CSV of the
/// Leap Motion recordings. `hand` is "left" or "right". Throws InputError with file and line.
HandRecording read_hand_recording(const std::filesystem::path& path, const std::string& hand);

/// Pose of a finger at a time, interpolated between frames; not valid outside the recording, at frames
/// marked invalid and in gaps longer than 0.1 s.
TrackerPose::Sample sample_recording(const HandRecording& recording, int finger, double time);

}  // namespace palpate
