#include "engine/skin/chunks/topology.h"

#include "engine/math/linear_algebra.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <map>
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

    return p;
}

void add_updates(BlockPattern& p) {
    std::vector<std::vector<std::array<int, 2>>> updates(p.block_count);
    for (int k = 0; k < p.columns; ++k)
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
}

namespace {

using Adjacency = std::vector<std::vector<int>>;

/// Graph of the nodes; nodes of one element, or of one patch, are neighbours.
Adjacency node_graph(const SkinTopology& t) {
    std::vector<std::set<int>> neighbours(t.node_count);
    auto connect = [&](auto first, auto last) {
        for (auto a = first; a != last; ++a)
            for (auto b = first; b != last; ++b)
                if (*a != *b) neighbours[*a].insert(*b);
    };
    for (const auto& tet : t.elements) connect(tet.begin(), tet.end());
    const auto connect_patches = [&](const auto& patches, const std::vector<int>& nodes) {
        for (const auto& p : patches)
            connect(nodes.begin() + p.first_node, nodes.begin() + p.first_node + p.node_count);
    };
    connect_patches(t.patches, t.patch_nodes);
    connect_patches(t.limit_patches, t.limit_nodes);
    connect_patches(t.membrane_patches, t.membrane_nodes);
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

/// Elimination positions: free nodes by minimum degree, then the bone.
void order_unknowns(SkinTopology& t, const Adjacency& graph, const std::vector<bool>& in_bone) {
    std::vector<int> free_number(t.node_count, -1);
    for (int i = 0; i < t.node_count; ++i)
        if (!in_bone[i]) {
            free_number[i] = static_cast<int>(t.unknowns.size());
            t.unknowns.push_back(i);
        }
    Adjacency free_graph;
    for (int i : t.unknowns) {
        auto& row = free_graph.emplace_back();
        for (int j : graph[i])
            if (!in_bone[j]) row.push_back(free_number[j]);
    }
    const std::vector<int> position = minimum_degree_positions(free_graph);
    t.elimination.assign(t.node_count + 2, -1);
    for (std::size_t u = 0; u < position.size(); ++u) t.elimination[t.unknowns[u]] = position[u];
    for (int b : {t.bone_position, t.bone_rotation}) {
        t.elimination[b] = static_cast<int>(t.unknowns.size());
        t.unknowns.push_back(b);
    }
}

/// The factor's pattern: free nodes that share an element, and the bone with every neighbour of its nodes.
void build_pattern(SkinTopology& t, const Adjacency& graph, const std::vector<bool>& in_bone) {
    Adjacency permuted(t.unknowns.size());
    auto connect = [&](int a, int b) {
        permuted[t.elimination[a]].push_back(t.elimination[b]);
        permuted[t.elimination[b]].push_back(t.elimination[a]);
    };
    for (int i = 0; i < t.node_count; ++i)
        for (int j : graph[i]) {
            if (!in_bone[i] && !in_bone[j] && i < j) connect(i, j);
            if (in_bone[i] && !in_bone[j])
                for (int b : {t.bone_position, t.bone_rotation}) connect(j, b);
        }
    connect(t.bone_position, t.bone_rotation);
    t.pattern = factor_pattern(permuted);
    t.supernodes = build_supernodes(t.pattern);
    t.block_count = t.pattern.block_count;
}

/// Blocks of bone nodes, after the pattern's.
class BoneBlocks {
  public:
    explicit BoneBlocks(SkinTopology& topology) : t(topology) {}
    /// Block (bone node a, node b).
    int block(int a, int b) {
        const auto [it, fresh] = number.try_emplace({a, b}, t.block_count);
        if (!fresh) return it->second;
        ++t.block_count;
        if (t.elimination[b] < 0) {
            t.bone_pairs.push_back({it->second, a, b});
        } else {
            auto find = [&](int row) { return t.pattern.find(t.elimination[row], t.elimination[b]); };
            t.bone_edges.push_back({it->second, a, find(t.bone_position), find(t.bone_rotation)});
        }
        return it->second;
    }

  private:
    SkinTopology& t;
    std::map<std::pair<int, int>, int> number;
};

/// Points of a lattice on each face whose nodes all belong to the pad, and not to the bone; on edges, once.
void refine_samples(SkinTopology& t, const TetMesh& mesh, int refinement) {
    std::vector<int> sample_of(t.node_count, -1);
    for (std::size_t s = 0; s < t.samples.size(); ++s)
        if (t.elimination[t.samples[s]] >= 0) sample_of[t.samples[s]] = static_cast<int>(s);
    std::set<std::array<std::pair<int, int>, 3>> seen;  // node and weight of each corner
    for (const auto& face : mesh.surface) {
        if (std::any_of(face.begin(), face.end(), [&](int node) { return sample_of[node] < 0; })) continue;
        for (int i = 0; i <= refinement; ++i)
            for (int j = 0; i + j <= refinement; ++j) {
                const std::array<int, 3> weight{i, j, refinement - i - j};
                if (std::count(weight.begin(), weight.end(), 0) == 2) continue;  // a node
                std::array<std::pair<int, int>, 3> key;
                for (int k = 0; k < 3; ++k) key[k] = weight[k] ? std::pair{face[k], weight[k]} : std::pair{-1, 0};
                std::sort(key.begin(), key.end());
                if (!seen.insert(key).second) continue;
                FaceSample f;
                for (int k = 0; k < 3; ++k) {
                    f.node[k] = face[k];
                    f.sample[k] = sample_of[face[k]];
                    f.weight[k] = double(weight[k]) / refinement;
                }
                for (int k = 0, a = 0; a < 3; ++a)
                    for (int b = 0; b <= a; ++b, ++k) {
                        const int p = t.elimination[face[a]], q = t.elimination[face[b]];
                        f.block[k] = t.pattern.find(std::max(p, q), std::min(p, q));
                    }
                t.face_samples.push_back(f);
            }
    }
}

/// Numbers of the samples at the nodes of a finger; -1: none.
std::vector<int> samples_of_nodes(const SkinTopology& t) {
    std::vector<int> sample_of(std::size_t(t.node_count), -1);
    for (std::size_t s = 0; s < t.samples.size(); ++s) sample_of[std::size_t(t.samples[s])] = int(s);
    return sample_of;
}

/// Calls visit(face) for the faces of which all nodes are samples: the pad's.
template <class Visit>
void for_each_pad_face(const TetMesh& mesh, const std::vector<int>& sample_of, Visit visit) {
    for (const auto& f : mesh.surface)
        if (std::none_of(f.begin(), f.end(), [&](int node) { return sample_of[std::size_t(node)] < 0; })) visit(f);
}

/// Corners of the faces around the pad's nodes.
void find_skin_corners(SkinTopology& t, const TetMesh& mesh) {
    const std::vector<int> sample_of = samples_of_nodes(t);
    for (const auto& f : mesh.surface)
        for (std::size_t k = 0; k < 3; ++k)
            if (const int sample = sample_of[std::size_t(f[k])]; sample >= 0)
                t.skin_corners.push_back({sample, f[k], f[(k + 1) % 3], f[(k + 2) % 3]});
}

/// Edges of the pad's faces.
void find_skin_edges(SkinTopology& t, const TetMesh& mesh) {
    const std::vector<int> sample_of = samples_of_nodes(t);
    std::set<std::pair<int, int>> edges;
    for_each_pad_face(mesh, sample_of, [&](const std::array<int, 3>& f) {
        for (std::size_t k = 0; k < 3; ++k) edges.insert(std::minmax(f[k], f[(k + 1) % 3]));
    });
    t.edge_share.assign(t.samples.size(), 0);
    for (const auto& [a, b] : edges) {
        t.skin_edges.push_back({{a, b}, {sample_of[std::size_t(a)], sample_of[std::size_t(b)]}});
        for (int s : t.skin_edges.back().sample) t.edge_share[std::size_t(s)] += 1;
    }
    for (double& share : t.edge_share) share = share > 0 ? 1 / share : 0;
}

/// Patches of the elements, which stand in their order; nodes of each, ascending.
void collect_patches(SkinTopology& t, const TetMesh& mesh) {
    for (int e = 0; e < int(t.elements.size());) {
        VolumePatch& p = t.patches.emplace_back();
        const int number = mesh.patches[t.mesh_element[e]];
        std::set<int> nodes;
        for (p.first = e; e < int(t.elements.size()) && mesh.patches[t.mesh_element[e]] == number; ++e) {
            nodes.insert(t.elements[e].begin(), t.elements[e].end());
            if (++p.count == most_patch_elements) {
                ++e;
                break;
            }
        }
        p.first_node = int(t.patch_nodes.size());
        p.node_count = int(nodes.size());
        t.patch_nodes.insert(t.patch_nodes.end(), nodes.begin(), nodes.end());
    }
}

/// Limit patches, and the nodes of each, ascending.
void collect_limit_patches(SkinTopology& t, const TetMesh& mesh) {
    // An element in no patch is one of its own.
    const auto patch_of = [&](int e) {
        const int patch = mesh.limit_patches[std::size_t(e)];
        return patch >= 0 ? patch : -1 - e;
    };
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        const int tet = t.mesh_element[e];
        auto share = std::lower_bound(mesh.limit_shares.begin(), mesh.limit_shares.end(), tet,
                                      [](const LimitShare& s, int of) { return s.tet < of; });
        if (share == mesh.limit_shares.end() || share->tet != tet) t.limit_parts.push_back({int(e), patch_of(tet), 1});
        for (; share != mesh.limit_shares.end() && share->tet == tet; ++share)
            t.limit_parts.push_back({int(e), share->patch, share->share});
    }
    std::map<int, std::set<int>> nodes;  // of the patches that deform
    for (const LimitPart& part : t.limit_parts) {
        const auto& tet = t.elements[std::size_t(part.element)];
        nodes[part.patch].insert(tet.begin(), tet.end());
    }
    std::map<int, int> number;
    for (const auto& [patch, of_patch] : nodes) {
        number[patch] = int(t.limit_patches.size());
        t.limit_patches.push_back({int(t.limit_nodes.size()), int(of_patch.size()), 0});
        t.limit_nodes.insert(t.limit_nodes.end(), of_patch.begin(), of_patch.end());
    }
    for (LimitPart& part : t.limit_parts) part.patch = number.at(part.patch);
}

/// The only face that an element has in the skin that can touch, by the number of the node below it; -1: none, or
/// several.
std::vector<int> nodes_below_skin(const SkinTopology& t, const TetMesh& mesh) {
    std::set<std::array<int, 3>> skin;
    for (auto face : mesh.surface) {
        const bool touches = std::any_of(face.begin(), face.end(), [&](int i) {
            return std::binary_search(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), i);
        });
        std::sort(face.begin(), face.end());
        if (touches) skin.insert(face);
    }
    std::vector<int> below;
    for (const auto& tet : t.elements) {
        int found = -1, faces = 0;
        for (std::size_t a = 0; a < 4; ++a) {
            std::array<int, 3> face{tet[(a + 1) % 4], tet[(a + 2) % 4], tet[(a + 3) % 4]};
            std::sort(face.begin(), face.end());
            if (skin.count(face)) found = tet[a], ++faces;
        }
        below.push_back(faces == 1 ? found : -1);
    }
    return below;
}

