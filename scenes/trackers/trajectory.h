#pragma once
// Scripted motion: keyframes with smooth interpolation.

#include <vector>

#include "engine/math/pose.h"

namespace palpate {

struct Keyframe {
    double time = 0;  ///< [s]
    Pose<double> pose = Pose<double>::identity();
    /// How it turns from the keyframe before to this one: rotations in the frame of that before, by equal shares of the
    /// way, first the identity. Empty: the shortest way.
    std::vector<Quaternion<double>> turn{};
};

/// Pose at a time: minimum-jerk in between (speed and acceleration zero at keyframes), constant outside.
Pose<double> trajectory_pose(const std::vector<Keyframe>& keyframes, double time);

/// Shortest rotation between two orientations, at share s in [0, 1].
Quaternion<double> slerp(const Quaternion<double>& a, Quaternion<double> b, double s);

/// Keyframe::turn of angles [roll, pitch, yaw] that change from one keyframe to the next as they are written [rad].
/// Empty, for the shortest way, where one alone changes by less than half a turn, or where several change, none by a
/// whole turn: what they come to together may be small.
std::vector<Quaternion<double>> written_turn(const Vec3<double>& from, const Vec3<double>& to);

/// Rotation by roll about x, then pitch about y, then yaw about z [rad].
Quaternion<double> from_roll_pitch_yaw(double roll, double pitch, double yaw);

}  // namespace palpate
