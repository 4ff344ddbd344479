#pragma once
// What the two kinds of 3-RRS share: numbers of the geometry, and the law of cosines in a leg.

#include <algorithm>
#include <cmath>

#include "devices/device.h"

namespace palpate::rrs {

enum Geometry { fixed_radius, fixed_half, mobile_radius, mobile_half, crank, link };

/// Seat of a leg in the frame of its platform: the first ahead, the others behind, `half` off the middle.
inline Eigen::Vector3d seat(double radius, double half, int leg) {
    if (leg == 0) return {radius, 0, 0};
    return {-std::sqrt(std::max(0.0, radius * radius - half * half)), leg == 1 ? -half : half, 0};
}
inline Eigen::Vector3d fixed_seat(const DeviceModel& m, int leg) {
    return seat(m.geometry[fixed_radius], m.geometry[fixed_half], leg);
}
inline Eigen::Vector3d mobile_seat(const DeviceModel& m, int leg) {
    return seat(m.geometry[mobile_radius], m.geometry[mobile_half], leg);
}

/// acos with its derivative, continued linearly near and beyond +-1, so that poses the legs cannot reach give joints
/// past their limits instead of NaN.
struct Arc {
    double value, slope;
};
inline Arc extended_acos(double c) {
    constexpr double edge = 1 - 1e-8;
    const double inside = std::clamp(c, -edge, edge);
    const double slope = -1 / std::sqrt(1 - inside * inside);
    return {std::acos(inside) + slope * (c - inside), slope};
}

/// Angle between crank and chord in the triangle of crank, link and a chord of some length, with its derivative by that
/// length. Closed where there is such a triangle.
struct ChordAngle {
    double value, slope;
    bool closed;
};
inline ChordAngle chord_angle(const DeviceModel& m, double length) {
    const double l = m.geometry[crank], L = m.geometry[link];
    const double c = (l * l + length * length - L * L) / (2 * l * length);
    const Arc arc = extended_acos(c);
    return {arc.value, arc.slope * (1 - (l * l - L * L) / (length * length)) / (2 * l), std::abs(c) <= 1};
}

}  // namespace palpate::rrs
