#include "meshes/curved_skin.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

namespace palpate {

namespace {

using Eigen::Vector3d;

/// Cosine between normals of triangles beyond which the skin has an edge, as at the cut end.
constexpr double edge = 0.35;
/// Points along each side of a triangle at which its patch is looked at.
constexpr int points = 8;

/// Height along a direction of a cubic triangle's control points, and at weights.
struct CurvedTriangle {
    double corner[3], side[3][2], middle;  // side k: from corner k to the next, near the one and near the other

    CurvedTriangle(const Vector3d x[3], const Vector3d normal[3], const Vector3d& along) {
        double sides = 0, corners = 0;
        for (int k = 0; k < 3; ++k) {
            const int next = (k + 1) % 3;
            const Vector3d d = x[next] - x[k];
            corner[k] = x[k].dot(along);
            side[k][0] = along.dot(x[k] + (d - d.dot(normal[k]) * normal[k]) / 3);
            side[k][1] = along.dot(x[next] - (d - d.dot(normal[next]) * normal[next]) / 3);
            sides += (side[k][0] + side[k][1]) / 6;
            corners += corner[k] / 3;
        }
        middle = sides + (sides - corners) / 2;
    }
    double at(const double w[3]) const {
        double sum = 6 * middle * w[0] * w[1] * w[2];
        for (int k = 0; k < 3; ++k) {
            const int next = (k + 1) % 3;
            sum += corner[k] * w[k] * w[k] * w[k] + 3 * w[k] * w[next] * (side[k][0] * w[k] + side[k][1] * w[next]);
        }
        return sum;
    }
};

}  // namespace

double reach_of_curved_skin(const TetMesh& mesh, const Point& direction) {
    const Vector3d along(direction[0], direction[1], direction[2]);
    const auto node = [&](int i) { return Vector3d(Eigen::Map<const Vector3d>(mesh.nodes[std::size_t(i)].data())); };
    std::vector<std::vector<int>> around(mesh.nodes.size());  // triangles of each node
    std::vector<Vector3d> normal;
    for (std::size_t t = 0; t < mesh.surface.size(); ++t) {
        const auto& f = mesh.surface[t];
        normal.push_back((node(f[1]) - node(f[0])).cross(node(f[2]) - node(f[0])).normalized());
        for (int i : f) around[std::size_t(i)].push_back(int(t));
    }
    // By weights that are right for all triangles of a sphere (Max 1999).
    const auto share = [&](int t, int i) {
        const auto& f = mesh.surface[std::size_t(t)];
        const int k = int(std::find(f.begin(), f.end(), i) - f.begin());
        const Vector3d a = node(f[std::size_t((k + 1) % 3)]) - node(i), b = node(f[std::size_t((k + 2) % 3)]) - node(i);
        return Vector3d(a.cross(b) / (a.squaredNorm() * b.squaredNorm()));
    };
    double reach = -HUGE_VAL;
    for (int i : mesh.pad_nodes) reach = std::max(reach, along.dot(node(i)));
    for (std::size_t t = 0; t < mesh.surface.size(); ++t) {
        const auto& f = mesh.surface[t];
        const auto touches = [&](int i) { return std::binary_search(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), i); };
        if (!std::all_of(f.begin(), f.end(), touches)) continue;
        Vector3d x[3], n[3];
        for (int k = 0; k < 3; ++k) {
            x[k] = node(f[std::size_t(k)]);
            n[k].setZero();
            for (int other : around[std::size_t(f[std::size_t(k)])])
                if (normal[std::size_t(other)].dot(normal[t]) > edge) n[k] += share(other, f[std::size_t(k)]);
            n[k].normalize();
        }
        const CurvedTriangle triangle(x, n, along);
        for (int a = 0; a <= points; ++a)
            for (int b = 0; a + b <= points; ++b) {
                const double w[3] = {double(a) / points, double(b) / points, double(points - a - b) / points};
                reach = std::max(reach, triangle.at(w));
            }
    }
    return reach;
}

}  // namespace palpate
