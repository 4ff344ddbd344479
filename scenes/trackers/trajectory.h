#pragma once
// Scripted motion: keyframes with smooth interpolation.

#include <vector>

#include "engine/math/pose.h"

namespace palpate {

struct Keyframe {
    double time = 0;  ///< [s]
    Pose<double> pose = Pose<double>::identity();
};

/// Pose at a time: minimum-jerk in between (speed and acceleration zero at keyframes), constant outside.
Pose<double> trajectory_pose(const std::vector<Keyframe>& keyframes, double time);

/// Shortest rotation between two orientations, at share s in [0, 1].
Quaternion<double> slerp(const Quaternion<double>& a, Quaternion<double> b, double s);

/// Rotation by roll about x, then pitch about y, then yaw about z [rad].
Quaternion<double> from_roll_pitch_yaw(double roll, double pitch, double yaw);

}  // namespace palpate