/// Membrane patches, and the nodes of each.
void collect_membrane_patches(SkinTopology& t, const TetMesh& mesh) {
    t.in_membrane_patch.assign(t.elements.size(), 0);
    const std::vector<int> below = nodes_below_skin(t, mesh);
    std::map<int, std::vector<int>> elements;
    for (std::size_t e = 0; e < t.elements.size(); ++e)
        if (const int patch = mesh.membrane_patches[std::size_t(t.mesh_element[e])]; patch >= 0)
            elements[patch].push_back(int(e));
    for (const auto& [patch, of_patch] : elements)
        for (std::size_t first = 0; first < of_patch.size(); first += most_membrane_elements) {
            MembranePatch& p = t.membrane_patches.emplace_back();
            p.first = int(t.membrane_elements.size());
            std::set<int> nodes;
            for (std::size_t i = first; i < std::min(of_patch.size(), first + most_membrane_elements); ++i) {
                const auto e = std::size_t(of_patch[i]);
                ++p.count;
                t.membrane_elements.push_back(int(e));
                t.in_membrane_patch[e] = 1;
                for (int node : t.elements[e])
                    if (node != below[e]) nodes.insert(node);
            }
            p.first_node = int(t.membrane_nodes.size());
            p.node_count = int(nodes.size());
            t.membrane_nodes.insert(t.membrane_nodes.end(), nodes.begin(), nodes.end());
        }
}

