#include "meshes/object_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "meshes/input_error.h"
#include "meshes/mesh_quality.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

Vector3d eigen(const Point& p) { return {p[0], p[1], p[2]}; }
Point point(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

int parts_of(double length, double edge, int least) { return std::max(least, int(std::lround(length / edge))); }

}  // namespace

Surface box_surface(const Point& half, double edge) {
    std::array<int, 3> n;
    for (std::size_t d = 0; d < 3; ++d) n[d] = parts_of(2 * half[d], edge, 1);
    Surface out;
    std::map<std::array<int, 3>, int> numbers;
    auto vertex = [&](const std::array<int, 3>& at) {
        const auto [it, fresh] = numbers.emplace(at, int(out.vertices.size()));
        if (fresh) {
            Point p;
            for (std::size_t d = 0; d < 3; ++d) p[d] = half[d] * (2.0 * at[d] / n[d] - 1);
            out.vertices.push_back(p);
        }
        return it->second;
    };
    for (std::size_t d = 0; d < 3; ++d)
        for (const bool high : {false, true}) {
            const std::size_t u = (d + 1) % 3, v = (d + 2) % 3;
            for (int i = 0; i < n[u]; ++i)
                for (int j = 0; j < n[v]; ++j) {
                    auto corner = [&](int a, int b) {
                        std::array<int, 3> at;
                        at[d] = high ? n[d] : 0, at[u] = i + a, at[v] = j + b;
                        return vertex(at);
                    };
                    const int q[4] = {corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)};
                    const int first = (i + j) % 2;  // diagonals by turns
                    for (int k : {first, first + 2}) {
                        std::array<int, 3> t{q[k % 4], q[(k + 1) % 4], q[(k + 2) % 4]};
                        if (!high) std::swap(t[1], t[2]);
                        out.triangles.push_back(t);
                    }
                }
        }
    return out;
}

Surface cylinder_surface(double radius, double half_length, double edge) {
    const int rings = parts_of(radius, edge, 2), around = 6 * rings, layers = parts_of(2 * half_length, edge, 1);
    Surface out;
    auto ring = [&](double r, double z, int count) {
        const int first = int(out.vertices.size());
        for (int k = 0; k < count; ++k) {
            const double angle = 2 * std::numbers::pi * k / count;
            out.vertices.push_back({r * std::cos(angle), r * std::sin(angle), z});
        }
        return first;
    };
    std::vector<int> side;
    for (int k = 0; k <= layers; ++k) side.push_back(ring(radius, half_length * (2.0 * k / layers - 1), around));
    for (int l = 0; l < layers; ++l)
        for (int k = 0; k < around; ++k) {
            const int next = (k + 1) % around, a = side[std::size_t(l)], b = side[std::size_t(l) + 1];
            out.triangles.push_back({a + k, a + next, b + next});
            out.triangles.push_back({a + k, b + next, b + k});
        }
    for (const bool top : {false, true}) {
        const double z = top ? half_length : -half_length;
        auto add = [&](int a, int b, int c) {
            out.triangles.push_back(top ? std::array<int, 3>{a, b, c} : std::array<int, 3>{a, c, b});
        };
        int inner = int(out.vertices.size());
        out.vertices.push_back({0, 0, z});
        for (int r = 1; r <= rings; ++r) {
            const int outer = r == rings ? (top ? side.back() : side.front()) : ring(radius * r / rings, z, 6 * r);
            const int few = 6 * (r - 1), many = 6 * r;
            for (int sector = 0; sector < 6; ++sector)
                for (int k = 0; k < r; ++k) {
                    const int o = sector * r + k, i = few == 0 ? 0 : (sector * (r - 1) + k) % few;
                    add(inner + i, outer + o, outer + (o + 1) % many);
                    if (k + 1 < r) add(inner + i, outer + (o + 1) % many, inner + (i + 1) % few);
                }
            inner = outer;
        }
    }
    return out;
}

