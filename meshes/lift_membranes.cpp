#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <Eigen/LU>

#include "meshes/layers.h"
#include "meshes/triangle_tree.h"

namespace palpate {

namespace {

Eigen::Vector3d at(const TetMesh& mesh, int node) {
    return Eigen::Map<const Eigen::Vector3d>(mesh.nodes[std::size_t(node)].data());
}

/// The skin that can touch, as in layer_shares().
Surface touchable_skin(const TetMesh& mesh) {
    const std::set<int> pad(mesh.pad_nodes.begin(), mesh.pad_nodes.end());
    Surface skin{mesh.nodes, {}};
    for (const auto& t : mesh.surface)
        if (pad.count(t[0]) || pad.count(t[1]) || pad.count(t[2])) skin.triangles.push_back(t);
    return skin;
}

/// Which element has each of the triangles.
std::vector<std::size_t> owners(const TetMesh& mesh, const Surface& skin) {
    std::map<std::array<int, 3>, std::size_t> element;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        for (std::size_t f = 0; f < 4; ++f) {
            const auto& tet = mesh.tets[e];
            std::array<int, 3> face{tet[(f + 1) % 4], tet[(f + 2) % 4], tet[(f + 3) % 4]};
            std::sort(face.begin(), face.end());
            element[face] = e;
        }
    std::vector<std::size_t> out;
    for (auto face : skin.triangles) {
        std::sort(face.begin(), face.end());
        out.push_back(element.at(face));
    }
    return out;
}

struct Tetrahedron {
    double volume;
    Eigen::Vector3d centre;
    double depth, depth_squared;  ///< at which it stretches along the skin: means over all directions there
};

/// A stretch along the skin that changes with depth d, u = (t . x) d for a tangent t, is in a linear tetrahedron the
/// stretch sum_a (t . grad N_a) (t . x_a) d_a = t . Z t: one depth's.
Tetrahedron tetrahedron(const TetMesh& mesh, std::size_t e, const Point& normal, const std::vector<double>& depth) {
    const auto& tet = mesh.tets[e];
    Eigen::Matrix3d edges;
    for (int a = 0; a < 3; ++a) edges.col(a) = at(mesh, tet[std::size_t(a + 1)]) - at(mesh, tet[0]);
    Tetrahedron out{edges.determinant() / 6, at(mesh, tet[0]) + edges.rowwise().sum() / 4, 0, 0};
    Eigen::Matrix<double, 4, 3> slopes;
    slopes.bottomRows<3>() = edges.inverse();
    slopes.row(0) = -slopes.bottomRows<3>().colwise().sum();
    const Eigen::Vector3d n(normal[0], normal[1], normal[2]);
    Eigen::Matrix<double, 3, 2> tangents;
    tangents.col(0) = n.unitOrthogonal();
    tangents.col(1) = n.cross(tangents.col(0));
    Eigen::Matrix2d Z = Eigen::Matrix2d::Zero();
    for (int a = 0; a < 4; ++a) {
        const int node = tet[std::size_t(a)];
        const Eigen::Vector2d slope = (slopes.row(a) * tangents).transpose();
        const Eigen::Vector2d arm = tangents.transpose() * (at(mesh, node) - out.centre);
        Z += depth[std::size_t(node)] / 2 * (slope * arm.transpose() + arm * slope.transpose());
    }
    out.depth = Z.trace() / 2;
    out.depth_squared = ((Z * Z).trace() * 2 + Z.trace() * Z.trace()) / 8;
    return out;
}

/// Moments of depth of what is stiff along the skin: of what stays where it is, and of what can be lifted.
struct Moments {
    double all = 0, first = 0, second = 0, lifted_first = 0, lifted_second = 0;

