// Points of a mesh at which its contact with other objects is decided.

#include <algorithm>
#include <cmath>

#include "engine/contact/mesh_distance_field.h"

namespace palpate {

namespace {

using Vec = Vec3<double>;

Vec mesh_vertex(const DistanceMesh& mesh, int i) {
    const auto& v = mesh.surface.vertices[std::size_t(i)];
    return {v[0], v[1], v[2]};
}

/// Outermost vertices in directions spread evenly (a Fibonacci lattice).
std::vector<int> outermost(const DistanceMesh& mesh) {
    std::vector<int> found;
    constexpr int directions = 1500;
    for (int k = 0; k < directions; ++k) {
        const double z = 1 - (2 * k + 1.0) / directions, r = std::sqrt(1 - z * z), phi = 2.399963229728653 * k;
        const Vec d{r * std::cos(phi), r * std::sin(phi), z};
        int best = 0;
        for (int i = 1; i < int(mesh.surface.vertices.size()); ++i)
            if (dot(d, mesh_vertex(mesh, i) - mesh_vertex(mesh, best)) > 0) best = i;
        if (std::find(found.begin(), found.end(), best) == found.end()) found.push_back(best);
    }
    return found;
}

/// The first of these points, and then always the one farthest from all taken before, until there are `most` or none is
/// farther than `apart` [m].
std::vector<int> spread_out(const std::vector<Vec>& points, std::size_t first, std::size_t most, double apart) {
    std::vector<int> taken;
    std::vector<double> nearest(points.size(), 1e300);
    for (std::size_t next = 0; taken.size() < std::min(most, points.size());) {
        if (taken.size() >= first && !(nearest[next] > apart)) break;
        taken.push_back(int(next));
        for (std::size_t i = 0; i < points.size(); ++i)
            nearest[i] = std::min(nearest[i], norm(points[i] - points[next]));
        next = taken.size() < first ? taken.size()
                                    : std::size_t(std::max_element(nearest.begin(), nearest.end()) - nearest.begin());
    }
    return taken;
}

/// A ball of radius r that touches the faces around a vertex from within: corners are as round there.
DistanceMesh::Ball inside_corner(const DistanceMesh& mesh, int vertex, double r) {
    Vec sum{0, 0, 0};
    std::vector<Vec> faces;
    for (const auto& t : mesh.surface.triangles)
        for (int k = 0; k < 3; ++k) {
            if (t[std::size_t(k)] != vertex) continue;
            const Vec p = mesh_vertex(mesh, vertex), a = mesh_vertex(mesh, t[std::size_t((k + 1) % 3)]) - p,
                      b = mesh_vertex(mesh, t[std::size_t((k + 2) % 3)]) - p, n = cross(a, b);
            if (!(norm(n) > 0)) continue;
            faces.push_back((1 / norm(n)) * n);
            sum += std::atan2(norm(n), dot(a, b)) * faces.back();
        }
    if (!(norm(sum) > 0)) return {mesh_vertex(mesh, vertex), 0};
    const Vec normal = (1 / norm(sum)) * sum;
    double most_turned = 1;  // cosine between it and a face
    for (const Vec& n : faces) most_turned = std::min(most_turned, dot(normal, n));
    return {mesh_vertex(mesh, vertex) - (r / std::max(most_turned, 0.3)) * normal, r};
}

}  // namespace

void set_points(DistanceMesh& mesh) {
    const std::vector<int> found = outermost(mesh);
    std::vector<Vec> points;
    for (int i : found) points.push_back(mesh_vertex(mesh, i));
    constexpr std::size_t most = 64, most_support = 256;
    Vec low = points[0], high = points[0];
    for (const Vec& p : points)
        for (int d = 0; d < 3; ++d) low[d] = std::min(low[d], p[d]), high[d] = std::max(high[d], p[d]);
    const Vec size = high - low;
    // As corners of boxes are (features_of): sharp ones on edges would be no farther from a way up than from one out.
    const double r = std::min(2e-4, 0.01 * std::min({size.x, size.y, size.z}));
    for (int i : spread_out(points, 1, most_support, 0)) {
        mesh.support.push_back(points[std::size_t(i)]);
        if (mesh.balls.size() < most) mesh.balls.push_back(inside_corner(mesh, found[std::size_t(i)], r));
    }
    // And on faces, where what is smaller than they are would pass between corners: points spread evenly over triangles
    // (by the sequence R2, folded), by their areas.
    double area = 0;
    for (const DistanceMesh::Triangle& t : mesh.triangles) area += 0.5 * norm(cross(t.to_second, t.to_third));
    constexpr int tried = 2048;
    std::vector<Vec> candidates;
    for (const DistanceMesh::Ball& b : mesh.balls) candidates.push_back(b.centre);
    double share = 0;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        const DistanceMesh::Triangle& k = mesh.triangles[t];
        share += tried * 0.5 * norm(cross(k.to_second, k.to_third)) / area;
        for (int n = 1; share >= 0.5; --share, ++n) {
            double u = std::fmod(0.5 + 0.7548776662466927 * n, 1.0), v = std::fmod(0.5 + 0.5698402909980532 * n, 1.0);
            if (u + v > 1) u = 1 - u, v = 1 - v;
            const Vec inside = k.corner + u * k.to_second + v * k.to_third - r * mesh.normals[t][0];
            // Near edges, a ball that touches one face sticks out of another.
            if (mesh_distance(mesh, inside).distance < -0.99 * r) candidates.push_back(inside);
        }
    }
    const std::size_t corners = mesh.balls.size();
    for (int i : spread_out(candidates, corners, 2 * most, std::max(0.04 * norm(size), 4 * r)))
        if (std::size_t(i) >= corners) mesh.balls.push_back({candidates[std::size_t(i)], r});
}

}  // namespace palpate
