#include "meshes/patches.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "meshes/input_error.h"

namespace palpate {

namespace {

struct Grouping {
    std::vector<std::array<int, 4>> neighbour;  ///< [tet][face], -1: none
    std::vector<Point> centre;                  ///< [tet]
    std::vector<bool> deforms;                  ///< [tet]
};

Grouping prepare(const TetMesh& mesh) {
    Grouping g;
    const std::size_t count = mesh.tets.size();
    g.neighbour.assign(count, {-1, -1, -1, -1});
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
            g.neighbour[e][std::size_t(f)] = it->second[0];
            g.neighbour[std::size_t(it->second[0])][std::size_t(it->second[1])] = int(e);
        }
    }
    return g;
}

double squared_distance(const Point& a, const Point& b) {
    double sum = 0;
    for (std::size_t d = 0; d < 3; ++d) sum += (a[d] - b[d]) * (a[d] - b[d]);
    return sum;
}

}  // namespace

void make_patches(TetMesh& mesh, int size) {
    if (size < 1 || size > 16) throw InputError("a patch has 1 to 16 elements, found " + std::to_string(size));
    const Grouping g = prepare(mesh);
    const int count = int(mesh.tets.size());
    std::vector<int>& patch = mesh.patches;
    patch.assign(std::size_t(count), -1);
    auto is_open = [&](int e) { return e >= 0 && g.deforms[std::size_t(e)] && patch[std::size_t(e)] < 0; };
    auto open_neighbours = [&](int e) {
        int n = 0;
        for (int other : g.neighbour[std::size_t(e)]) n += is_open(other);
        return n;
    };
    std::vector<std::vector<int>> members;
    for (;;) {
        // From where fewest neighbours are left, so that no element is left alone.
        int seed = -1, fewest = 5;
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
                    for (int third : g.neighbour[std::size_t(other)])
                        shared += third >= 0 && patch[std::size_t(third)] == number;
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
                const int p = other < 0 ? -1 : patch[std::size_t(other)];
                if (p < 0 || p == int(k) || members[std::size_t(p)].size() + members[k].size() > 16) continue;
                if (best < 0 || members[std::size_t(p)].size() < members[std::size_t(best)].size()) best = p;
            }
        if (best < 0) continue;
        for (int e : members[k]) patch[std::size_t(e)] = best;
        members[std::size_t(best)].insert(members[std::size_t(best)].end(), members[k].begin(), members[k].end());
        members[k].clear();
    }
}

}  // namespace palpate
