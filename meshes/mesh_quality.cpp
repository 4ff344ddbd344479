#include "meshes/mesh_quality.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "meshes/plain_numbers.h"

namespace palpate {

using Eigen::Vector3d;

namespace {

Eigen::Map<const Vector3d> node(const TetMesh& m, int i) { return Eigen::Map<const Vector3d>(m.nodes[i].data()); }

double tet_volume(const TetMesh& m, const std::array<int, 4>& t) {
    return (node(m, t[1]) - node(m, t[0])).cross(node(m, t[2]) - node(m, t[0])).dot(node(m, t[3]) - node(m, t[0])) / 6;
}

/// Smallest dihedral angle [degrees] and radius ratio (3 inradius / circumradius) of an element.
std::array<double, 2> element_quality(const TetMesh& m, const std::array<int, 4>& t) {
    Vector3d p[4];
    for (int i = 0; i < 4; ++i) p[i] = node(m, t[i]);
    double smallest = 180, area = 0;
    Vector3d outward[4];
    for (int i = 0; i < 4; ++i) {
        const Vector3d &a = p[(i + 1) % 4], &b = p[(i + 2) % 4], &c = p[(i + 3) % 4];
        Vector3d n = (b - a).cross(c - a);
        if (n.dot(p[i] - a) > 0) n = -n;
        area += 0.5 * n.norm();
        outward[i] = n.normalized();
    }
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < i; ++j)
            smallest = std::min(smallest,
                                180 / std::numbers::pi * std::acos(std::clamp(-outward[i].dot(outward[j]), -1.0, 1.0)));
    const double v = std::abs(tet_volume(m, t)), inradius = 3 * v / area;
    const Vector3d a = p[1] - p[0], b = p[2] - p[0], c = p[3] - p[0];
    const double circumradius =
        (a.squaredNorm() * b.cross(c) + b.squaredNorm() * c.cross(a) + c.squaredNorm() * a.cross(b)).norm() / (12 * v);
    return {smallest, 3 * inradius / circumradius};
}

double median(std::vector<double>& values) {
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    return values[values.size() / 2];
}

}  // namespace

MeshQuality measure_quality(const TetMesh& mesh, bool fixed_too) {
    MeshQuality q;
    if (mesh.tets.empty()) return q;
    std::vector<char> in_bone(mesh.nodes.size(), 0);
    for (const int i : mesh.bone_nodes)
        if (std::size_t(i) < in_bone.size()) in_bone[std::size_t(i)] = 1;  // a list that is wrong is refused elsewhere
    std::vector<double> dihedral, ratio;
    double smallest = 1e300;
    for (const auto& t : mesh.tets) {
        q.volume += tet_volume(mesh, t);
        const bool fixed = std::all_of(t.begin(), t.end(), [&](int i) { return in_bone[std::size_t(i)] != 0; });
        q.fixed += fixed;
        if (fixed && !fixed_too) continue;
        const auto [angle, radius] = element_quality(mesh, t);
        dihedral.push_back(angle);
        ratio.push_back(radius);
        smallest = std::min(smallest, tet_volume(mesh, t));
    }
    if (dihedral.empty()) return q;
    q.worst_dihedral_deg = *std::min_element(dihedral.begin(), dihedral.end());
    q.worst_radius_ratio = *std::min_element(ratio.begin(), ratio.end());
    q.median_dihedral_deg = median(dihedral);
    q.median_radius_ratio = median(ratio);
    q.worst_volume_ratio = smallest / (q.volume / double(mesh.tets.size()));
    return q;
}

std::vector<std::array<int, 3>> boundary(const std::vector<std::array<int, 4>>& tets) {
    std::map<std::array<int, 3>, std::array<int, 3>> faces;  // sorted corners -> oriented, once seen
    for (const auto& t : tets) {
        const int face[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
        for (const auto& f : face) {
            const std::array<int, 3> oriented{t[f[0]], t[f[1]], t[f[2]]};
            std::array<int, 3> key = oriented;
            std::sort(key.begin(), key.end());
            if (!faces.erase(key)) faces[key] = oriented;
        }
    }
    std::vector<std::array<int, 3>> surface;
    for (const auto& [key, f] : faces) surface.push_back(f);
    return surface;
}

std::vector<std::string> check_tets(const TetMesh& m) {
    std::vector<std::string> wrong;
    auto complain = [&](const std::string& what) {
        if (wrong.size() < 5) wrong.push_back(what);
    };
    if (m.tets.empty()) return {"the mesh has no tetrahedra"};
    std::vector<char> used(m.nodes.size(), 0);
    for (std::size_t e = 0; e < m.tets.size(); ++e)
        for (int i : m.tets[e]) {
            if (i < 0 || i >= int(m.nodes.size())) {
                complain("element " + std::to_string(e) + " names node " + std::to_string(i) + " of " +
                         std::to_string(m.nodes.size()));
                return wrong;
            }
            used[i] = 1;
        }
    double total = 0;
    for (std::size_t i = 0; i < m.nodes.size(); ++i) {
        if (!used[i]) complain("node " + std::to_string(i) + " belongs to no element; remove it");
        for (double x : m.nodes[i])
            if (!std::isfinite(x)) return {"node " + std::to_string(i) + " is not finite"};
    }
    for (const auto& t : m.tets) total += std::abs(tet_volume(m, t));
    const double mean = total / double(m.tets.size());
    for (std::size_t e = 0; e < m.tets.size(); ++e) {
        const double v = tet_volume(m, m.tets[e]);
        char text[160];
        if (v <= 1e-9 * mean) {
            plain_snprintf(text, sizeof text,
                           "element %zu is %s: its volume is %.3g of the mean; mesh again with better quality", e,
                           v < 0 ? "inverted" : "flat", v / mean);
            complain(text);
        }
    }
    return wrong;
}

}  // namespace palpate
