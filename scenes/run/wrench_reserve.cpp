#include "scenes/run/wrench_reserve.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "devices/matching/small_systems.h"

namespace palpate {

namespace {

// Of at most six kept components; what is beyond stays zero. Plain loops: Eigen's matrices of such sizes take the
// compiler seconds.
constexpr int most = 6;
using Vector = std::array<double, most>;
using Matrix = std::array<Vector, most>;  // rows

double dot(const Vector& a, const Vector& b) {
    double sum = 0;
    for (int k = 0; k < most; ++k) sum += a[k] * b[k];
    return sum;
}

/// a + s b.
Vector plus(const Vector& a, double s, const Vector& b) {
    Vector sum;
    for (int k = 0; k < most; ++k) sum[k] = a[k] + s * b[k];
    return sum;
}

Vec3<double> along_surface(const Vec3<double>& v, const Vec3<double>& normal) {
    return v - palpate::dot(v, normal) * normal;
}

Vec3<double> unit(const Vec3<double>& v) { return (1 / norm(v)) * v; }

Vec3<double> any_tangent(const Vec3<double>& n) {
    const bool upright = std::max(std::abs(n.x), std::abs(n.y)) < 1e-6 * std::abs(n.z);
    return unit(upright ? Vec3<double>{0, -n.z, n.y} : Vec3<double>{-n.y, n.x, 0});
}

/// A disc of the Minkowski sum: how its sample moves with each kept component, along the surface.
struct Disc {
    double limit;
    std::array<Vec3<double>, most> map;
};

struct Support {
    double value;
    Vector gradient;
    Matrix curvature;
};

/// sum r |A u| - w0 u, with lengths rounded off below `blur`.
Support support(const std::vector<Disc>& discs, const Vector& now, const Vector& u, double blur) {
    Support s{-dot(now, u), plus({}, -1, now), {}};
    for (const Disc& disc : discs) {
        Vec3<double> v{0, 0, 0};
        for (int k = 0; k < most; ++k) v += u[k] * disc.map[k];
        const double length = std::sqrt(palpate::dot(v, v) + blur * blur);
        s.value += disc.limit * length;
        Vector along;
        for (int k = 0; k < most; ++k) along[k] = palpate::dot(v, disc.map[k]) / length;
        s.gradient = plus(s.gradient, disc.limit, along);
        for (int i = 0; i < most; ++i)
            for (int j = 0; j < most; ++j)
                s.curvature[i][j] +=
                    disc.limit / length * (palpate::dot(disc.map[i], disc.map[j]) - along[i] * along[j]);
    }
    return s;
}

/// Vectors that span what is normal to a unit vector among the first `n` components, and how many: those of the
/// Householder reflection that takes it to the first axis.
struct Basis {
    int n;
    std::array<Vector, most - 1> vectors{};

