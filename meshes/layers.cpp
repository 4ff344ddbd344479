#include "meshes/layers.h"

#include <set>

#include "meshes/triangle_tree.h"

namespace palpate {

std::vector<std::vector<double>> layer_shares(const TetMesh& mesh, const std::vector<double>& thicknesses) {
    const std::set<int> pad(mesh.pad_nodes.begin(), mesh.pad_nodes.end());
    Surface skin{mesh.nodes, {}};
    for (const auto& t : mesh.surface)
        if (pad.count(t[0]) || pad.count(t[1]) || pad.count(t[2])) skin.triangles.push_back(t);
    const TriangleTree tree(skin);
    std::vector<std::vector<double>> shares(mesh.tets.size(), std::vector<double>(thicknesses.size() + 1, 0.0));
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        constexpr int n = 4;  // points at the centres of a lattice: (i + 1/4) / n, i summing to n - 1 over 4 corners
        int count = 0;
        for (int i = 0; i < n; ++i)
            for (int j = 0; i + j < n; ++j)
                for (int k = 0; i + j + k < n; ++k, ++count) {
                    const double w[4] = {(i + 0.25) / n, (j + 0.25) / n, (k + 0.25) / n,
                                         (n - 1 - i - j - k + 0.25) / n};
                    Eigen::Vector3d x = Eigen::Vector3d::Zero();
                    for (std::size_t a = 0; a < 4; ++a)
                        x += w[a] * Eigen::Map<const Eigen::Vector3d>(mesh.nodes[std::size_t(mesh.tets[e][a])].data());
                    double depth = (tree.nearest(x) - x).norm();
                    std::size_t layer = 0;
                    while (layer < thicknesses.size() && depth > thicknesses[layer]) depth -= thicknesses[layer++];
                    shares[e][layer] += 1;
                }
        for (double& s : shares[e]) s /= count;
    }
    return shares;
}

}  // namespace palpate