    void add(const Moments& o, double share) {
        all += share * o.all, first += share * o.first, second += share * o.second;
        lifted_first += share * o.lifted_first, lifted_second += share * o.lifted_second;
    }
    double variance(double kept) const {
        const double mean = (first + kept * lifted_first) / all;
        return (second + kept * lifted_second) / all - mean * mean;
    }
    /// The share of what can be lifted that stays.
    double kept(double variance_of_layers) const {
        if (!(all > 0) || variance(1) <= variance_of_layers) return 1;
        if (variance(0) >= variance_of_layers) return 0;
        double low = 0, high = 1;
        for (int i = 0; i < 50; ++i) {
            const double middle = (low + high) / 2;
            (variance(middle) > variance_of_layers ? high : low) = middle;
        }
        return low;
    }
};

}  // namespace

SkinExcess skin_excess(const std::vector<std::vector<double>>& shares, const std::vector<double>& thicknesses,
                       const std::vector<double>& moduli, double below) {
    SkinExcess out{std::vector(shares.size(), 0.0), 0};
    double all = 0, first = 0, second = 0, top = 0;
    for (std::size_t k = 0; k < moduli.size(); ++k) {
        const double over = std::max(0.0, moduli[k] - below), bottom = top + thicknesses[k];
        for (std::size_t e = 0; e < shares.size(); ++e) out.of_element[e] += shares[e][k] * over;
        all += over * (bottom - top);
        first += over * (bottom * bottom - top * top) / 2;
        second += over * (bottom * bottom * bottom - top * top * top) / 3;
        top = bottom;
    }
    if (all > 0) out.variance = second / all - first / all * first / all;
    return out;
}

void lift_membranes(const TetMesh& mesh, const std::vector<Point>& normals, const SkinExcess& excess,
                    std::vector<double>& membranes) {
    const Surface skin = touchable_skin(mesh);
    if (skin.triangles.empty() || std::all_of(membranes.begin(), membranes.end(), [](double m) { return m <= 0; }))
        return;
    const TriangleTree tree(skin);
    std::vector<double> depth(mesh.nodes.size(), 0.0);
    for (std::size_t i = 0; i < depth.size(); ++i)
        depth[i] = (tree.nearest(at(mesh, int(i))) - at(mesh, int(i))).norm();

    const std::vector<std::size_t> owner = owners(mesh, skin);
    std::vector<bool> in_skin(mesh.tets.size(), false);
    for (std::size_t e : owner) in_skin[e] = true;
    std::vector<Tetrahedron> tets;
    std::vector<int> triangle(mesh.tets.size(), 0);  // nearest
    std::vector<Moments> own(mesh.nodes.size());
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        tets.push_back(tetrahedron(mesh, e, normals[e], depth));
        if (excess.of_element[e] <= 0) continue;
        triangle[e] = tree.nearest_triangle(tets[e].centre);
        const double d = tets[e].depth, square = tets[e].depth_squared;
        const double stiffness = tets[e].volume * excess.of_element[e];
        const double lifted = in_skin[e] ? 0 : tets[e].volume * std::min(membranes[e], excess.of_element[e]);
        const Moments m{stiffness, (stiffness - lifted) * d, (stiffness - lifted) * square, lifted * d,
                        lifted * square};
        for (int node : skin.triangles[std::size_t(triangle[e])]) own[std::size_t(node)].add(m, 1.0 / 3);
    }
    std::vector<Moments> around(mesh.nodes.size());
    std::vector<std::vector<std::size_t>> faces(mesh.nodes.size());
    for (std::size_t t = 0; t < skin.triangles.size(); ++t) {
        Moments sum;
        for (int node : skin.triangles[t]) sum.add(own[std::size_t(node)], 1);
        for (int node : skin.triangles[t]) {
            around[std::size_t(node)].add(sum, 1);
            faces[std::size_t(node)].push_back(t);
        }
    }
    std::vector<double> moved(mesh.tets.size(), 0.0);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        if (in_skin[e] || excess.of_element[e] <= 0 || membranes[e] <= 0) continue;
        double kept = 0;
        std::set<std::size_t> to;
        for (int node : skin.triangles[std::size_t(triangle[e])]) {
            kept += around[std::size_t(node)].kept(excess.variance) / 3;
            for (std::size_t t : faces[std::size_t(node)]) to.insert(owner[t]);
        }
        const double amount = (1 - kept) * membranes[e] * tets[e].volume;
        membranes[e] *= kept;
        for (std::size_t o : to) moved[o] += amount / double(to.size());
    }
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        if (moved[e] > 0) membranes[e] += moved[e] / tets[e].volume;
}

}  // namespace palpate
