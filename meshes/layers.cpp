#include "meshes/layers.h"

#include <set>

#include "meshes/triangle_tree.h"

namespace palpate {

LayerShares layer_shares(const TetMesh& mesh, const std::vector<double>& thicknesses) {
    const std::set<int> pad(mesh.pad_nodes.begin(), mesh.pad_nodes.end());
    Surface skin{mesh.nodes, {}};
    for (const auto& t : mesh.surface)
        if (pad.count(t[0]) || pad.count(t[1]) || pad.count(t[2])) skin.triangles.push_back(t);
    const TriangleTree tree(skin);
    LayerShares out{std::vector(mesh.tets.size(), std::vector<double>(thicknesses.size() + 1, 0.0)), {}};
    std::vector<std::vector<double>>& shares = out.shares;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        constexpr int n = 4;  // points at the centres of a lattice: (i + 1/4) / n, i summing to n - 1 over 4 corners
        int count = 0;
        Eigen::Vector3d outwards = Eigen::Vector3d::Zero();
        for (int i = 0; i < n; ++i)
            for (int j = 0; i + j < n; ++j)
                for (int k = 0; i + j + k < n; ++k, ++count) {
                    const double w[4] = {(i + 0.25) / n, (j + 0.25) / n, (k + 0.25) / n,
                                         (n - 1 - i - j - k + 0.25) / n};
                    Eigen::Vector3d x = Eigen::Vector3d::Zero();
                    for (std::size_t a = 0; a < 4; ++a)
                        x += w[a] * Eigen::Map<const Eigen::Vector3d>(mesh.nodes[std::size_t(mesh.tets[e][a])].data());
                    const Eigen::Vector3d offset = tree.nearest(x) - x;
                    double depth = offset.norm();
                    if (depth > 0) outwards += offset / depth;
                    std::size_t layer = 0;
                    while (layer < thicknesses.size() && depth > thicknesses[layer]) depth -= thicknesses[layer++];
                    shares[e][layer] += 1;
                }
        for (double& s : shares[e]) s /= count;
        const double length = outwards.norm();
        if (length > 0)
            outwards /= length;
        else
            outwards = Eigen::Vector3d::UnitZ();
        out.normals.push_back({outwards[0], outwards[1], outwards[2]});
    }
    return out;
}

}  // namespace palpate
