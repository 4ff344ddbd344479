#include "meshes/surface.h"

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <numeric>

#include "meshes/plain_numbers.h"
#include "meshes/triangle_tree.h"

namespace palpate {

using Eigen::Vector3d;

namespace {

Eigen::Map<const Vector3d> at(const Surface& s, int vertex) {
    return Eigen::Map<const Vector3d>(s.vertices[vertex].data());
}

std::string place(const Surface& s, int vertex) {
    char text[96];
    const Point& p = s.vertices[vertex];
    plain_snprintf(text, sizeof text, "vertex %d at (%.4g, %.4g, %.4g) mm", vertex + 1, 1e3 * p[0], 1e3 * p[1],
                   1e3 * p[2]);
    return text;
}

int part_count(const Surface& s) {
    std::vector<int> parent(s.vertices.size());
    std::iota(parent.begin(), parent.end(), 0);
    auto root = [&](int i) {
        while (parent[i] != i) i = parent[i] = parent[parent[i]];
        return i;
    };
    for (const auto& t : s.triangles) parent[root(t[0])] = root(t[1]), parent[root(t[1])] = root(t[2]);
    std::map<int, int> roots;
    for (const auto& t : s.triangles) ++roots[root(t[0])];
    return static_cast<int>(roots.size());
}

/// Edge problems: open, shared by more than two, or run in the same direction by both triangles.
void check_edges(const Surface& s, std::vector<std::string>& wrong) {
    std::map<std::array<int, 2>, std::array<int, 2>> uses;  // edge -> uses forward, backward
    for (const auto& t : s.triangles)
        for (int k = 0; k < 3; ++k) {
            const int a = t[k], b = t[(k + 1) % 3];
            ++uses[{std::min(a, b), std::max(a, b)}][a < b ? 0 : 1];
        }
    struct {
        int count = 0;
        std::array<int, 2> first{};
    } open, crowded, turned;
    auto note = [](auto& kind, const std::array<int, 2>& edge) {
        if (kind.count++ == 0) kind.first = edge;
    };
    for (const auto& [edge, n] : uses) {
        if (n[0] + n[1] == 1)
            note(open, edge);
        else if (n[0] + n[1] > 2)
            note(crowded, edge);
        else if (n[0] != n[1])
            note(turned, edge);
    }
    auto say = [&](const auto& kind, const char* what, const char* remedy) {
        if (kind.count)
            wrong.push_back("the surface " + std::string(what) + ": " + std::to_string(kind.count) +
                            " edges, the first from " + place(s, kind.first[0]) + " to " + place(s, kind.first[1]) +
                            "; " + remedy);
    };
    say(open, "is open", "close the holes (cap the cut end)");
    say(crowded, "is non-manifold, more than two triangles share an edge", "remove inner walls and duplicate faces");
    say(turned, "is inconsistently oriented", "make all triangles face outward");
}

}  // namespace

double volume(const Surface& s) {
    double v = 0;
    if (s.vertices.empty()) return 0;
    const Vector3d origin = at(s, 0);
    for (const auto& t : s.triangles)
        v += (at(s, t[0]) - origin).cross(at(s, t[1]) - origin).dot(at(s, t[2]) - origin) / 6;
    return v;
}

std::array<Point, 2> bounds(const std::vector<Point>& points) {
    std::array<Point, 2> box{Point{1e300, 1e300, 1e300}, Point{-1e300, -1e300, -1e300}};
    for (const Point& p : points)
        for (int d = 0; d < 3; ++d) {
            box[0][d] = std::min(box[0][d], p[d]);
            box[1][d] = std::max(box[1][d], p[d]);
        }
    return box;
}

std::vector<std::string> check_surface(const Surface& s, SurfaceUse use) {
    std::vector<std::string> wrong;
    if (s.triangles.size() < 4) {
        wrong.push_back("the surface has " + std::to_string(s.triangles.size()) +
                        " triangles; a closed surface has at least 4");
        return wrong;
    }
    for (std::size_t i = 0; i < s.vertices.size(); ++i)
        for (double x : s.vertices[i])
            if (!std::isfinite(x)) {
                wrong.push_back("vertex " + std::to_string(i + 1) + " is not finite; export the surface again");
                return wrong;
            }
    const auto box = bounds(s.vertices);
    const double size = std::hypot(box[1][0] - box[0][0], box[1][1] - box[0][1], box[1][2] - box[0][2]);
    for (std::size_t i = 0; i < s.triangles.size(); ++i) {
        const auto& t = s.triangles[i];
        if ((at(s, t[1]) - at(s, t[0])).cross(at(s, t[2]) - at(s, t[0])).norm() < 1e-12 * size * size) {
            wrong.push_back("triangle " + std::to_string(i + 1) + " has no area (" + place(s, t[0]) +
                            "); remove degenerate triangles");
            break;
        }
    }
    check_edges(s, wrong);
    if (!wrong.empty()) return wrong;
    if (const int parts = part_count(s); parts > 1 && use == SurfaceUse::finger)
        wrong.push_back("the surface has " + std::to_string(parts) + " separate parts; keep one closed surface");
    if (volume(s) <= 0)
        wrong.push_back("the surface is inside out (its volume is negative); flip the orientation of its triangles");
    if (use == SurfaceUse::object) return wrong;
    const auto crossings = self_intersections(s, 3);
    if (!crossings.empty())
        wrong.push_back("the surface intersects itself: triangles " + std::to_string(crossings[0][0] + 1) + " and " +
                        std::to_string(crossings[0][1] + 1) + " cross near " +
                        place(s, s.triangles[crossings[0][0]][0]) + "; repair it in a mesh editor");
    return wrong;
}

}  // namespace palpate
