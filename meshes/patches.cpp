#include "meshes/patches.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include <Eigen/LU>

#include "meshes/input_error.h"

namespace palpate {

namespace {

/// What is grouped, elements or patches of them.
struct Graph {
    std::vector<std::vector<int>> neighbour;  ///< across each shared face
    std::vector<Point> centre;
    std::vector<bool> deforms;  ///< what does not is left out
};

Graph element_graph(const TetMesh& mesh) {
    Graph g;
    const std::size_t count = mesh.tets.size();
    std::vector<std::array<int, 4>> across(count, {-1, -1, -1, -1});
    std::vector<bool> in_bone(mesh.nodes.size(), false);
    for (int i : mesh.bone_nodes) in_bone[std::size_t(i)] = true;
    std::map<std::array<int, 3>, std::array<int, 2>> open;  // face -> element and its face
    for (std::size_t e = 0; e < count; ++e) {
        const auto& tet = mesh.tets[e];
        g.deforms.push_back(!std::all_of(tet.begin(), tet.end(), [&](int i) { return in_bone[std::size_t(i)]; }));
        Point& c = g.centre.emplace_back(Point{0, 0, 0});
        for (int i : tet)
            for (std::size_t d = 0; d < 3; ++d) c[d] += mesh.nodes[std::size_t(i)][d] / 4;
        for (int f = 0; f < 4; ++f) {
            std::array<int, 3> face{tet[std::size_t((f + 1) % 4)], tet[std::size_t((f + 2) % 4)],
                                    tet[std::size_t((f + 3) % 4)]};
            std::sort(face.begin(), face.end());
            const auto [it, fresh] = open.try_emplace(face, std::array<int, 2>{int(e), f});
            if (fresh) continue;
            across[e][std::size_t(f)] = it->second[0];
            across[std::size_t(it->second[0])][std::size_t(it->second[1])] = int(e);
        }
    }
    for (const auto& faces : across) {
        auto& list = g.neighbour.emplace_back();
        for (int other : faces)
            if (other >= 0) list.push_back(other);
    }
    return g;
}

/// Of groups of what another graph has (-1: of none).
Graph graph_of_groups(const Graph& of, const std::vector<int>& group) {
    const int count = 1 + *std::max_element(group.begin(), group.end());
    Graph g{std::vector<std::vector<int>>(std::size_t(count)), std::vector(std::size_t(count), Point{0, 0, 0}),
            std::vector<bool>(std::size_t(count), false)};
    std::vector<double> members(std::size_t(count), 0.0);
    for (std::size_t e = 0; e < group.size(); ++e) {
        if (group[e] < 0) continue;
        const auto k = std::size_t(group[e]);
        g.deforms[k] = true;
        for (std::size_t d = 0; d < 3; ++d)
            g.centre[k][d] = (members[k] * g.centre[k][d] + of.centre[e][d]) / (members[k] + 1);
        members[k] += 1;
        for (int other : of.neighbour[e])
            if (group[std::size_t(other)] >= 0 && group[std::size_t(other)] != group[e])
                g.neighbour[k].push_back(group[std::size_t(other)]);
    }
    return g;
}

double squared_distance(const Point& a, const Point& b) {
    double sum = 0;
    for (std::size_t d = 0; d < 3; ++d) sum += (a[d] - b[d]) * (a[d] - b[d]);
    return sum;
}

/// Tetrahedra with a face in the skin that can touch, beside each other where faces share an edge.
Graph skin_graph(const TetMesh& mesh) {
    const std::size_t count = mesh.tets.size();
    Graph g{std::vector<std::vector<int>>(count), std::vector(count, Point{0, 0, 0}), std::vector<bool>(count, false)};
    std::map<std::array<int, 3>, Point> centre;  // of each face
    for (const auto& t : mesh.surface) {
        if (std::none_of(t.begin(), t.end(),
                         [&](int i) { return std::binary_search(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), i); }))
            continue;
        auto face = t;
        std::sort(face.begin(), face.end());
        Point& c = centre[face] = {0, 0, 0};
        for (int i : t)
            for (std::size_t d = 0; d < 3; ++d) c[d] += mesh.nodes[std::size_t(i)][d] / 3;
    }
    std::map<std::array<int, 2>, std::vector<int>> beside;  // edge -> elements
    for (std::size_t e = 0; e < count; ++e) {
        double faces = 0;
        for (std::size_t f = 0; f < 4; ++f) {
            const auto& tet = mesh.tets[e];
            std::array<int, 3> face{tet[(f + 1) % 4], tet[(f + 2) % 4], tet[(f + 3) % 4]};
            std::sort(face.begin(), face.end());
            const auto it = centre.find(face);
            if (it == centre.end()) continue;
            g.deforms[e] = true;
            faces += 1;
            for (std::size_t d = 0; d < 3; ++d) g.centre[e][d] += (it->second[d] - g.centre[e][d]) / faces;
            for (const auto& edge :
                 {std::array{face[0], face[1]}, std::array{face[0], face[2]}, std::array{face[1], face[2]}})
                beside[edge].push_back(int(e));
        }
    }
    for (const auto& [edge, elements] : beside)
        for (int a : elements)
            for (int b : elements)
                if (a != b) g.neighbour[std::size_t(a)].push_back(b);
    return g;
}

/// Connected, compact groups of about `size`, and of no more than `most`; -1 for what does not deform.
std::vector<int> compact_groups(const Graph& g, int size, int most) {
    const int count = int(g.centre.size());
    std::vector<int> patch(std::size_t(count), -1);
    auto is_open = [&](int e) { return g.deforms[std::size_t(e)] && patch[std::size_t(e)] < 0; };
    auto open_neighbours = [&](int e) {
        int n = 0;
        for (int other : g.neighbour[std::size_t(e)]) n += is_open(other);
        return n;
    };
    std::vector<std::vector<int>> members;
    for (;;) {
        // From where fewest neighbours are left, so that nothing is left alone.
        int seed = -1, fewest = std::numeric_limits<int>::max();
        for (int e = 0; e < count; ++e)
            if (is_open(e) && open_neighbours(e) < fewest) seed = e, fewest = open_neighbours(e);
        if (seed < 0) break;
        const int number = int(members.size());
        auto& own = members.emplace_back();
        for (int next = seed; next >= 0;) {
            own.push_back(next);
            patch[std::size_t(next)] = number;
            Point centre{0, 0, 0};
            for (int e : own)
                for (std::size_t d = 0; d < 3; ++d) centre[d] += g.centre[std::size_t(e)][d] / double(own.size());
            next = -1;
            double nearest = HUGE_VAL;
            if (int(own.size()) == size) break;
            for (int e : own)
                for (int other : g.neighbour[std::size_t(e)]) {
                    if (!is_open(other)) continue;
                    int shared = 0;  // faces with the patch: fewer new nodes
                    for (int third : g.neighbour[std::size_t(other)]) shared += patch[std::size_t(third)] == number;
                    const double cost = squared_distance(g.centre[std::size_t(other)], centre) / (shared * shared);
                    if (cost < nearest) nearest = cost, next = other;
                }
        }
    }
    // What is left over joins its smallest neighbour.
    for (std::size_t k = 0; k < members.size(); ++k) {
        if (2 * int(members[k].size()) >= size) continue;
        int best = -1;
        for (int e : members[k])
            for (int other : g.neighbour[std::size_t(e)]) {
                const int p = patch[std::size_t(other)];
                if (p < 0 || p == int(k) || int(members[std::size_t(p)].size() + members[k].size()) > most) continue;
                if (best < 0 || members[std::size_t(p)].size() < members[std::size_t(best)].size()) best = p;
            }
        if (best < 0) continue;
        for (int e : members[k]) patch[std::size_t(e)] = best;
        members[std::size_t(best)].insert(members[std::size_t(best)].end(), members[k].begin(), members[k].end());
        members[k].clear();
    }
    return patch;
}

}  // namespace