namespace {

/// A ball of triangles of about one size: an icosahedron, each of whose faces is cut into n x n.
Surface ball(int n) {
    const double g = 0.5 * (1 + std::sqrt(5.0));
    const std::array<Point, 12> corners{{{-1, g, 0},
                                         {1, g, 0},
                                         {-1, -g, 0},
                                         {1, -g, 0},
                                         {0, -1, g},
                                         {0, 1, g},
                                         {0, -1, -g},
                                         {0, 1, -g},
                                         {g, 0, -1},
                                         {g, 0, 1},
                                         {-g, 0, -1},
                                         {-g, 0, 1}}};
    const std::array<std::array<int, 3>, 20> faces{{{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}}};
    Surface out;
    std::map<std::array<std::array<int, 2>, 3>, int> numbers;  // by shares of corners, in the corners' order
    for (const auto& f : faces) {
        auto vertex = [&](int i, int j) {
            std::array<std::array<int, 2>, 3> key{{{f[0], n - i - j}, {f[1], i}, {f[2], j}}};
            Vector3d x = Vector3d::Zero();
            std::sort(key.begin(), key.end());
            for (auto& [corner, share] : key) {
                x += share * eigen(corners[std::size_t(corner)]);
                if (share == 0) corner = -1;
            }
            std::sort(key.begin(), key.end());
            const auto [it, fresh] = numbers.emplace(key, int(out.vertices.size()));
            if (fresh) out.vertices.push_back(point(x.normalized()));
            return it->second;
        };
        for (int i = 0; i < n; ++i)
            for (int j = 0; i + j < n; ++j) {
                out.triangles.push_back({vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)});
                if (i + j + 1 < n) out.triangles.push_back({vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)});
            }
    }
    return out;
}

/// A ball whose halves were pulled apart, around rings of triangles.
Surface pulled_apart(double radius, double half_length, double edge) {
    const int quarter = parts_of(0.5 * std::numbers::pi * radius, edge, 2), around = 4 * quarter,
              layers = parts_of(2 * half_length, edge, 1);
    Surface out;
    std::vector<int> rings;
    auto ring = [&](double r, double z) {
        rings.push_back(int(out.vertices.size()));
        const double turn = rings.size() % 2 ? 0.0 : 0.5;
        for (int k = 0; k < around; ++k) {
            const double angle = 2 * std::numbers::pi * (k + turn) / around;
            out.vertices.push_back({r * std::cos(angle), r * std::sin(angle), z});
        }
    };
    for (int k = 1; k <= quarter; ++k) {
        const double a = 0.5 * std::numbers::pi * k / quarter;
        ring(radius * std::sin(a), -half_length - radius * std::cos(a));
    }
    for (int k = 1; k <= layers; ++k) ring(radius, half_length * (2.0 * k / layers - 1));
    for (int k = quarter - 1; k > 0; --k) {
        const double a = 0.5 * std::numbers::pi * k / quarter;
        ring(radius * std::sin(a), half_length + radius * std::cos(a));
    }
    const int low = int(out.vertices.size()), high = low + 1;
    out.vertices.push_back({0, 0, -half_length - radius});
    out.vertices.push_back({0, 0, half_length + radius});
    for (int k = 0; k < around; ++k) {
        const int next = (k + 1) % around;
        out.triangles.push_back({low, rings.front() + next, rings.front() + k});
        out.triangles.push_back({high, rings.back() + k, rings.back() + next});
        for (std::size_t r = 0; r + 1 < rings.size(); ++r) {
            const int a = rings[r], b = rings[r + 1];
            if (r % 2 == 0) {
                out.triangles.push_back({a + k, a + next, b + k});
                out.triangles.push_back({a + next, b + next, b + k});
            } else {
                out.triangles.push_back({a + k, b + next, b + k});
                out.triangles.push_back({a + k, a + next, b + next});
            }
        }
    }
    return out;
}

}  // namespace

