#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <numeric>

#include "engine/contact/fitted.h"
#include "engine/contact/mesh_distance_field.h"

namespace palpate {

namespace {

using Vec = Vec3<double>;

Vec vertex(const Surface& s, int i) { return {s.vertices[i][0], s.vertices[i][1], s.vertices[i][2]}; }
Vec unit(const Vec& a) {
    const double length = norm(a);
    return length > 0 ? (1 / length) * a : Vec{0, 0, 1};
}

/// Faces, edges (sum of both faces) and vertices (weighted by angle).
void set_normals(DistanceMesh& mesh) {
    const Surface& s = mesh.surface;
    std::vector<Vec> of_vertex(s.vertices.size(), {0, 0, 0});
    std::map<std::array<int, 2>, Vec> of_edge;
    auto edge = [](int a, int b) { return std::array<int, 2>{std::min(a, b), std::max(a, b)}; };
    for (const auto& t : s.triangles) {
        const Vec n = unit(cross(vertex(s, t[1]) - vertex(s, t[0]), vertex(s, t[2]) - vertex(s, t[0])));
        for (int k = 0; k < 3; ++k) {
            const Vec a = vertex(s, t[(k + 1) % 3]) - vertex(s, t[k]), b = vertex(s, t[(k + 2) % 3]) - vertex(s, t[k]);
            of_vertex[t[k]] += std::atan2(norm(cross(a, b)), dot(a, b)) * n;
            auto [it, fresh] = of_edge.try_emplace(edge(t[k], t[(k + 1) % 3]), n);
            if (!fresh) it->second += n;
        }
    }
    for (std::size_t i = 0; i < s.triangles.size(); ++i) {
        const auto& t = s.triangles[i];
        DistanceMesh::Triangle& out = mesh.triangles[i];
        std::array<Vec, 7>& normal = mesh.normals[i];
        out.corner = vertex(s, t[0]);
        out.to_second = vertex(s, t[1]) - out.corner, out.to_third = vertex(s, t[2]) - out.corner;
        normal[0] = unit(cross(out.to_second, out.to_third));
        for (int k = 0; k < 3; ++k) {
            normal[1 + k] = unit(of_edge[edge(t[k], t[(k + 1) % 3])]);
            normal[4 + k] = unit(of_vertex[t[k]]);
        }
    }
}

/// Tree over order[begin..end): splits twice at the median of the longest axis.
int build_tree(DistanceMesh& mesh, std::vector<int>& order, int begin, int end) {
    auto centre = [&](int t, int axis) {
        const DistanceMesh::Triangle& k = mesh.triangles[t];
        return 3 * k.corner[axis] + k.to_second[axis] + k.to_third[axis];
    };
    auto split = [&](int from, int to) {
        Vec low{1e300, 1e300, 1e300}, high = -low;
        for (int i = from; i < to; ++i)
            for (int d = 0; d < 3; ++d) {
                low[d] = std::min(low[d], centre(order[i], d));
                high[d] = std::max(high[d], centre(order[i], d));
            }
        const Vec size = high - low;
        const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        const int middle = (from + to) / 2;
        std::nth_element(order.begin() + from, order.begin() + middle, order.begin() + to,
                         [&](int a, int b) { return centre(a, axis) < centre(b, axis); });
        return middle;
    };
    const int index = int(mesh.nodes.size());
    mesh.nodes.emplace_back();
    const int middle = split(begin, end);
    const int cut[5] = {begin, split(begin, middle), middle, split(middle, end), end};
    for (int c = 0; c < 4; ++c) {
        Vec low{1e30, 1e30, 1e30}, high = -low;
        for (int i = cut[c]; i < cut[c + 1]; ++i) {
            const DistanceMesh::Triangle& t = mesh.triangles[order[i]];
            for (const Vec& p : {t.corner, t.corner + t.to_second, t.corner + t.to_third})
                for (int d = 0; d < 3; ++d) low[d] = std::min(low[d], p[d]), high[d] = std::max(high[d], p[d]);
        }
        for (int d = 0; d < 3; ++d) {  // rounded outward
            mesh.nodes[index].low[d][c] = std::nextafter(float(low[d]), -1e30f);
            mesh.nodes[index].high[d][c] = std::nextafter(float(high[d]), 1e30f);
        }
        const int count = cut[c + 1] - cut[c];
        const int child = count > 4   ? build_tree(mesh, order, cut[c], cut[c + 1])
                          : count > 0 ? ~(8 * cut[c] + count - 1)
                                      : ~0;
        mesh.nodes[index].child[c] = child;
        if (count == 0)
            for (int d = 0; d < 3; ++d) mesh.nodes[index].low[d][c] = 1e18f, mesh.nodes[index].high[d][c] = 1e18f;
    }
    return index;
}

/// Nearest point of a triangle relative to x, and which of its normals counts (Ericson 2005, section 5.1.5).
struct Nearest {
    Vec offset;  ///< from the point to x
    int feature;
};
Nearest nearest_of(const DistanceMesh::Triangle& t, const Vec& x) {
    const Vec &ab = t.to_second, &ac = t.to_third, ap = x - t.corner;
    const double d1 = dot(ab, ap), d2 = dot(ac, ap);
    if (d1 <= 0 && d2 <= 0) return {ap, 4};
    const Vec bp = ap - ab;
    const double d3 = dot(ab, bp), d4 = dot(ac, bp);
    if (d3 >= 0 && d4 <= d3) return {bp, 5};
    const Vec cp = ap - ac;
    const double d5 = dot(ab, cp), d6 = dot(ac, cp);
    if (d6 >= 0 && d5 <= d6) return {cp, 6};
    const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return {ap - (d1 / (d1 - d3)) * ab, 1};
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return {ap - (d2 / (d2 - d6)) * ac, 3};
    if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return {bp - ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (ac - ab), 2};
    const double s = 1 / (va + vb + vc);
    return {ap - (vb * s) * ab - (vc * s) * ac, 0};
}

void set_mass(DistanceMesh& mesh) {
    // Sums over tetrahedra between each triangle and the first vertex.
    const Vec origin = mesh.triangles[0].corner;
    Vec first{0, 0, 0};
    Mat3<double> second = Mat3<double>::zero();  // integral of x x'
    for (const DistanceMesh::Triangle& t : mesh.triangles) {
        const Vec a = t.corner - origin, b = a + t.to_second, c = a + t.to_third, sum = a + b + c;
        const double volume = dot(a, cross(b, c)) / 6;
        mesh.volume += volume;
        first += (volume / 4) * sum;
        second = second + (volume / 20) * (outer(a, a) + outer(b, b) + outer(c, c) + outer(sum, sum));
    }
    const Vec m = (1 / mesh.volume) * first;
    mesh.centroid = origin + m;
    const Mat3<double> about = second - mesh.volume * outer(m, m);
    mesh.inertia = (about[0][0] + about[1][1] + about[2][2]) * Mat3<double>::identity() - about;
}

/// Vertices about which faces fill less than a round angle, by more than this [rad]: a corner of a box lacks 1.57, a
/// vertex on an edge or of something round nothing. (What a vertex lacks is the surface's curvature there.)
constexpr double sharp = 0.5;

void set_corners(DistanceMesh& mesh) {
    const Surface& s = mesh.surface;
    std::vector<double> around(s.vertices.size(), 0);
    for (const auto& t : s.triangles)
        for (int k = 0; k < 3; ++k) {
            const Vec a = vertex(s, t[(k + 1) % 3]) - vertex(s, t[k]), b = vertex(s, t[(k + 2) % 3]) - vertex(s, t[k]);
            around[t[k]] += std::atan2(norm(cross(a, b)), dot(a, b));
        }
    for (int i = 0; i < int(s.vertices.size()); ++i)
        if (around[i] > 0 && around[i] < 2 * M_PI - sharp) mesh.corners.push_back(vertex(s, i));
}

}  // namespace

namespace {

/// What a node knows of its four children.
using Four = float __attribute__((vector_size(16)));
Four load_four(const float* p) {
    Four four;
    std::memcpy(&four, p, sizeof four);
    return four;
}

}  // namespace

Found nearest_triangle(const DistanceMesh& mesh, const Vec& x, int guess) {
    struct Entry {
        float distance2;
        int child;
    };
    std::array<Entry, 128> stack;
    int top = 0;
    stack[top++] = {0, 0};
    const Nearest first = nearest_of(mesh.triangles[guess], x);
    Found found{first.offset, dot(first.offset, first.offset), guess, first.feature};
    const double& best = found.distance2;
    const float p[3] = {float(x.x), float(x.y), float(x.z)};
    while (top > 0) {
        const Entry entry = stack[--top];
        if (double(entry.distance2) > best) continue;
        if (entry.child < 0) {
            const int first = ~entry.child / 8, count = ~entry.child % 8 + 1;
            for (int i = first; i < first + count; ++i) {
                const Nearest n = nearest_of(mesh.triangles[i], x);
                const double d2 = dot(n.offset, n.offset);
                if (d2 < best) found = {n.offset, d2, i, n.feature};
            }
            continue;
        }
        const DistanceMesh::Node& node = mesh.nodes[entry.child];
        Four d2{};
        for (int d = 0; d < 3; ++d) {
            const Four below = load_four(node.low[d].data()) - p[d], above = p[d] - load_four(node.high[d].data());
            Four out = below > above ? below : above;
            out = out > 0 ? out : Four{};
            d2 += out * out;
        }
        d2 *= 0.9999f;
        // Nearest last, so that it is taken first. Boxes are rounded outward, but x is rounded, too.
        const float bound = best < 1e30 ? float(best) * 1.00001f : 1e30f;
        const int base = top;
        for (int c = 0; c < 4; ++c) {
            const float d = d2[c];
            if (d > bound) continue;
            int at = top++;
            for (; at > base && stack[at - 1].distance2 < d; --at) stack[at] = stack[at - 1];
            stack[at] = {d, node.child[c]};
        }
    }
    return found;
}

MeshPoint signed_point(const DistanceMesh& mesh, const Found& f) {
    const Vec& n = mesh.normals[f.triangle][f.feature];
    const double along = dot(f.offset, n);
    // A face's own normal, and an edge's or corner's where nothing but rounding lies beside it, as between faces of one
    // plane: of a point that all but touches, the way to the surface is itself no more than rounding (a can that stood
    // on triangles took 200 iterations in every step).
    if (f.feature == 0 || norm(f.offset - along * n) < fitted::rounded_offset) return {along, n};
    const double distance = std::sqrt(f.distance2);
    return along < 0 ? MeshPoint{-distance, (-1 / distance) * f.offset}
                     : MeshPoint{distance, (1 / distance) * f.offset};
}

DistanceMesh build_distance_mesh(const Surface& surface, double smoothing) {
    DistanceMesh mesh;
    mesh.surface = surface;
    mesh.triangles.resize(surface.triangles.size());
    mesh.normals.resize(surface.triangles.size());
    set_normals(mesh);
    set_mass(mesh);
    std::vector<int> order(mesh.triangles.size());
    std::iota(order.begin(), order.end(), 0);
    build_tree(mesh, order, 0, int(order.size()));
    std::vector<DistanceMesh::Triangle> sorted;
    std::vector<std::array<Vec, 7>> sorted_normals;
    for (int i : order) sorted.push_back(mesh.triangles[i]), sorted_normals.push_back(mesh.normals[i]);
    mesh.triangles = std::move(sorted);
    mesh.normals = std::move(sorted_normals);
    set_corners(mesh);
    build_field(mesh, smoothing);
    set_points(mesh);  // which asks for distances
    return mesh;
}

}  // namespace palpate
