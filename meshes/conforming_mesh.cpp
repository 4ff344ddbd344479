#include "meshes/conforming_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

#include "meshes/input_error.h"
#include "meshes/mesh_quality.h"
#include "meshes/plain_numbers.h"
#include "meshes/remesh.h"
#include "meshes/smoothstep.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

/// Of the length, at least, that tissue goes on behind the phalanx.
constexpr double tissue_behind = 0.06;
/// Longest edge of the phalanx, of its radius: it stays round in the coarsest mesh.
constexpr double roundest = 1.2;
/// Least tissue between phalanx and skin, of the thickness.
constexpr double tissue_around = 0.03;

struct Frame {
    explicit Frame(const Surface& skin) : box(bounds(skin.vertices)) {}
    std::array<Point, 2> box;
    double length() const { return box[1][0] - box[0][0]; }
    double thickness() const { return box[1][2] - box[0][2]; }
    double along(const Vector3d& x) const { return (x[0] - box[0][0]) / length(); }
    double height(const Vector3d& x) const { return (x[2] - box[0][2]) / thickness(); }
};

Vector3d to_eigen(const Point& p) { return {p[0], p[1], p[2]}; }

/// Coarser towards the back and towards the cut, as a factor of the pad's edges.
double coarseness(const Frame& frame, const Vector3d& x, double most) {
    const double back = smoothstep((frame.height(x) - 0.45) / 0.35),
                 behind = smoothstep((0.30 - frame.along(x)) / 0.30);
    return 1 + (most - 1) * std::max(back, behind);
}

/// Brings the vertices nearest to the nail's edge onto it, along the skin, so that no triangle lies across it.
void conform_to_nail(Surface& mesh, const TriangleTree& skin, double height) {
    std::vector<bool> on_edge(mesh.vertices.size(), false);
    for (const auto& t : mesh.triangles)
        for (int k = 0; k < 3; ++k) {
            const int a = t[k], b = t[(k + 1) % 3];
            const double da = mesh.vertices[a][2] - height, db = mesh.vertices[b][2] - height;
            if (da * db >= 0) continue;
            on_edge[std::abs(da) < std::abs(db) ? a : b] = true;
        }
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
        if (!on_edge[i]) continue;
        Vector3d x = to_eigen(mesh.vertices[i]);
        for (int round = 0; round < 8; ++round) {
            x[2] = height;
            x = skin.nearest(x);
        }
        mesh.vertices[i] = {x[0], x[1], height};
    }
}

/// Whether x lies inside a closed surface: the solid angle of its triangles (van Oosterom & Strackee 1983).
bool is_inside(const Surface& s, const Vector3d& x) {
    double angle = 0;
    for (const auto& t : s.triangles) {
        Vector3d v[3];
        for (int k = 0; k < 3; ++k) v[k] = to_eigen(s.vertices[t[k]]) - x;
        const double a = v[0].norm(), b = v[1].norm(), c = v[2].norm();
        angle += 2 * std::atan2(v[0].cross(v[1]).dot(v[2]),
                                a * b * c + v[0].dot(v[1]) * c + v[1].dot(v[2]) * a + v[2].dot(v[0]) * b);
    }
    return std::abs(angle) > 2 * std::numbers::pi;
}

/// Throws InputError, with the place, where the phalanx is outside of the skin, or comes nearer to it than `least`.
void check_phalanx(const Surface& phalanx, const TriangleTree& skin, double least) {
    for (std::size_t i = 0; i < phalanx.vertices.size(); ++i) {
        const Vector3d x = to_eigen(phalanx.vertices[i]);
        const double distance = (skin.nearest(x) - x).norm();
        const bool outside = (i % 8 == 0 || i + 2 >= phalanx.vertices.size()) && !is_inside(skin.surface(), x);
        if (distance >= least && !outside) continue;
        char text[240];
        plain_snprintf(text, sizeof text,
                       "the phalanx %s at (%.1f, %.1f, %.1f) mm (%.2f mm of tissue needed): make phalanx_radius or "
                       "phalanx_length smaller, or move phalanx_height",
                       outside ? "leaves the skin" : "comes too near to the skin", 1e3 * x[0], 1e3 * x[1], 1e3 * x[2],
                       1e3 * least);
        throw InputError(text);
    }
}

}  // namespace

Surface phalanx_surface(const Surface& skin, const FingerRegions& r) {
    const Frame frame(skin);
    const double radius = r.phalanx_radius * frame.thickness();
    const double from = frame.box[0][0] + std::max(r.cut, tissue_behind) * frame.length() + radius;
    const double to = frame.box[0][0] + r.phalanx_length * frame.length() - radius;
    const Vector3d axis(0, 0.5 * (frame.box[0][1] + frame.box[1][1]),
                        frame.box[0][2] + r.phalanx_height * frame.thickness());
    if (!(radius > 0) || !(to > from))
        throw InputError("the phalanx is too short for its radius: widen phalanx_length, or narrow phalanx_radius");
    constexpr int around = 32, rings = 8, shaft = 16;  // rings of each round end, and of the shaft
    Surface s;
    auto ring = [&](double x, double distance) {
        for (int j = 0; j < around; ++j) {
            const double phi = 2 * std::numbers::pi * j / around;
            s.vertices.push_back({x, axis[1] + distance * std::cos(phi), axis[2] + distance * std::sin(phi)});
        }
    };
    for (int i = 1; i <= rings; ++i) {
        const double a = 0.5 * std::numbers::pi * i / rings;
        ring(from - radius * std::cos(a), radius * std::sin(a));
    }
    for (int i = 1; i < shaft; ++i) ring(from + (to - from) * i / shaft, radius);
    for (int i = rings; i >= 1; --i) {
        const double a = 0.5 * std::numbers::pi * i / rings;
        ring(to + radius * std::cos(a), radius * std::sin(a));
    }
    const int count = int(s.vertices.size()) / around, first = int(s.vertices.size()), last = first + 1;
    s.vertices.push_back({from - radius, axis[1], axis[2]});
    s.vertices.push_back({to + radius, axis[1], axis[2]});
    auto id = [&](int i, int j) { return i * around + j % around; };
    for (int j = 0; j < around; ++j) {
        for (int i = 0; i + 1 < count; ++i) {
            s.triangles.push_back({id(i, j), id(i + 1, j), id(i + 1, j + 1)});
            s.triangles.push_back({id(i, j), id(i + 1, j + 1), id(i, j + 1)});
        }
        s.triangles.push_back({id(count - 1, j), last, id(count - 1, j + 1)});
        s.triangles.push_back({first, id(0, j), id(0, j + 1)});
    }
    if (volume(s) < 0)
        for (auto& t : s.triangles) std::swap(t[1], t[2]);
    return s;
}