Surface capsule_surface(double radius, double half_length, double edge) {
    Surface out = half_length > 0 ? pulled_apart(radius, half_length, edge)
                                  : ball(std::max(2, int(std::lround(1.1 * radius / edge))));
    const double smooth = half_length > 0 ? std::numbers::pi * radius * radius * (4.0 / 3 * radius + 2 * half_length)
                                          : 4.0 / 3 * std::numbers::pi * radius * radius * radius;
    const double scale = std::cbrt(smooth / volume(out));
    for (Point& p : out.vertices)
        for (double& x : p) x *= scale;
    return out;
}

namespace {

void append(Surface& to, const Surface& from, const Point& moved) {
    const int first = int(to.vertices.size());
    for (const Point& p : from.vertices) to.vertices.push_back({p[0] + moved[0], p[1] + moved[1], p[2] + moved[2]});
    for (const auto& t : from.triangles) to.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

/// Whether x lies inside a closed surface around `centre` that is seen whole from there.
bool inside_ball(const Surface& ball, const Point& centre, const Vector3d& x) {
    const Vector3d local = x - eigen(centre);
    for (const auto& t : ball.triangles) {
        const Vector3d a = eigen(ball.vertices[std::size_t(t[0])]), b = eigen(ball.vertices[std::size_t(t[1])]),
                       c = eigen(ball.vertices[std::size_t(t[2])]);
        if ((b - a).cross(c - a).dot(local - a) > 0) return false;  // an icosahedron's ball is convex
    }
    return true;
}

ObjectMesh fill(const Surface& outer, double edge, const std::vector<Inclusion>& inclusions,
                const TetrahedraliseSettings& settings) {
    Surface all = outer;
    std::vector<Surface> balls;
    for (const Inclusion& i : inclusions) {
        balls.push_back(capsule_surface(i.radius, 0, edge));
        append(all, balls.back(), i.centre);
    }
    ObjectMesh out;
    char switches[64];  // inside, elements are no larger than at the surface
    plain_snprintf(switches, sizeof switches, "pYq1.2/15a%.6eO9/7o/140", 0.25 * edge * edge * edge);
    out.mesh = run_tetgen(all, switches, settings, {}, inclusions.empty() ? SurfaceUse::finger : SurfaceUse::object);
    if (const auto wrong = check_tets(out.mesh); !wrong.empty()) throw InputError(wrong);
    for (const auto& t : out.mesh.tets) {
        Vector3d middle = Vector3d::Zero();
        for (int node : t) middle += 0.25 * eigen(out.mesh.nodes[std::size_t(node)]);
        int in = -1;
        for (std::size_t k = 0; k < balls.size(); ++k)
            if (inside_ball(balls[k], inclusions[k].centre, middle)) in = int(k);
        out.inclusion.push_back(in);
    }
    return out;
}

}  // namespace

ObjectMesh mesh_object(const SurfaceOfSize& surface, double volume, const std::vector<Inclusion>& inclusions,
                       const TetrahedraliseSettings& settings) {
    const double estimate = std::cbrt(8.49 * volume / settings.elements);
    std::optional<ObjectMesh> best;
    double best_cost = 1e300;
    std::string last_error;
    // Surfaces of whole numbers of edges: the count changes by leaps, so look on both sides.
    for (int k = 0; k < 13 && best_cost > 0.08; ++k) {
        const int side = k % 2 ? 1 : -1, leaps = (k + 1) / 2;
        const double edge = estimate * (1.05 + 0.04 * leaps * side);
        try {
            ObjectMesh filled = fill(surface(edge), edge, inclusions, settings);
            const double off = std::abs(double(filled.mesh.tets.size()) / settings.elements - 1);
            const double cost = off + 0.2 * std::max(0.0, 15 - measure_quality(filled.mesh).worst_dihedral_deg) / 15;
            if (cost < best_cost) best_cost = cost, best = std::move(filled);
        } catch (const InputError& error) { last_error = error.messages.front(); }
    }
    if (!best)
        throw InputError("no sound mesh of about " + std::to_string(settings.elements) + " elements: " + last_error);
    best->mesh.surface = boundary(best->mesh.tets);
    return *best;
}

}  // namespace palpate
