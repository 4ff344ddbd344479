#include "scenes/trackers/trajectory.h"

#include <algorithm>
#include <cmath>

namespace palpate {

Quaternion<double> slerp(const Quaternion<double>& a, Quaternion<double> b, double s) {
    double c = a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
    if (c < 0) b = {-b.w, -b.x, -b.y, -b.z}, c = -c;
    const double angle = std::acos(std::min(1.0, c));
    const double wa = angle < 1e-6 ? 1 - s : std::sin((1 - s) * angle) / std::sin(angle);
    const double wb = angle < 1e-6 ? s : std::sin(s * angle) / std::sin(angle);
    return normalised(
        Quaternion<double>{wa * a.w + wb * b.w, wa * a.x + wb * b.x, wa * a.y + wb * b.y, wa * a.z + wb * b.z});
}

Quaternion<double> from_roll_pitch_yaw(double roll, double pitch, double yaw) {
    const Quaternion<double> x{std::cos(roll / 2), std::sin(roll / 2), 0, 0},
        y{std::cos(pitch / 2), 0, std::sin(pitch / 2), 0}, z{std::cos(yaw / 2), 0, 0, std::sin(yaw / 2)};
    return z * y * x;
}

Pose<double> trajectory_pose(const std::vector<Keyframe>& k, double time) {
    if (k.empty()) return Pose<double>::identity();
    if (time <= k.front().time) return k.front().pose;
    if (time >= k.back().time) return k.back().pose;
    const auto next =
        std::upper_bound(k.begin(), k.end(), time, [](double t, const Keyframe& f) { return t < f.time; });
    const Keyframe &a = *std::prev(next), &b = *next;
    const double t = (time - a.time) / (b.time - a.time);
    const double s = t * t * t * (10 + t * (-15 + 6 * t));
    return {a.pose.position + s * (b.pose.position - a.pose.position), slerp(a.pose.rotation, b.pose.rotation, s)};
}

}  // namespace palpate