/// Notes which blocks nothing is ever added to.
void note_fill(SkinTopology& t) {
    t.pattern.filled.assign(std::size_t(t.pattern.block_count), 1);
    auto has = [&](int block) {
        if (block < t.pattern.block_count) t.pattern.filled[std::size_t(block)] = 0;
    };
    for (const auto& destinations : t.element_block)
        for (int block : destinations) has(block);
    for (const auto& sample : t.face_samples)
        for (int block : sample.block) has(block);
    for (const auto& edge : t.bone_edges) has(edge.position), has(edge.rotation);
    for (int block : t.patch_blocks) has(block);
    for (int block : t.limit_blocks) has(block);
    for (int block : t.membrane_blocks) has(block);
    for (int block : t.diagonal_block) has(block);
    has(t.bone_cross_block);
}

}  // namespace

SkinTopology build_topology(const TetMesh& mesh, bool several_lanes, int sample_refinement) {
    SkinTopology t;
    t.node_count = static_cast<int>(mesh.nodes.size());
    t.bone_position = t.node_count;
    t.bone_rotation = t.node_count + 1;
    t.bone_nodes = mesh.bone_nodes;
    t.samples = mesh.pad_nodes;
    std::vector<bool> in_bone(t.node_count, false);
    for (int node : t.bone_nodes) in_bone[node] = true;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        const auto& tet = mesh.tets[e];
        if (std::all_of(tet.begin(), tet.end(), [&](int a) { return in_bone[a]; })) continue;
        t.mesh_element.push_back(static_cast<int>(e));
    }
    if (!mesh.patches.empty())
        std::stable_sort(t.mesh_element.begin(), t.mesh_element.end(),
                         [&](int a, int b) { return mesh.patches[a] < mesh.patches[b]; });
    for (int e : t.mesh_element) t.elements.push_back(mesh.tets[e]);
    if (!mesh.patches.empty()) collect_patches(t, mesh);
    if (!mesh.limit_patches.empty()) collect_limit_patches(t, mesh);
    if (!mesh.membrane_patches.empty()) collect_membrane_patches(t, mesh);
    const Adjacency graph = node_graph(t);
    order_unknowns(t, graph, in_bone);
    build_pattern(t, graph, in_bone);
    if (several_lanes) add_updates(t.pattern);

    BoneBlocks bone(t);
    auto order = [&](int node) { return in_bone[node] ? t.node_count + 2 + node : t.elimination[node]; };
    auto block = [&](int a, int b) {  // a not before b
        return in_bone[a] ? bone.block(a, b) : t.pattern.find(t.elimination[a], t.elimination[b]);
    };
    for (auto& tet : t.elements) {
        std::sort(tet.begin(), tet.end(), [&](int a, int b) { return order(a) < order(b); });
        auto& destinations = t.element_block.emplace_back();
        for (int k = 0, a = 0; a < 4; ++a)
            for (int b = 0; b <= a; ++b, ++k) destinations[k] = block(tet[a], tet[b]);
    }
    const auto number_blocks = [&](auto& patch, std::vector<int>& all_nodes, std::vector<int>& blocks) {
        const auto nodes = all_nodes.begin() + patch.first_node;
        std::sort(nodes, nodes + patch.node_count, [&](int a, int b) { return order(a) < order(b); });
        patch.first_block = int(blocks.size());
        for (int a = 0; a < patch.node_count; ++a)
            for (int b = 0; b <= a; ++b) blocks.push_back(block(nodes[a], nodes[b]));
    };
    for (VolumePatch& p : t.patches) {
        number_blocks(p, t.patch_nodes, t.patch_blocks);
        const auto nodes = t.patch_nodes.begin() + p.first_node;
        for (int e = p.first; e < p.first + p.count; ++e) {
            auto& place = t.element_place.emplace_back();
            for (int a = 0; a < 4; ++a)
                place[a] = int(std::find(nodes, nodes + p.node_count, t.elements[e][a]) - nodes);
        }
    }
    for (LimitPatch& p : t.limit_patches) number_blocks(p, t.limit_nodes, t.limit_blocks);
    for (MembranePatch& p : t.membrane_patches) {
        number_blocks(p, t.membrane_nodes, t.membrane_blocks);
        const auto nodes = t.membrane_nodes.begin() + p.first_node;
        for (int i = p.first; i < p.first + p.count; ++i) {
            auto &place = t.membrane_place.emplace_back(), &corner = t.membrane_corner.emplace_back();
            std::size_t corners = 0;
            for (int node : t.elements[std::size_t(t.membrane_elements[std::size_t(i)])])
                if (const auto at = std::find(nodes, nodes + p.node_count, node); at != nodes + p.node_count)
                    place[corners] = int(at - nodes), corner[corners++] = node;
            if (corners == 3) place[3] = -1, corner[3] = corner[0];
        }
    }
    for (int i = 0; i < t.node_count; ++i) t.diagonal_block.push_back(block(i, i));
    // Those to one free node beside each other: they are added up in registers.
    std::stable_sort(t.bone_edges.begin(), t.bone_edges.end(),
                     [](const auto& a, const auto& b) { return a.position < b.position; });
    for (int b : {t.bone_position, t.bone_rotation})
        t.diagonal_block.push_back(t.pattern.find(t.elimination[b], t.elimination[b]));
    if (sample_refinement > 1) refine_samples(t, mesh, sample_refinement);
    find_skin_corners(t, mesh);
    if (mesh.curved_skin) find_skin_edges(t, mesh);
    t.bone_cross_block = t.pattern.find(t.elimination[t.bone_rotation], t.elimination[t.bone_position]);
    note_fill(t);
    return t;
}