FingerRegions fitted_phalanx(const Surface& skin, FingerRegions r) {
    const TriangleTree tree(skin);
    const FingerRegions wanted = r;
    for (int k = 0; k <= 10; ++k) {
        const double share = 1 - 0.05 * k;
        r.phalanx_radius = share * wanted.phalanx_radius;
        r.phalanx_length = wanted.phalanx_length - (1 - share) * 0.3;
        r.cut = wanted.cut + (1 - share) * 0.4;  // an oblique cut
        try {
            check_phalanx(phalanx_surface(skin, r), tree, tissue_around * Frame(skin).thickness());
            return r;
        } catch (const InputError&) {}  // narrower, then
    }
    return wanted;  // whose refusal says where
}

TetMesh conforming_mesh(const Surface& skin, const FingerRegions& regions, const Grading& grading,
                        const TetrahedraliseSettings& settings) {
    if (settings.elements < 20 || settings.elements > 200000)
        throw InputError("the wanted number of elements must be between 20 and 200000, found " +
                         std::to_string(settings.elements));
    if (auto wrong = check_surface(skin); !wrong.empty()) throw InputError(wrong);
    const Frame frame(skin);
    const Surface phalanx = phalanx_surface(skin, regions);
    const TriangleTree skin_tree(skin), phalanx_tree(phalanx);
    Remesher remesh_skin(skin_tree), remesh_phalanx(phalanx_tree);
    check_phalanx(phalanx, skin_tree, tissue_around * frame.thickness());
    const double radius = regions.phalanx_radius * frame.thickness();
    const double nail = frame.box[0][2] + regions.nail * frame.thickness();
    const Point hole{0.5 * (phalanx.vertices[phalanx.vertices.size() - 2][0] + phalanx.vertices.back()[0]),
                     phalanx.vertices.back()[1], phalanx.vertices.back()[2]};

    double edge = std::cbrt(8.49 * (volume(skin) - volume(phalanx)) / settings.elements) / 1.3;
    std::optional<TetMesh> best;
    double best_cost = 1e300;
    std::string last_error = "none was tried";
    for (int k = 0; k < 24; ++k) {
        int count = 0;
        try {
            auto skin_size = [&](const Vector3d& x) { return edge * coarseness(frame, x, grading.coarse); };
            auto bone_size = [&](const Vector3d& x) {
                return std::min(roundest * radius, edge * std::max(grading.bone, coarseness(frame, x, grading.coarse)));
            };
            Surface outer = remesh_skin(skin_size);
            conform_to_nail(outer, skin_tree, nail);
            const Surface inner = remesh_phalanx(bone_size);
            Surface both = outer;
            const int first_inner = int(outer.vertices.size());
            both.vertices.insert(both.vertices.end(), inner.vertices.begin(), inner.vertices.end());
            for (const auto& t : inner.triangles)
                both.triangles.push_back({t[0] + first_inner, t[2] + first_inner, t[1] + first_inner});
            TetMesh mesh = run_tetgen(both, "pYq1.2/15O9/7o/140", settings, {hole});
            count = int(mesh.tets.size());
            if (check_tets(mesh).empty()) {
                mesh.surface = outer.triangles;
                mesh.bone_nodes.clear();
                for (int i = 0; i < int(both.vertices.size()); ++i)
                    if (i >= first_inner || mesh.nodes[i][2] >= nail - 1e-9) mesh.bone_nodes.push_back(i);
                mark_pad(mesh);
                const double off = std::abs(double(count) / settings.elements - 1);
                const double cost = off + 0.2 * std::max(0.0, 20 - measure_quality(mesh).worst_dihedral_deg) / 20;
                if (cost < best_cost) best_cost = cost, best = std::move(mesh);
                if (best_cost < 0.02) break;
            }
        } catch (const InputError& error) { last_error = error.messages.front(); }
        // The count follows the edge's length, but not smoothly: go to where it should be, then look around there.
        const double wanted = count > 0 ? std::cbrt(double(count) / settings.elements) : 1.03;
        const int around = (k + 1) / 2 * (k % 2 ? 1 : -1);  // 1, -1, 2, -2, ...
        edge *= std::abs(wanted - 1) > 0.04 ? wanted : 1 + 0.011 * around;
    }
    if (!best)
        throw InputError(
            "no sound conforming mesh of about " + std::to_string(settings.elements) +
            " elements (it takes some 250; mesh = { kind = \"uniform\", patch = 0 } takes fewer): " + last_error);
    return *best;
}

}  // namespace palpate