void make_patches(TetMesh& mesh, int size) {
    constexpr int most = 16;
    if (size < 1 || size > most) throw InputError("a patch has 1 to 16 elements, found " + std::to_string(size));
    mesh.patches = compact_groups(element_graph(mesh), size, most);
}

void make_membrane_patches(TetMesh& mesh, int size) {
    constexpr int most = 8;
    if (size < 1 || size > most) throw InputError("a patch of skin has 1 to 8 elements, found " + std::to_string(size));
    mesh.membrane_patches = compact_groups(skin_graph(mesh), size, most);
}

void make_limit_patches(TetMesh& mesh, int count, int fewest) {
    const Graph elements = element_graph(mesh);
    const auto deforming = double(std::count(elements.deforms.begin(), elements.deforms.end(), true));
    const double size = std::max(double(fewest), deforming / count);
    // Whole patches of volume, whose nodes are neighbours already, unless those are larger.
    const double volume_patches = double(std::set<int>(mesh.patches.begin(), mesh.patches.end()).size());
    if (volume_patches == 0 || deforming > 1.2 * size * volume_patches) {
        mesh.limit_patches = compact_groups(elements, int(std::lround(size)), 2 * int(std::lround(size)));
        return;
    }
    const Graph patches = graph_of_groups(elements, mesh.patches);
    const auto patch_count = double(std::count(patches.deforms.begin(), patches.deforms.end(), true));
    const int together = std::max(1, int(std::lround(size * patch_count / deforming)));
    const std::vector<int> group = compact_groups(patches, together, 2 * together);
    mesh.limit_patches.assign(mesh.patches.size(), -1);
    for (std::size_t e = 0; e < mesh.patches.size(); ++e)
        if (mesh.patches[e] >= 0) mesh.limit_patches[e] = group[std::size_t(mesh.patches[e])];
}

