// The true 3-RRS mechanism: each leg's crank turns in a plane of its own, which its seat on the platform cannot leave.
// The planes decide yaw and sideways motion of the platform, where chinello-3rrs takes the closed form of Perez et al.
// 2017, Eqs. 6 and 7, that holds for legs at 120 degrees alone. Same geometry, same configuration (theta, psi, dz).
// Leg planes are vertical and hold the seats of the level platform.

#include <cmath>

#include "devices/kinds/rrs_geometry.h"

namespace palpate {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

using namespace rrs;

struct Leg {
    Vector3d A, B;  ///< seats on the fixed and the mobile platform, each in its frame
    Vector3d u, t;  ///< along its plane, outwards; across it
};

std::array<Leg, 3> legs_of(const DeviceModel& m) {
    std::array<Leg, 3> legs;
    for (int k = 0; k < 3; ++k) {
        Leg& leg = legs[std::size_t(k)];
        leg.A = fixed_seat(m, k);
        leg.B = mobile_seat(m, k);
        Vector3d u = leg.B - leg.A;
        // Cranks that end above their seats: radial planes. Seats that differ by less than any is built to are one, or
        // the last digit of a length would turn the planes by a right angle.
        if (u.norm() < 1e-3 * leg.A.norm()) u = leg.A;
        if (u.dot(leg.A) < 0) u = -u;
        leg.u = u.normalized();
        leg.t = Vector3d(-leg.u.y(), leg.u.x(), 0);
    }
    return legs;
}

/// Rotation Rx(psi) Ry(theta) Rz(phi) with its derivatives.
struct Rotation {
    Matrix3d R, dtheta, dpsi, dphi;
};
Rotation rotation(double theta, double psi, double phi) {
    auto turn = [](int axis, double angle, bool derivative) {
        const double c = derivative ? -std::sin(angle) : std::cos(angle),
                     s = derivative ? std::cos(angle) : std::sin(angle);
        const int i = (axis + 1) % 3, j = (axis + 2) % 3;
        Matrix3d M = Matrix3d::Zero();
        if (!derivative) M(axis, axis) = 1;
        M(i, i) = M(j, j) = c;
        M(j, i) = s;
        M(i, j) = -s;
        return M;
    };
    const Matrix3d X = turn(0, psi, false), Y = turn(1, theta, false), Z = turn(2, phi, false);
    return {X * Y * Z, X * turn(1, theta, true) * Z, turn(0, psi, true) * Y * Z, X * Y * turn(2, phi, true)};
}

/// What the leg planes leave: s = (phi, p_x, p_y) with t_i . (p + R B_i - A_i) = 0 for the three legs.
struct Closure {
    Rotation r;
    Vector3d s;
    Eigen::Matrix<double, 3, 2> ds;  ///< by theta and psi
    bool closed = false;
};

Closure close_legs(const std::array<Leg, 3>& legs, double theta, double psi) {
    Closure c;
    // The symmetric mechanism's yaw is a close guess.
    c.s = Vector3d(std::atan2(-std::sin(psi) * std::sin(theta), std::cos(theta) + std::cos(psi)), 0, 0);
    Matrix3d G;
    for (int iteration = 0; iteration < 12; ++iteration) {
        c.r = rotation(theta, psi, c.s[0]);
        Vector3d g;
        for (int k = 0; k < 3; ++k) {
            const Leg& leg = legs[std::size_t(k)];
            g[k] = leg.t.dot(Vector3d(c.s[1], c.s[2], 0) + c.r.R * leg.B - leg.A);
            G.row(k) << leg.t.dot(c.r.dphi * leg.B), leg.t.x(), leg.t.y();
        }
        if (std::abs(G.determinant()) < 1e-9) break;
        c.closed = g.norm() < 1e-13;
        if (c.closed) break;
        const Vector3d step = G.inverse() * g;
        c.s -= step * std::min(1.0, 0.5 / std::max(1e-12, std::abs(step[0])));
    }
    Eigen::Matrix<double, 3, 2> W;
    for (int k = 0; k < 3; ++k) {
        const Leg& leg = legs[std::size_t(k)];
        W.row(k) << leg.t.dot(c.r.dtheta * leg.B), leg.t.dot(c.r.dpsi * leg.B);
    }
    c.ds = std::abs(G.determinant()) < 1e-9 ? Eigen::Matrix<double, 3, 2>(Eigen::Matrix<double, 3, 2>::Zero())
                                            : Eigen::Matrix<double, 3, 2>(-G.inverse() * W);
    return c;
}

Platform platform(const DeviceModel& m, const Coordinates& w) {
    const Closure c = close_legs(legs_of(m), w[0], w[1]);
    Platform p;
    p.rotation = c.r.R;
    p.centre = Vector3d(c.s[1], c.s[2], w[2]);
    p.normal = -c.r.R.col(2);
    p.dcentre.setZero(3, 3);
    p.dcentre.block<2, 2>(0, 0) = c.ds.bottomRows<2>();
    p.dcentre(2, 2) = 1;
    p.dnormal.resize(3, 3);
    p.dnormal << -(c.r.dtheta + c.ds(0, 0) * c.r.dphi).col(2), -(c.r.dpsi + c.ds(0, 1) * c.r.dphi).col(2),
        Vector3d::Zero();
    return p;
}

/// Crank angles: in its plane, a leg is a triangle of crank, link and the chord from A to B.
Joints joints(const DeviceModel& m, const Coordinates& w) {
    const auto legs = legs_of(m);
    const Closure c = close_legs(legs, w[0], w[1]);
    Joints out;
    out.q.resize(3);
    out.dq.resize(3, 3);
    out.closed = c.closed;
    const Matrix3d dR[2] = {c.r.dtheta + c.ds(0, 0) * c.r.dphi, c.r.dpsi + c.ds(0, 1) * c.r.dphi};
    for (int k = 0; k < 3; ++k) {
        const Leg& leg = legs[std::size_t(k)];
        const Vector3d d = Vector3d(c.s[1], c.s[2], w[2]) + c.r.R * leg.B - leg.A;
        Matrix3d dd;
        for (int i = 0; i < 2; ++i) dd.col(i) = Vector3d(c.ds(1, i), c.ds(2, i), 0) + dR[i] * leg.B;
        dd.col(2) = Vector3d::UnitZ();
        const double x = d.dot(leg.u), z = d.z(), length = std::hypot(x, z);
        const ChordAngle gamma = chord_angle(m, length);
        out.closed = out.closed && gamma.closed;
        out.q[k] = std::atan2(z, x) - gamma.value;
        const Eigen::RowVector3d dx = leg.u.transpose() * dd, dz = dd.row(2);
        const Eigen::RowVector3d dlength = (x * dx + z * dz) / length;
        out.dq.row(k) = (x * dz - z * dx) / (length * length) - gamma.slope * dlength;
    }
    // Legs that cannot be brought into their planes: past every limit, so that no search ends here.
    if (!c.closed) out.q.setConstant(10);
    return out;
}

Skeleton skeleton(const DeviceModel& m, const Coordinates& w) {
    const auto legs = legs_of(m);
    const Platform p = platform(m, w);
    const Joints j = joints(m, w);
    Skeleton lines(2);
    for (int k = 0; k < 3; ++k) {
        const Leg& leg = legs[std::size_t(k)];
        const Vector3d B = p.centre + p.rotation * leg.B;
        const Vector3d knee =
            leg.A + m.geometry[crank] * (std::cos(j.q[k]) * leg.u + std::sin(j.q[k]) * Vector3d::UnitZ());
        lines.push_back({leg.A, knee, B});
        lines[0].push_back(leg.A), lines[1].push_back(B);
    }
    lines[0].push_back(lines[0][0]), lines[1].push_back(lines[1][0]);
    return lines;
}

DeviceModel defaults() {
    DeviceModel m = find_kind("chinello-3rrs")->defaults();
    m.kind = find_kind("rrs-exact");
    return m;
}

}  // namespace

const DeviceKind& rrs_exact() {
    static const DeviceKind kind = [] {
        DeviceKind k = *find_kind("chinello-3rrs");
        k.name = "rrs-exact";
        k.defaults = defaults;
        k.platform = platform;
        k.joints = joints;
        k.skeleton = skeleton;
        return k;
    }();
    return kind;
}

}  // namespace palpate