std::vector<TissuePair> tissue_pairs(const SkinTopology& t) {
    std::map<int, TissuePair> pairs;
    for (std::size_t e = 0; e < t.elements.size(); ++e)
        for (int k = 0, i = 0; i < 4; ++i)
            for (int j = 0; j <= i; ++j, ++k) {
                const int a = t.elements[e][i], b = t.elements[e][j], block = t.element_block[e][k];
                pairs.try_emplace(block, TissuePair{block, a, b});
            }
    const auto add_patches = [&](const auto& patches, const std::vector<int>& nodes, const std::vector<int>& blocks) {
        for (const auto& p : patches)
            for (int k = p.first_block, i = 0; i < p.node_count; ++i)
                for (int j = 0; j <= i; ++j, ++k)
                    pairs.try_emplace(blocks[k],
                                      TissuePair{blocks[k], nodes[p.first_node + i], nodes[p.first_node + j]});
    };
    add_patches(t.patches, t.patch_nodes, t.patch_blocks);
    add_patches(t.limit_patches, t.limit_nodes, t.limit_blocks);
    add_patches(t.membrane_patches, t.membrane_nodes, t.membrane_blocks);
    std::vector<TissuePair> list;
    for (const auto& [block, pair] : pairs) list.push_back(pair);
    return list;
}

