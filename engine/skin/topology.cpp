#include "engine/skin/topology.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <set>

namespace palpate {

int BlockPattern::find(int r, int column) const {
    const auto begin = row.begin() + column_start[column], end = row.begin() + column_start[column + 1];
    const auto it = std::lower_bound(begin, end, r);
    return it != end && *it == r ? static_cast<int>(it - row.begin()) : -1;
}

BlockPattern factor_pattern(const std::vector<std::vector<int>>& adjacency) {
    const int n = static_cast<int>(adjacency.size());
    std::vector<std::set<int>> below(n);
    for (int i = 0; i < n; ++i)
        for (int j : adjacency[i])
            if (j > i) below[i].insert(j);
    for (int j = 0; j < n; ++j)  // eliminating j couples everything below it
        if (!below[j].empty()) {
            const int parent = *below[j].begin();
            below[parent].insert(std::next(below[j].begin()), below[j].end());
        }
    BlockPattern p;
    p.columns = n;
    p.column_start.push_back(0);
    for (int j = 0; j < n; ++j) {
        p.row.push_back(j);
        p.row.insert(p.row.end(), below[j].begin(), below[j].end());
        p.column_start.push_back(static_cast<int>(p.row.size()));
    }
    p.block_count = static_cast<int>(p.row.size());

    std::vector<std::vector<std::array<int, 2>>> updates(p.block_count);
    for (int k = 0; k < n; ++k)
        for (int b = p.column_start[k] + 1; b < p.column_start[k + 1]; ++b)
            for (int a = b; a < p.column_start[k + 1]; ++a) updates[p.find(p.row[a], p.row[b])].push_back({a, b});
    p.update_start.push_back(0);
    for (const auto& list : updates) {
        for (auto [a, b] : list) {
            p.update_a.push_back(a);
            p.update_b.push_back(b);
        }
        p.update_start.push_back(static_cast<int>(p.update_a.size()));
    }
    return p;
}

namespace {

using Adjacency = std::vector<std::vector<int>>;

/// Graph of the nodes of the mesh; nodes of one element are neighbours.
Adjacency node_graph(const TetMesh& mesh) {
    std::vector<std::set<int>> neighbours(mesh.nodes.size());
    for (const auto& tet : mesh.tets)
        for (int a : tet)
            for (int b : tet)
                if (a != b) neighbours[a].insert(b);
    Adjacency graph;
    for (const auto& set : neighbours) graph.emplace_back(set.begin(), set.end());
    return graph;
}

/// Approximate minimum degree order of the nodes: position of each node.
std::vector<int> minimum_degree_positions(const Adjacency& graph) {
    const int n = static_cast<int>(graph.size());
    std::vector<Eigen::Triplet<double>> entries;
    for (int i = 0; i < n; ++i) {
        entries.emplace_back(i, i, 1.0);
        for (int j : graph[i]) entries.emplace_back(i, j, 1.0);
    }
    Eigen::SparseMatrix<double> matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
    Eigen::AMDOrdering<int>()(matrix, order);
    std::vector<int> position(n);
    for (int k = 0; k < n; ++k) position[order.indices()[k]] = k;
    return position;
}

}  // namespace

SkinTopology build_topology(const TetMesh& mesh) {
    SkinTopology t;
    t.node_count = static_cast<int>(mesh.nodes.size());
    t.bone_position = t.node_count;
    t.bone_rotation = t.node_count + 1;
    t.bone_nodes = mesh.bone_nodes;
    t.samples = mesh.pad_nodes;

    const Adjacency graph = node_graph(mesh);
    t.elimination = minimum_degree_positions(graph);
    t.elimination.push_back(t.bone_position);
    t.elimination.push_back(t.bone_rotation);

    Adjacency permuted(t.node_count + 2);
    auto connect = [&](int a, int b) {
        permuted[t.elimination[a]].push_back(t.elimination[b]);
        permuted[t.elimination[b]].push_back(t.elimination[a]);
    };
    for (int i = 0; i < t.node_count; ++i)
        for (int j : graph[i])
            if (i < j) connect(i, j);
    for (int node : t.bone_nodes) {
        connect(node, t.bone_position);
        connect(node, t.bone_rotation);
    }
    connect(t.bone_position, t.bone_rotation);
    t.pattern = factor_pattern(permuted);

    auto block = [&](int a, int b) { return t.pattern.find(t.elimination[a], t.elimination[b]); };
    for (auto tet : mesh.tets) {
        std::sort(tet.begin(), tet.end(), [&](int a, int b) { return t.elimination[a] < t.elimination[b]; });
        t.elements.push_back(tet);
        auto& destinations = t.element_block.emplace_back();
        for (int k = 0, a = 0; a < 4; ++a)
            for (int b = 0; b <= a; ++b, ++k) destinations[k] = block(tet[a], tet[b]);
    }
    for (int i = 0; i < t.node_count + 2; ++i) t.diagonal_block.push_back(block(i, i));
    for (int node : t.bone_nodes) t.bone_block.push_back({block(t.bone_position, node), block(t.bone_rotation, node)});
    t.bone_cross_block = block(t.bone_rotation, t.bone_position);
    return t;
}

}  // namespace palpate
