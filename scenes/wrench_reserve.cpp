#include "scenes/wrench_reserve.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

Eigen::Vector3d eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }

/// Motions of a body, with turns scaled to lengths: columns of comparable size.
using Directions = std::vector<Eigen::Matrix<double, 3, 6>>;

struct Support {
    double value;
    Motion gradient;
    MotionMatrix curvature;
};

/// sum r |A u| - w0 u, with lengths rounded off below `blur`.
Support support(const std::vector<GripSample>& samples, const Directions& ways, const Motion& now, const Motion& u,
                double blur) {
    Support s{-now.dot(u), -now, MotionMatrix::Zero()};
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const Eigen::Vector3d v = ways[i] * u;
        const double length = std::sqrt(v.squaredNorm() + blur * blur), r = samples[i].friction_limit;
        s.value += r * length;
        s.gradient += r / length * ways[i].transpose() * v;
        const Eigen::Matrix3d K = Eigen::Matrix3d::Identity() - v * v.transpose() / (length * length);
        s.curvature += r / length * ways[i].transpose() * K * ways[i];
    }
    return s;
}

}  // namespace

double wrench_reserve(const std::vector<GripSample>& samples, const Motion& wrench) {
    double total = 0, size = 1e-6;
    for (const GripSample& s : samples) total += s.friction_limit, size = std::max(size, norm(s.point));
    Motion d = wrench;
    d.tail<3>() /= size;
    const double length = d.norm();
    if (!(total > 0) || !(length > 0)) return 0;
    d /= length;
    // The discs, and the wrench they carry now, in units of the whole limit and of the grip's size.
    Directions ways;
    std::vector<GripSample> scaled = samples;
    Motion now = Motion::Zero();
    for (GripSample& s : scaled) {
        s.friction_limit /= total;
        const Eigen::Vector3d n = eigen(s.normal).normalized(), x = eigen(s.point) / size;
        Eigen::Matrix<double, 3, 6> way;
        way.leftCols<3>().setIdentity();
        way.rightCols<3>() << 0, x[2], -x[1], -x[2], 0, x[0], x[1], -x[0], 0;  // u_t x x
        way = (Eigen::Matrix3d::Identity() - n * n.transpose()) * way;
        now += way.transpose() * eigen(s.friction) / total;
        ways.push_back(way);
    }
    // Least support over directions u with u d = 1: u = d + B y.
    const Eigen::Matrix<double, 6, 6> Q = Eigen::HouseholderQR<Motion>(d).householderQ();
    const Eigen::Matrix<double, 6, 5> B = Q.rightCols<5>();
    Motion u = d;
    double least = 0;
    for (double blur = 0.3; blur > 1e-7; blur *= 0.3)
        for (int k = 0; k < 50; ++k) {
            const Support s = support(scaled, ways, now, u, blur);
            least = s.value;
            const Eigen::Matrix<double, 5, 1> g = B.transpose() * s.gradient;
            if (g.norm() < 1e-10) break;
            Eigen::Matrix<double, 5, 5> H = B.transpose() * s.curvature * B;
            H.diagonal().array() += 1e-12 + 1e-9 * H.trace();
            const Eigen::Matrix<double, 5, 1> step = -H.ldlt().solve(g);
            double alpha = 1;
            auto there = [&] { return Motion(u + alpha * (B * step)); };
            while (alpha > 1e-12 &&
                   support(scaled, ways, now, there(), blur).value > least + 1e-4 * alpha * g.dot(step))
                alpha *= 0.5;
            if (alpha <= 1e-12) break;
            u = there();
        }
    return std::max(0.0, least * total / length);
}

GripReserve grip_reserve(const std::vector<GripSample>& samples, const Vec3<double>& load) {
    double total = 0;
    Vec3<double> middle{0, 0, 0}, normal{0, 0, 0};
    for (const GripSample& s : samples) {
        total += s.friction_limit;
        middle += s.friction_limit * s.point;
        normal += s.friction_limit * s.normal;
    }
    if (!(total > 0) || !(norm(normal) > 1e-9 * total)) return {};
    std::vector<GripSample> about = samples;
    for (GripSample& s : about) s.point -= (1 / total) * middle;
    const Eigen::Vector3d n = eigen(normal).normalized();
    const Eigen::Vector3d a = n.unitOrthogonal(), b = n.cross(a);
    auto reserve = [&](const Eigen::Vector3d& force, const Eigen::Vector3d& torque) {
        Motion w;
        w << force, torque;
        return wrench_reserve(about, w);
    };
    GripReserve r;
    r.weakest_N = 1e300;
    constexpr int directions = 24;
    for (int k = 0; k < directions; ++k) {
        const double angle = 2 * M_PI * k / directions;
        r.weakest_N = std::min(r.weakest_N, reserve(std::cos(angle) * a + std::sin(angle) * b, {0, 0, 0}));
    }
    const Eigen::Vector3d down = eigen(load) - eigen(load).dot(n) * n;
    if (down.norm() > 1e-9 * eigen(load).norm()) r.load_N = reserve(down.normalized(), {0, 0, 0});
    r.twist_N_mm = 1e3 * std::min(reserve({0, 0, 0}, n), reserve({0, 0, 0}, -n));
    return r;
}

}  // namespace palpate
