// The 3-RRS thimble of Chinello et al., with the kinematics of Perez et al. 2017, Eqs. 6-13, as written
// there. Configuration w = (theta, psi, dz): pitch about y, roll about x, height of the platform.

#include <cmath>

#include "devices/kinds/rrs_geometry.h"

namespace palpate {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

using namespace rrs;

/// Rotation R = Rx(psi) Ry(theta) Rz(phi); the yaw phi is what the three legs leave (Eq. 7).
struct Rotation {
    Matrix3d R, dtheta, dpsi;
};

Rotation rotation(double theta, double psi) {
    const double ct = std::cos(theta), st = std::sin(theta), cp = std::cos(psi), sp = std::sin(psi);
    const double N = -sp * st, D = ct + cp;  // tan(phi) = N / D
    const double phi = std::atan2(N, D), r2 = N * N + D * D;
    const double phi_theta = (D * (-sp * ct) - N * (-st)) / r2, phi_psi = (D * (-cp * st) - N * (-sp)) / r2;
    const double cf = std::cos(phi), sf = std::sin(phi);
    Matrix3d X, dX, Y, dY, Z, dZ;
    X << 1, 0, 0, 0, cp, -sp, 0, sp, cp;
    dX << 0, 0, 0, 0, -sp, -cp, 0, cp, -sp;
    Y << ct, 0, st, 0, 1, 0, -st, 0, ct;
    dY << -st, 0, ct, 0, 0, 0, -ct, 0, -st;
    Z << cf, -sf, 0, sf, cf, 0, 0, 0, 1;
    dZ << -sf, -cf, 0, cf, -sf, 0, 0, 0, 0;
    return {X * Y * Z, X * dY * Z + X * Y * dZ * phi_theta, dX * Y * Z + X * Y * dZ * phi_psi};
}

/// Eq. 6: the platform moves sideways as it tilts; p = (b (R11 - R22) / 2, -b R21, dz).
Platform platform(const DeviceModel& model, const Coordinates& w) {
    const double b = model.geometry[mobile_radius];
    const Rotation r = rotation(w[0], w[1]);
    auto sideways = [&](const Matrix3d& R) { return Vector3d(0.5 * b * (R(0, 0) - R(1, 1)), -b * R(1, 0), 0); };
    Platform p;
    p.rotation = r.R;
    p.centre = sideways(r.R) + Vector3d(0, 0, w[2]);
    p.normal = -r.R.col(2);
    p.dcentre.resize(3, 3);
    p.dcentre << sideways(r.dtheta), sideways(r.dpsi), Vector3d::UnitZ();
    p.dnormal.resize(3, 3);
    p.dnormal << -r.dtheta.col(2), -r.dpsi.col(2), Vector3d::Zero();
    return p;
}

/// Eqs. 10-13: q_i = beta_i - gamma_i, beta the angle between A_i and the leg's chord d = B_i - A_i,
/// gamma by the law of cosines in the triangle of crank, link and chord.
Joints joints(const DeviceModel& model, const Coordinates& w) {
    const Platform p = platform(model, w);
    const Rotation r = rotation(w[0], w[1]);
    Joints out;
    out.q.resize(3);
    out.dq.resize(3, 3);
    for (int leg = 0; leg < 3; ++leg) {
        const Vector3d A = fixed_seat(model, leg), B = mobile_seat(model, leg);
        const Vector3d d = p.centre + r.R * B - A;
        Eigen::Matrix3d dd = p.dcentre;  // derivative of d
        dd.col(0) += r.dtheta * B;
        dd.col(1) += r.dpsi * B;
        const double length = d.norm(), a = A.norm();
        const double cos_beta = A.dot(d) / (a * length);
        const Arc beta = extended_acos(cos_beta);
        const ChordAngle gamma = chord_angle(model, length);
        out.closed = out.closed && gamma.closed;
        out.q[leg] = beta.value - gamma.value;
        const Vector3d dcos_beta = A / (a * length) - cos_beta / (length * length) * d;
        out.dq.row(leg) = (beta.slope * dcos_beta - gamma.slope / length * d).transpose() * dd;
    }
    return out;
}

/// Cranks stand in the plane of their seat's direction and their chord, by which Eq. 11 measures them.
Skeleton skeleton(const DeviceModel& m, const Coordinates& w) {
    const Platform p = platform(m, w);
    const Joints j = joints(m, w);
    Skeleton lines(2);
    for (int leg = 0; leg < 3; ++leg) {
        const Vector3d A = fixed_seat(m, leg), B = p.centre + p.rotation * mobile_seat(m, leg), a = A.normalized(),
                       d = B - A;
        const Vector3d up = (d - a.dot(d) * a).normalized();
        lines.push_back({A, A + m.geometry[crank] * (std::cos(j.q[leg]) * a + std::sin(j.q[leg]) * up), B});
        lines[0].push_back(A), lines[1].push_back(B);
    }
    lines[0].push_back(lines[0][0]), lines[1].push_back(lines[1][0]);
    return lines;
}

DeviceModel defaults() {
    DeviceModel m;
    m.kind = find_kind("chinello-3rrs");
    m.geometry = {0.015, 0.005, 0.020, 0.0105, 0.010, 0.025};
    m.joint_min = Coordinates::Constant(3, -35.139 * degree);
    m.joint_max = Coordinates::Constant(3, 37.771 * degree);
    m.rest = Eigen::Vector3d(0, 0, 0.0290);
    // Above the nail, z towards the pad; the pad of a 14 mm finger (z = -8.4 mm) lies at dz = 24.6 mm.
    // The platform reaches to its joints: disk radius = mobile radius (the paper does not give it).
    m.mount = mount_above_nail();
    return m;
}

}  // namespace

const DeviceKind& chinello_3rrs() {
    static const DeviceKind kind = [] {
        DeviceKind k;
        k.name = "chinello-3rrs";
        k.configuration_names = {"theta", "psi", "dz"};
        k.configuration_is_length = {false, false, true};
        k.geometry_names = {"fixed_radius", "fixed_half", "mobile_radius", "mobile_half", "crank", "link"};
        k.joint_count = 3;
        k.configuration_min = Eigen::Vector3d(-60 * degree, -60 * degree, 0.005);
        k.configuration_max = Eigen::Vector3d(60 * degree, 60 * degree, 0.045);
        k.configuration_scale = Eigen::Vector3d(0.3, 0.3, 0.004);
        k.defaults = defaults;
        k.platform = platform;
        k.joints = joints;
        k.skeleton = skeleton;
        return k;
    }();
    return kind;
}

}  // namespace palpate
