// A platform that three cables pull against the pad, after Prattichizzo et al. (2013), Towards wearability in fingertip
// haptics: three motors on the back of the finger wind up the cables to the platform's three corners. That paper gives
// no geometry in the form used here; lengths and pulleys are assumptions of this file. Configuration (pitch, roll, dz):
// the pad holds the platform's centre on the axis and keeps it from turning about it.

#include <cmath>

#include "devices/device.h"

namespace palpate {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

enum Geometry { fixed_radius, mobile_radius, pulley, level };

struct Tilt {
    Matrix3d R, dpitch, droll;
};
Tilt tilt(const Coordinates& w) {
    const double ct = std::cos(w[0]), st = std::sin(w[0]), cp = std::cos(w[1]), sp = std::sin(w[1]);
    Matrix3d X, dX, Y, dY;
    X << 1, 0, 0, 0, cp, -sp, 0, sp, cp;
    dX << 0, 0, 0, 0, -sp, -cp, 0, cp, -sp;
    Y << ct, 0, st, 0, 1, 0, -st, 0, ct;
    dY << -st, 0, ct, 0, 0, 0, -ct, 0, -st;
    return {X * Y, X * dY, dX * Y};
}

Platform platform(const DeviceModel&, const Coordinates& w) {
    const Tilt t = tilt(w);
    Platform p;
    p.rotation = t.R;
    p.centre = Vector3d(0, 0, w[2]);
    p.normal = -t.R.col(2);
    p.dcentre.setZero(3, 3);
    p.dcentre(2, 2) = 1;
    p.dnormal.resize(3, 3);
    p.dnormal << -t.dpitch.col(2), -t.droll.col(2), Vector3d::Zero();
    return p;
}

/// Where a cable leaves the fixed frame (radius of that) and reaches the platform (radius of this), level.
Vector3d corner(double radius, int k) {
    const double angle = 120 * degree * k;
    return {radius * std::cos(angle), radius * std::sin(angle), 0};
}

/// Angle of each pulley: how much longer its cable is than when the platform is level at dz = `level`.
Joints joints(const DeviceModel& m, const Coordinates& w) {
    const Tilt t = tilt(w);
    const auto& g = m.geometry;
    const double home = std::hypot(g[mobile_radius] - g[fixed_radius], g[level]);
    Joints out;
    out.q.resize(3);
    out.dq.resize(3, 3);
    for (int k = 0; k < 3; ++k) {
        const Vector3d end = corner(g[mobile_radius], k);
        const Vector3d d = Vector3d(0, 0, w[2]) + t.R * end - corner(g[fixed_radius], k);
        const double length = d.norm();
        out.q[k] = (length - home) / g[pulley];
        out.dq.row(k) << d.dot(t.dpitch * end), d.dot(t.droll * end), d.z();
        out.dq.row(k) /= length * g[pulley];
    }
    return out;
}

Skeleton skeleton(const DeviceModel& m, const Coordinates& w) {
    const Platform p = platform(m, w);
    Skeleton lines(2);
    for (int k = 0; k < 4; ++k) {
        lines[0].push_back(corner(m.geometry[fixed_radius], k));
        lines[1].push_back(p.centre + p.rotation * corner(m.geometry[mobile_radius], k));
        if (k < 3) lines.push_back({lines[0].back(), lines[1].back()});
    }
    return lines;
}

DeviceModel defaults() {
    DeviceModel m;
    m.kind = find_kind("cable-3");
    m.geometry = {0.012, 0.014, 0.005, 0.0246};
    m.joint_min = Coordinates::Constant(3, -100 * degree);
    m.joint_max = Coordinates::Constant(3, 100 * degree);
    m.rest = Vector3d(0, 0, 0.0290);
    m.disk_radius = 0.014;
    m.mount = mount_above_nail();
    return m;
}

}  // namespace

const DeviceKind& cable_3() {
    static const DeviceKind kind = [] {
        DeviceKind k;
        k.name = "cable-3";
        k.configuration_names = {"pitch", "roll", "dz"};
        k.configuration_is_length = {false, false, true};
        k.geometry_names = {"fixed_radius", "mobile_radius", "pulley", "level"};
        k.joint_count = 3;
        k.configuration_min = Vector3d(-60 * degree, -60 * degree, 0.012);
        k.configuration_max = Vector3d(60 * degree, 60 * degree, 0.040);
        k.configuration_scale = Vector3d(0.3, 0.3, 0.004);
        k.defaults = defaults;
        k.platform = platform;
        k.joints = joints;
        k.skeleton = skeleton;
        return k;
    }();
    return kind;
}

}  // namespace palpate