std::vector<double> nodal_areas(const TetMesh& mesh) {
    std::vector<double> area(mesh.nodes.size(), 0.0);
    auto at = [&](int i) { return Vec3<double>{mesh.nodes[i][0], mesh.nodes[i][1], mesh.nodes[i][2]}; };
    for (const auto& t : mesh.surface) {
        const double share = norm(cross(at(t[1]) - at(t[0]), at(t[2]) - at(t[0]))) / 6;
        for (int i : t) area[i] += share;
    }
    return area;
}

std::vector<bool> corners_on_pad(const SkinTopology& t, const TetMesh& mesh) {
    constexpr double beyond = 0.35;  // cosine between normals, as in meshes/curved_skin.cpp
    const auto at = [&](int node) {
        const Point& p = mesh.nodes[std::size_t(node)];
        return Vec3<double>{p[0], p[1], p[2]};
    };
    const auto normal = [&](int a, int b, int c) {
        const Vec3<double> n = cross(at(b) - at(a), at(c) - at(a));
        return (1 / std::max(norm(n), 1e-300)) * n;
    };
    const std::vector<int> sample_of = samples_of_nodes(t);
    std::vector<Vec3<double>> mean(t.samples.size(), Vec3<double>{0, 0, 0});
    for_each_pad_face(mesh, sample_of, [&](const std::array<int, 3>& f) {
        for (int node : f) mean[std::size_t(sample_of[std::size_t(node)])] += normal(f[0], f[1], f[2]);
    });
    std::vector<bool> on_pad;
    for (const SkinCorner& k : t.skin_corners) {
        const Vec3<double>& of_pad = mean[std::size_t(k.sample)];
        on_pad.push_back(dot(of_pad, normal(k.node, k.next, k.last)) > beyond * norm(of_pad));
    }
    return on_pad;
}

}  // namespace palpate