namespace {

Eigen::Vector3d node_of(const TetMesh& mesh, int node) {
    return Eigen::Map<const Eigen::Vector3d>(mesh.nodes[std::size_t(node)].data());
}
Eigen::Matrix3d edges_of(const TetMesh& mesh, std::size_t e) {
    Eigen::Matrix3d D;
    for (int k = 0; k < 3; ++k)
        D.col(k) = node_of(mesh, mesh.tets[e][std::size_t(k + 1)]) - node_of(mesh, mesh.tets[e][0]);
    return D;
}

/// An element of a coarse mesh that is in a limit patch.
struct Cell {
    Eigen::Matrix3d to_weights;
    Eigen::Vector3d corner, middle;
    double radius;  ///< around the middle
    int patch;
    /// Least of the barycentric weights: where it is negative, x is outside.
    double inside(const Eigen::Vector3d& x) const {
        const Eigen::Vector3d w = to_weights * (x - corner);
        return std::min(w.minCoeff(), 1 - w.sum());
    }
};

Cell cell_of(const TetMesh& mesh, std::size_t e) {
    const Eigen::Matrix3d D = edges_of(mesh, e);
    const Eigen::Vector3d corner = node_of(mesh, mesh.tets[e][0]), middle = corner + D.rowwise().sum() / 4;
    double radius = 0;
    for (int i : mesh.tets[e]) radius = std::max(radius, (node_of(mesh, i) - middle).norm());
    return {D.inverse(), corner, middle, radius, mesh.limit_patches.empty() ? -1 : mesh.limit_patches[e]};
}

std::vector<Cell> limited_cells(const TetMesh& mesh) {
    std::vector<Cell> cells;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        if (mesh.limit_patches[e] >= 0) cells.push_back(cell_of(mesh, e));
    return cells;
}

/// The patch of the cell that x is in, or nearest to.
template <class Cells>
int patch_at(const Cells& cells, const Eigen::Vector3d& x) {
    int patch = -1;
    double deepest = -HUGE_VAL;
    for (const Cell& cell : cells)
        if (const double inside = cell.inside(x); inside > deepest) deepest = inside, patch = cell.patch;
    return patch;
}

}  // namespace

void take_limit_patches(TetMesh& mesh, const TetMesh& coarse) {
    const std::vector<Cell> cells = limited_cells(coarse);
    // By volume, as a patch's elements may differ in size.
    struct Part {
        Eigen::Vector3d moment = Eigen::Vector3d::Zero();
        double volume = 0;
    };
    const std::vector<bool> deforms = element_graph(mesh).deforms;
    const int patch_count = mesh.patches.empty() ? 0 : 1 + *std::max_element(mesh.patches.begin(), mesh.patches.end());
    std::map<int, Part> parts;  // by patch of volume, and after those by element
    const auto part_of = [&](std::size_t e) {
        return !mesh.patches.empty() && mesh.patches[e] >= 0 ? mesh.patches[e] : patch_count + int(e);
    };
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        if (!deforms[e]) continue;
        const Eigen::Matrix3d D = edges_of(mesh, e);
        Part& p = parts[part_of(e)];
        p.moment += D.determinant() * (node_of(mesh, mesh.tets[e][0]) + D.rowwise().sum() / 4);
        p.volume += D.determinant();
    }
    std::map<int, int> patch;
    for (const auto& [number, part] : parts) patch[number] = patch_at(cells, part.moment / part.volume);
    mesh.limit_patches.assign(mesh.tets.size(), -1);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        if (deforms[e] && !cells.empty()) mesh.limit_patches[e] = patch.at(part_of(e));
}

void cut_limit_patches(TetMesh& mesh, const TetMesh& coarse) {
    constexpr int rows = 6;              // of points along an edge: 56 in all
    constexpr double least_share = 0.1;  // less is left to the others: it would couple nodes for nearly nothing
    const std::vector<Cell> cells = limited_cells(coarse);
    const std::vector<bool> deforms = element_graph(mesh).deforms;
    mesh.limit_patches.assign(mesh.tets.size(), -1);
    mesh.limit_shares.clear();
    if (cells.empty()) return;
    std::vector<Cell> near;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        if (!deforms[e]) continue;
        const Cell own = cell_of(mesh, e);
        near.clear();
        for (const Cell& cell : cells)
            if ((cell.middle - own.middle).norm() <= cell.radius + own.radius) near.push_back(cell);
        const std::vector<Cell>& asked = near.empty() ? cells : near;
        const Eigen::Matrix3d D = edges_of(mesh, e);
        std::map<int, int> points;  // of each patch
        for (int i = 0; i < rows; ++i)
            for (int j = 0; i + j < rows; ++j)
                for (int k = 0; i + j + k < rows; ++k)
                    ++points[patch_at(asked, own.corner + D * Eigen::Vector3d(i + 0.25, j + 0.25, k + 0.25) / rows)];
        int all = 0, most = 0, kept = 0;
        for (const auto& [patch, count] : points) all += count;
        for (const auto& [patch, count] : points) {
            if (count > most) most = count, mesh.limit_patches[e] = patch;
            if (count >= least_share * all) kept += count;
        }
        if (kept == most) continue;  // wholly in one, or nearly
        for (const auto& [patch, count] : points)
            if (count >= least_share * all) mesh.limit_shares.push_back({int(e), patch, double(count) / kept});
    }
}

}  // namespace palpate
