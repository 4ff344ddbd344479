#include "scenes/run/wrench_reserve.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "devices/matching/small_systems.h"

namespace palpate {

namespace {

Eigen::Vector3d eigen(const Vec3<double>& v) { return {v.x, v.y, v.z}; }

// Of at most six components: products are plain loops, not Eigen's for large matrices.
using Vector = Coordinates;
using Matrix = DeviceJacobian;

/// A disc of the Minkowski sum: how its sample moves with the kept components.
struct Disc {
    double limit;
    PointJacobian map;
};

struct Support {
    double value;
    Vector gradient;
    Matrix curvature;
};

/// sum r |A u| - w0 u, with lengths rounded off below `blur`.
Support support(const std::vector<Disc>& discs, const Vector& now, const Vector& u, double blur) {
    Support s{-now.dot(u), -now, Matrix::Zero(u.size(), u.size())};
    for (const Disc& disc : discs) {
        const Eigen::Vector3d v = disc.map.lazyProduct(u);
        const double length = std::sqrt(v.squaredNorm() + blur * blur);
        s.value += disc.limit * length;
        s.gradient += disc.limit / length * disc.map.transpose().lazyProduct(v);
        const Eigen::Matrix3d K = Eigen::Matrix3d::Identity() - v * v.transpose() / (length * length);
        const PointJacobian turned = K.lazyProduct(disc.map);
        s.curvature += disc.limit / length * disc.map.transpose().lazyProduct(turned);
    }
    return s;
}

/// Columns that span what is normal to a unit vector: those of the Householder reflection that takes it to the first
/// axis.
Matrix normal_to(const Vector& d) {
    Vector v = d;
    v[0] += d[0] < 0 ? -1 : 1;
    const Matrix reflection =
        Matrix::Identity(d.size(), d.size()) - (2 / v.squaredNorm() * v).lazyProduct(v.transpose());
    return reflection.rightCols(d.size() - 1);
}

}  // namespace

double wrench_reserve(const std::vector<GripSample>& samples, const Motion& wrench, const WrenchBasis& kept) {
    double total = 0, size = 1e-6;
    for (const GripSample& s : samples) total += s.friction_limit, size = std::max(size, norm(s.point));
    // In units of the whole limit and of the grip's size.
    Motion scale;
    scale << 1, 1, 1, 1 / size, 1 / size, 1 / size;
    Vector d = kept.transpose().lazyProduct(scale.cwiseProduct(wrench));
    const double length = d.norm();
    if (!(total > 0) || !(length > 0)) return 0;
    d /= length;
    std::vector<Disc> discs;
    Vector now = Vector::Zero(kept.cols());
    for (const GripSample& s : samples) {
        const Eigen::Vector3d n = eigen(s.normal).normalized(), x = eigen(s.point) / size;
        Eigen::Matrix<double, 3, 6> map;
        map.leftCols<3>().setIdentity();
        map.rightCols<3>() << 0, x[2], -x[1], -x[2], 0, x[0], x[1], -x[0], 0;  // turning moves the sample by turn x x
        discs.push_back(
            {s.friction_limit / total, ((Eigen::Matrix3d::Identity() - n * n.transpose()) * map).lazyProduct(kept)});
        now += discs.back().map.transpose().lazyProduct(eigen(s.friction)) / total;
    }
    // Least support over directions u with u d = 1: u = d + B y.
    const Matrix B = normal_to(d);
    Vector u = d;
    double least = support(discs, now, u, 0).value;
    for (double blur = 0.3; blur > 1e-7 && B.cols() > 0; blur *= 0.3)
        for (int k = 0; k < 50; ++k) {
            const Support s = support(discs, now, u, blur);
            least = s.value;
            const Vector g = B.transpose().lazyProduct(s.gradient);
            if (g.norm() < 1e-10) break;
            const Matrix curved = s.curvature.lazyProduct(B);
            Matrix H = B.transpose().lazyProduct(curved);
            H.diagonal().array() += 1e-12 + 1e-9 * H.trace();
            const SmallCholesky factor(H);
            if (factor.n == 0) break;
            Vector step = -g;
            factor.solve(step.data());
            double alpha = 1;
            auto there = [&] { return Vector(u + alpha * B.lazyProduct(step)); };
            while (alpha > 1e-12 && support(discs, now, there(), blur).value > least + 1e-4 * alpha * g.dot(step))
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
    WrenchBasis soft_finger = WrenchBasis::Zero(6, 3);
    soft_finger.block<3, 1>(0, 0) = a, soft_finger.block<3, 1>(0, 1) = b, soft_finger.block<3, 1>(3, 2) = n;
    auto reserve = [&](const Eigen::Vector3d& force, const Eigen::Vector3d& torque) {
        Motion w;
        w << force, torque;
        return wrench_reserve(about, w, soft_finger);
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
