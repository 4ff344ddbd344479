#include "meshes/curved_skin.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>

#include "meshes/conforming_mesh.h"
#include "meshes/finger_shape.h"

namespace palpate {
namespace {

constexpr double degree = std::numbers::pi / 180;

double reach(const std::vector<Point>& points, const Point& d) {
    double far = -1;
    for (const Point& p : points) far = std::max(far, p[0] * d[0] + p[1] * d[1] + p[2] * d[2]);
    return far;
}

/// Against the dense surface that the meshes are made of: within 0.025 mm at every angle, where the flattest mesh's
/// nodes are up to four times as far off.
TEST(CurvedSkin, ReachesAsFarAsTheSurfaceWhateverTheMesh) {
    const Surface skin = finger_surface(finger_shape("index"));
    double nodes_off = 0;
    for (const int elements : {347, 1000, 4000}) {
        if (elements == 4000 && !testing::is_tried(1, 2)) continue;
        const TetMesh mesh = conforming_mesh(skin, {}, {}, {.elements = elements});
        for (const double angle : {0., 10., 20., 30., 40., 50.})
            for (const double roll : {-30., 0., 30.}) {
                const double pitch = angle * degree, around = roll * degree;
                const Point down{std::sin(pitch), std::cos(pitch) * std::sin(around),
                                 -std::cos(pitch) * std::cos(around)};
                const double true_reach = reach(skin.vertices, down);
                EXPECT_NEAR(reach_of_curved_skin(mesh, down), true_reach, 2.5e-5)
                    << elements << " elements, " << angle << " and " << roll << " degrees";
                std::vector<Point> pad;
                for (int i : mesh.pad_nodes) pad.push_back(mesh.nodes[std::size_t(i)]);
                nodes_off = std::max(nodes_off, true_reach - reach(pad, down));
            }
    }
    EXPECT_GT(nodes_off, 6e-5) << "nodes alone would do";
}

/// A cube's edges are edges; an icosahedron is a coarse ball, and its edges are none of what it stands for.
TEST(CurvedSkin, StopsAtEdges) {
    const auto closed = [](std::vector<Point> nodes, std::vector<std::array<int, 3>> surface) {
        TetMesh mesh;
        mesh.nodes = std::move(nodes), mesh.surface = std::move(surface);
        for (int i = 0; i < int(mesh.nodes.size()); ++i) mesh.pad_nodes.push_back(i);
        return mesh;
    };
    const double r = 1e-2, s = 1 / std::sqrt(3.0);
    const TetMesh cube =
        closed({{-r, -r, -r}, {r, -r, -r}, {r, r, -r}, {-r, r, -r}, {-r, -r, r}, {r, -r, r}, {r, r, r}, {-r, r, r}},
               {{0, 2, 1},
                {0, 3, 2},
                {4, 5, 6},
                {4, 6, 7},
                {0, 1, 5},
                {0, 5, 4},
                {1, 2, 6},
                {1, 6, 5},
                {2, 3, 7},
                {2, 7, 6},
                {3, 0, 4},
                {3, 4, 7}});
    EXPECT_NEAR(reach_of_curved_skin(cube, {0, 0, -1}), r, 1e-12);
    EXPECT_NEAR(reach_of_curved_skin(cube, {s, s, s}), r * 3 * s, 1e-12);
    // Whose faces' normals are 42 degrees apart.
    const double g = (1 + std::sqrt(5.0)) / 2, k = r / std::sqrt(1 + g * g);
    const TetMesh ball = closed({{-k, g * k, 0},
                                 {k, g * k, 0},
                                 {-k, -g * k, 0},
                                 {k, -g * k, 0},
                                 {0, -k, g * k},
                                 {0, k, g * k},
                                 {0, -k, -g * k},
                                 {0, k, -g * k},
                                 {g * k, 0, -k},
                                 {g * k, 0, k},
                                 {-g * k, 0, -k},
                                 {-g * k, 0, k}},
                                {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                                 {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                                 {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}});
    TetMesh finer = ball;
    finer.surface.clear();
    std::map<std::array<int, 2>, int> middle;
    const auto between = [&](int a, int b) {
        const auto [it, fresh] = middle.try_emplace({std::min(a, b), std::max(a, b)}, int(finer.nodes.size()));
        if (fresh) {
            Point m;
            for (std::size_t d = 0; d < 3; ++d) m[d] = ball.nodes[std::size_t(a)][d] + ball.nodes[std::size_t(b)][d];
            const double scale = r / std::hypot(m[0], m[1], m[2]);
            for (double& x : m) x *= scale;
            finer.pad_nodes.push_back(it->second);
            finer.nodes.push_back(m);
        }
        return it->second;
    };
    for (const auto& [a, b, c] : ball.surface) {
        const int ab = between(a, b), bc = between(b, c), ca = between(c, a);
        finer.surface.insert(finer.surface.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    const double to_face = 0.934 * r;  // of those in the middle of the icosahedron's
    EXPECT_NEAR(reach_of_curved_skin(ball, {s, s, s}), 0.87 * r, 0.01 * r);
    EXPECT_NEAR(reach_of_curved_skin(finer, {s, s, s}), r, 0.15 * (r - to_face));
}

}  // namespace
}  // namespace palpate