    Basis(const Vector& d, int components) : n(components - 1) {
        Vector v = d;
        v[0] += d[0] < 0 ? -1 : 1;
        for (int k = 0; k < n; ++k) {
            vectors[k][k + 1] = 1;
            vectors[k] = plus(vectors[k], -2 / dot(v, v) * v[k + 1], v);
        }
    }
    /// u + alpha B y.
    Vector moved(Vector u, double alpha, const Coordinates& y) const {
        for (int k = 0; k < n; ++k) u = plus(u, alpha * y[k], vectors[k]);
        return u;
    }
};

/// Least support over directions u with u d = 1: u = d + B y, by Newton steps while lengths are rounded off less and
/// less.
double least_support(const std::vector<Disc>& discs, const Vector& now, const Vector& d, const Basis& B) {
    Vector u = d;
    double least = support(discs, now, u, 0).value;
    for (double blur = 0.3; blur > 1e-7 && B.n > 0; blur *= 0.3)
        for (int k = 0; k < 50; ++k) {
            const Support s = support(discs, now, u, blur);
            least = s.value;
            Coordinates g = Coordinates::Zero(B.n);
            DeviceJacobian H = DeviceJacobian::Zero(B.n, B.n);
            double trace = 0;
            for (int i = 0; i < B.n; ++i) {
                g[i] = dot(B.vectors[i], s.gradient);
                Vector row{};
                for (int j = 0; j < most; ++j) row = plus(row, B.vectors[i][j], s.curvature[j]);
                for (int j = 0; j < B.n; ++j) H(i, j) = dot(row, B.vectors[j]);
                trace += H(i, i);
            }
            if (g.norm() < 1e-10) break;
            for (int i = 0; i < B.n; ++i) H(i, i) += 1e-12 + 1e-9 * trace;
            const SmallCholesky factor(H);
            if (factor.n == 0) break;
            Coordinates step = -g;
            factor.solve(step.data());
            const double slope = g.dot(step);
            double alpha = 1;
            while (alpha > 1e-12 &&
                   support(discs, now, B.moved(u, alpha, step), blur).value > least + 1e-4 * alpha * slope)
                alpha *= 0.5;
            if (alpha <= 1e-12) break;
            u = B.moved(u, alpha, step);
        }
    return least;
}

}  // namespace

double wrench_reserve(const std::vector<GripSample>& samples, const Motion& wrench, const WrenchBasis& kept) {
    double total = 0, size = 1e-6;
    for (const GripSample& s : samples) total += s.friction_limit, size = std::max(size, norm(s.point));
    const int components = int(kept.cols());
    // In units of the whole limit and of the grip's size.
    Vector d{};
    for (int k = 0; k < components; ++k)
        for (int i = 0; i < 6; ++i) d[k] += kept(i, k) * wrench[i] / (i < 3 ? 1 : size);
    const double length = std::sqrt(dot(d, d));
    if (!(total > 0) || !(length > 0)) return 0;
    for (double& x : d) x /= length;
    std::vector<Disc> discs;
    Vector now{};
    for (const GripSample& s : samples) {
        const Vec3<double> n = unit(s.normal), x = (1 / size) * s.point;
        Disc disc{s.friction_limit / total, {}};
        for (int k = 0; k < components; ++k) {
            const Vec3<double> moves{kept(0, k), kept(1, k), kept(2, k)}, turns{kept(3, k), kept(4, k), kept(5, k)};
            disc.map[k] = along_surface(moves + cross(turns, x), n);
            now[k] += palpate::dot(disc.map[k], s.friction) / total;
        }
        discs.push_back(disc);
    }
    return std::max(0.0, least_support(discs, now, d, Basis(d, components)) * total / length);
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
    const Vec3<double> n = unit(normal), a = any_tangent(n), b = cross(n, a);
    WrenchBasis soft_finger = WrenchBasis::Zero(6, 3);
    auto set = [](auto&& column, int from, const Vec3<double>& v) {
        column[from] = v.x, column[from + 1] = v.y, column[from + 2] = v.z;
    };
    set(soft_finger.col(0), 0, a), set(soft_finger.col(1), 0, b), set(soft_finger.col(2), 3, n);
    auto reserve = [&](const Vec3<double>& force, const Vec3<double>& torque) {
        Motion w;
        set(w, 0, force), set(w, 3, torque);
        return wrench_reserve(about, w, soft_finger);
    };
    GripReserve r;
    r.weakest_N = 1e300;
    constexpr int directions = 24;
    for (int k = 0; k < directions; ++k) {
        const double angle = 2 * M_PI * k / directions;
        r.weakest_N = std::min(r.weakest_N, reserve(std::cos(angle) * a + std::sin(angle) * b, {0, 0, 0}));
    }
    const Vec3<double> down = along_surface(load, n);
    if (norm(down) > 1e-9 * norm(load)) r.load_N = reserve(unit(down), {0, 0, 0});
    r.twist_N_mm = 1e3 * std::min(reserve({0, 0, 0}, n), reserve({0, 0, 0}, -1.0 * n));
    return r;
}

}  // namespace palpate
