#include "scenes/trackers/trajectory.h"

#include <algorithm>
#include <cmath>
#include <numbers>

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

std::vector<Quaternion<double>> written_turn(const Vec3<double>& from, const Vec3<double>& to) {
    const Vec3<double> change = to - from;
    const double most = std::max({std::abs(change.x), std::abs(change.y), std::abs(change.z)});
    const int changed = (change.x != 0) + (change.y != 0) + (change.z != 0);
    if (most < (changed == 1 ? 1 : 2) * std::numbers::pi - 1e-9) return {};
    // Angles about several axes turn about none that stays: short parts follow them.
    const int parts = int(std::ceil(most / (5 * std::numbers::pi / 180)));
    const Quaternion<double> back = conjugate(from_roll_pitch_yaw(from.x, from.y, from.z));
    std::vector<Quaternion<double>> turn;
    for (int i = 0; i <= parts; ++i) {
        const Vec3<double> at = from + (double(i) / parts) * change;
        turn.push_back(normalised(back * from_roll_pitch_yaw(at.x, at.y, at.z)));
    }
    return turn;
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
    const Vec3<double> position = a.pose.position + s * (b.pose.position - a.pose.position);
    if (b.turn.size() < 2) return {position, slerp(a.pose.rotation, b.pose.rotation, s)};
    const double part = s * double(b.turn.size() - 1);
    const std::size_t i = std::min(std::size_t(part), b.turn.size() - 2);
    return {position, normalised(a.pose.rotation * slerp(b.turn[i], b.turn[i + 1], part - double(i)))};
}

}  // namespace palpate
