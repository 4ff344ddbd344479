// How thick walls are: rays from the surface inwards.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/contact/fitted.h"
#include "engine/contact/mesh_distance_field.h"

namespace palpate {

namespace {

using Vec = Vec3<double>;

using namespace fitted;

/// A ray's first way out of the mesh.
struct Hit {
    double distance;  ///< [m]
    int triangle = -1;
};

/// Moeller and Trumbore 1997.
void hit_triangle(const DistanceMesh& mesh, int index, const Vec& from, const Vec& along, Hit& hit) {
    const DistanceMesh::Triangle& t = mesh.triangles[index];
    const Vec p = cross(along, t.to_third);
    const double det = dot(t.to_second, p);
    if (det == 0) return;
    const Vec s = from - t.corner, q = cross(s, t.to_second);
    const double u = dot(s, p) / det, v = dot(along, q) / det, distance = dot(t.to_third, q) / det;
    if (u >= 0 && v >= 0 && u + v <= 1 && distance > least_distance && distance < hit.distance) hit = {distance, index};
}

/// Which of a node's boxes the ray meets within `most`.
std::array<bool, 4> met_boxes(const DistanceMesh::Node& node, const Vec& from, const Vec& along, double most) {
    std::array<bool, 4> met;
    for (int c = 0; c < 4; ++c) {
        double enter = 0, leave = most;
        for (int d = 0; d < 3; ++d) {
            const double inverse = 1 / (std::abs(along[d]) > 1e-12 ? along[d] : 1e-12);
            const double a = (node.low[d][c] - 1e-7 - from[d]) * inverse;
            const double b = (node.high[d][c] + 1e-7 - from[d]) * inverse;
            enter = std::max(enter, std::min(a, b)), leave = std::min(leave, std::max(a, b));
        }
        met[c] = enter <= leave;
    }
    return met;
}

Hit first_hit(const DistanceMesh& mesh, const Vec& from, const Vec& along, double most) {
    std::array<int, 128> stack;
    int top = 0;
    stack[top++] = 0;
    Hit hit{most};
    while (top > 0) {
        const int child = stack[--top];
        if (child < 0) {
            const int first = ~child / 8, count = ~child % 8 + 1;
            for (int i = first; i < first + count; ++i) hit_triangle(mesh, i, from, along, hit);
            continue;
        }
        const std::array<bool, 4> met = met_boxes(mesh.nodes[child], from, along, hit.distance);
        for (int c = 0; c < 4; ++c)
            if (met[c]) stack[top++] = mesh.nodes[child].child[c];
    }
    return hit;
}

}  // namespace

std::vector<WallPoint> thin_walls(const DistanceMesh& mesh, double spacing, double thickest) {
    std::vector<WallPoint> walls;
    double total = 0;
    for (const DistanceMesh::Triangle& t : mesh.triangles) total += 0.5 * norm(cross(t.to_second, t.to_third));
    const double share = std::max(spacing * spacing, total / most_points);
    // Points spread evenly by area: a triangle has its share, and what is left of a point goes to the next one; where
    // in the triangle says a low-discrepancy sequence (Roberts 2018).
    double due = 0.5;
    int sequence = 0;
    for (int index = 0; index < int(mesh.triangles.size()); ++index) {
        const DistanceMesh::Triangle& t = mesh.triangles[index];
        const Vec inwards = -mesh.normals[index][0];
        for (due += 0.5 * norm(cross(t.to_second, t.to_third)) / share; due >= 1; due -= 1) {
            ++sequence;
            double u = std::fmod(0.7548776662466927 * sequence, 1), v = std::fmod(0.5698402909980532 * sequence, 1);
            if (u + v > 1) u = 1 - u, v = 1 - v;
            const Vec point = t.corner + u * t.to_second + v * t.to_third;
            const Hit hit = first_hit(mesh, point, inwards, thickest);
            if (hit.triangle >= 0 && dot(mesh.normals[hit.triangle][0], inwards) > facing_away)
                walls.push_back({point, hit.distance});
        }
    }
    return walls;
}

}  // namespace palpate
