// Triangle meshes as objects: distance and sign against brute force, the smooth field, mass, and a body of a mesh.

#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <random>

#include "engine/bodies/rigid_body.h"
#include "engine/contact/mesh_spline.h"
#include "engine/step.h"
#include "meshes/input_error.h"
#include "meshes/triangle_tree.h"
#include "scenes/load/scene.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// The surface of a box of n x n squares a side, blown up towards a sphere by `round` (0: box, 1: sphere).
Surface box_surface(const Vec3<double>& half, int n, double round = 0) {
    Surface s;
    std::map<std::array<int, 3>, int> index;
    auto vertex = [&](std::array<int, 3> key) {
        auto [it, fresh] = index.try_emplace(key, int(s.vertices.size()));
        if (fresh) {
            Vec3<double> p;
            for (int d = 0; d < 3; ++d) p[d] = 2.0 * key[d] / n - 1;
            p = (1 - round + round / norm(p)) * p;
            s.vertices.push_back({half.x * p.x, half.y * p.y, half.z * p.z});
        }
        return it->second;
    };
    for (int axis = 0; axis < 3; ++axis)
        for (int side : {0, n})
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j) {
                    auto at = [&](int u, int v) {
                        std::array<int, 3> key{};
                        key[axis] = side, key[(axis + 1) % 3] = u, key[(axis + 2) % 3] = v;
                        return vertex(key);
                    };
                    const int a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
                    if (side)
                        s.triangles.push_back({a, b, c}), s.triangles.push_back({a, c, d});
                    else
                        s.triangles.push_back({a, c, b}), s.triangles.push_back({a, d, c});
                }
    return s;
}

Surface mug() { return read_surface(testing::source_dir() + "/scenes/mug.obj", "mm").surface; }

/// Distance by every triangle, sign by the solid angle that the surface fills (van Oosterom & Strackee 1983).
double brute_distance(const Surface& s, const Vec3<double>& x) {
    const Eigen::Vector3d p(x.x, x.y, x.z);
    double best = 1e300, angle = 0;
    for (const auto& t : s.triangles) {
        Eigen::Vector3d c[3];
        for (int k = 0; k < 3; ++k) c[k] = Eigen::Map<const Eigen::Vector3d>(s.vertices[t[k]].data());
        best = std::min(best, (nearest_on_triangle(p, c[0], c[1], c[2]) - p).norm());
        const Eigen::Vector3d a = c[0] - p, b = c[1] - p, d = c[2] - p;
        const double la = a.norm(), lb = b.norm(), ld = d.norm();
        angle += 2 * std::atan2(a.dot(b.cross(d)), la * lb * ld + a.dot(b) * ld + b.dot(d) * la + d.dot(a) * lb);
    }
    return std::abs(angle) > 2 * M_PI ? -best : best;
}

TEST(MeshObject, DistanceAndSignAreThoseOfBruteForce) {
    // Brute force on the mug takes a millisecond a point.
    const char* asked = std::getenv("PALPATE_DISTANCE_POINTS");
    const int mug_points = asked ? std::atoi(asked) : 400;
    struct Case {
        Surface surface;
        int points;
    };
    for (const Case& c : {Case{box_surface({0.02, 0.03, 0.01}, 3), 100000},
                          Case{box_surface({0.03, 0.03, 0.02}, 5, 0.7), 5000}, Case{mug(), mug_points}}) {
        const DistanceMesh mesh = build_distance_mesh(c.surface, 0);
        const auto box = bounds(c.surface.vertices);
        std::mt19937 random(5);
        std::uniform_real_distribution<double> u(-0.3, 1.3);
        double worst = 0, worst_direction = 0;
        int wrong_sign = 0;
        for (int i = 0; i < c.points; ++i) {
            Vec3<double> x;
            for (int d = 0; d < 3; ++d) x[d] = box[0][d] + u(random) * (box[1][d] - box[0][d]);
            const MeshPoint p = mesh_distance(mesh, x);
            const double expected = brute_distance(c.surface, x);
            worst = std::max(worst,
                             std::abs(std::abs(p.distance) - std::abs(expected)) / std::max(1e-6, std::abs(expected)));
            wrong_sign += (p.distance < 0) != (expected < 0);
            if (i % 10) continue;  // the normal leads to the surface
            worst_direction = std::max(worst_direction, std::abs(brute_distance(c.surface, x - p.distance * p.normal)));
        }
        EXPECT_LT(worst, 1e-6);
        EXPECT_LT(worst_direction, 1e-9);
        EXPECT_EQ(wrong_sign, 0);
    }
}

/// Splines over cells of noise: derivatives are those of the values, in between and over the borders of cells; and
/// every set of instructions gives the same bits.
TEST(MeshObject, SplinesOverCellsHaveTheirDerivatives) {
    std::mt19937 random(7);
    std::normal_distribution<float> noise(0, 1e-3f);
    std::uniform_real_distribution<double> place(-0.5, 0.5);
    const double per_cell = 400;
    for (int trial = 0; trial < 200; ++trial) {
        std::array<float, 4 * 4 * 4 + 1> cells{};
        for (float& v : cells) v = noise(random);
        const CellBlock block{cells.data(), 4, 16};
        const Vec3<double> at{place(random), place(random), place(random)};
        const SampledField f = spline_field(at, per_cell, block), plain = plain_spline_field(at, per_cell, block);
        EXPECT_EQ(0, std::memcmp(&f, &plain, sizeof f));
        // Away from what counts as near there are no second derivatives, and all else is as it was.
        const double value = std::abs(f.value);
        SampledField near = spline_field(at, per_cell, block, 1.001 * value),
                     far = spline_field(at, per_cell, block, 0.999 * value);
        EXPECT_EQ(0, std::memcmp(&f, &near, sizeof f));
        for (int d = 0; d < 3; ++d)
            for (int e = 0; e < 3; ++e) EXPECT_EQ(far.hessian[d][e], 0);
        far.hessian = f.hessian;
        EXPECT_EQ(0, std::memcmp(&f, &far, sizeof f));
        const double h = 1e-4;  // cells
        for (int d = 0; d < 3; ++d) {
            Vec3<double> low = at, high = at;
            low[d] -= h, high[d] += h;
            const SampledField a = spline_field(low, per_cell, block), b = spline_field(high, per_cell, block);
            EXPECT_NEAR(f.gradient[d], per_cell * (b.value - a.value) / (2 * h), 1e-7);
            for (int e = 0; e < 3; ++e)
                EXPECT_NEAR(f.hessian[e][d], per_cell * (b.gradient[e] - a.gradient[e]) / (2 * h), 1e-4);
        }
        // From the right side of one cell, and from the left side of the next.
        const SampledField left = spline_field({0.5, at.y, at.z}, per_cell, block),
                           right = spline_field({-0.5, at.y, at.z}, per_cell, {cells.data() + 1, 4, 16});
        EXPECT_NEAR(left.value, right.value, 1e-15);
        EXPECT_LT(norm(left.gradient - right.gradient), 1e-12);
    }
}

TEST(MeshObject, TheSmoothFieldIsItsOwnGradientAndNearTheSurface) {
    const Surface surface = mug();
    const DistanceMesh mesh = build_distance_mesh(surface);
    std::mt19937 random(6);
    std::uniform_real_distribution<double> u(-1, 1);
    double sum = 0, worst = 0;
    int count = 0;
    for (int i = 0; i < 2000; ++i) {
        const auto& t = mesh.triangles[random() % mesh.triangles.size()];
        const Vec3<double> on = t.corner + (1.0 / 3) * (t.to_second + t.to_third);
        const Vec3<double> x = on + 5e-4 * Vec3<double>{u(random), u(random), u(random)};
        const MeshPoint p = mesh_contact_distance(mesh, x);
        for (int d = 0; d < 3; ++d) {
            Vec3<double> high = x, low = x;
            high[d] += 1e-7, low[d] -= 1e-7;
            const double slope =
                (mesh_contact_distance(mesh, high).distance - mesh_contact_distance(mesh, low).distance) / 2e-7;
            EXPECT_NEAR(slope, p.normal[d], 1e-4);
        }
        const double error = std::abs(p.distance - mesh_distance(mesh, x).distance);
        sum += error, worst = std::max(worst, error), ++count;
    }
    std::printf("smooth field of the mug, cells of %.1f mm: %.3f mm off on average, %.2f mm at its edges\n",
                1e3 * mesh.cell, 1e3 * sum / count, 1e3 * worst);
    EXPECT_LT(sum / count, 0.15e-3);
    EXPECT_LT(worst, mesh.cell);
    // Far out: never too far, never near enough to touch.
    for (int i = 0; i < 1000; ++i) {
        const Vec3<double> x{0.3 * u(random), 0.3 * u(random), 0.3 * u(random)};
        const double exact = mesh_distance(mesh, x).distance, seen = mesh_contact_distance(mesh, x).distance;
        if (exact > 0.02) {
            EXPECT_GT(seen, 3e-3);
            EXPECT_LE(seen, exact + mesh.cell);
        }
    }
}

TEST(MeshObject, OpenMeshesAreRefusedByTheirFirstBadEdgesAndSeveralPartsAreNot) {
    testing::ScratchFolder scratch;
    auto write = [&](const char* name, const Surface& s, bool twice) {
        std::ofstream out(scratch.path / name);
        for (double shift : {0.0, 0.3})
            for (const Point& p : s.vertices)
                if (shift == 0 || twice) out << "v " << p[0] + shift << " " << p[1] << " " << p[2] << "\n";
        for (int shift : {0, int(s.vertices.size())})
            for (const auto& t : s.triangles)
                if (shift == 0 || twice)
                    out << "f " << t[0] + 1 + shift << " " << t[1] + 1 + shift << " " << t[2] + 1 + shift << "\n";
    };
    Surface s = box_surface({0.05, 0.05, 0.05}, 2);
    write("two.obj", s, true);
    EXPECT_EQ(read_surface(scratch.path / "two.obj", "m", SurfaceUse::object).surface.triangles.size(),
              2 * s.triangles.size());
    s.triangles.pop_back();
    write("open.obj", s, false);
    std::ofstream(scratch.path / "scene.toml")
        << "[[object]]\nkind = \"mesh\"\nfile = \"open.obj\"\nunit = \"m\"\nmass_g = 10\n[[finger]]\n";
    try {
        load_scene(scratch.path / "scene.toml");
        FAIL() << "an open mesh was accepted";
    } catch (const InputError& error) {
        const std::string what = error.what();
        EXPECT_NE(what.find("scene.toml:3"), std::string::npos) << what;
        EXPECT_NE(what.find("is open: 3 edges, the first from vertex"), std::string::npos) << what;
    }
}

TEST(MeshObject, MassIsThatOfTheSolid) {
    const Shape box{ShapeKind::box, {0.01, 0.02, 0.03}};
    Surface s = box_surface(box.size, 2);
    for (Point& p : s.vertices) p[0] += 0.1;
    const DistanceMesh mesh = build_distance_mesh(s);
    Shape shape;
    shape.kind = ShapeKind::mesh;
    shape.mesh = &mesh;
    const RigidBody a = solid_body(shape, 0.5), b = solid_body(box, 0.5);
    EXPECT_NEAR(volume_of(shape), volume_of(box), 1e-12);
    EXPECT_NEAR(a.mass_centre.x, 0.1, 1e-9);
    for (int i = 0; i < 9; ++i) EXPECT_NEAR(a.inertia.m[i / 3][i % 3], b.inertia.m[i / 3][i % 3], 1e-10);
}

/// A box of triangles does what a box does: slides, sticks, and lies on the plane.
TEST(MeshObject, ABoxOfTrianglesSlidesLikeABox) {
    const Vec3<double> half{0.02, 0.02, 0.01};
    const auto mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(box_surface(half, 4)));
    for (double angle : {0.2, 0.6}) {
        SceneSpec spec;
        spec.gravity = {9.81 * std::sin(angle), 0, -9.81 * std::cos(angle)};
        spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.4});
        ObjectSpec o{"box", {ShapeKind::mesh, {0, 0, 0}, mesh.get()}, {{0, 0, 0.01}, {1, 0, 0, 0}}, 0.4};
        o.mesh = mesh;
        o.body = solid_body(o.shape, 0.1);
        spec.objects.push_back(o);
        World world = build_world(spec);
        Threads threads(1);
        for (int k = 0; k < 60; ++k) step(world, threads);
        const double t = 0.3, a = std::max(0.0, 9.81 * (std::sin(angle) - 0.4 * std::cos(angle)));
        EXPECT_NEAR(world.shapes[1].pose.position.x, 0.5 * a * t * (t + 0.005), 0.01 * 0.5 * a * t * t + 1e-6);
        EXPECT_NEAR(world.shapes[1].pose.position.z, 0.01, 1e-5);
    }
}

/// A cylinder stands on plates of triangles, thin and thick, level and sloping across the grid of their smooth field,
/// and is at rest there: steps converge.
TEST(MeshObject, ACylinderStandsOnTriangles) {
    const Shape can{ShapeKind::cylinder, {0.01, 0.01, 0}};
    int number = 0;
    for (double slope : {0.0, 0.3})
        for (double half : {0.004, 0.02})
            for (double smoothing : {-1.0, 0.0}) {
                const Quaternion<double> turn{std::cos(slope / 2), 0, std::sin(slope / 2), 0};
                const Vec3<double> normal = rotation_matrix(turn).column(2);
                Surface s = box_surface({0.1, 0.05, half}, 6);
                for (Point& p : s.vertices) {
                    const Vec3<double> x = rotation_matrix(turn) * Vec3<double>{p[0], p[1], p[2]};
                    p = {x.x, x.y, x.z};
                }
                const auto mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(s, smoothing));
                for (double dt : {1e-3, 5e-3, 20e-3}) {
                    if (!testing::is_tried(number++, 5)) continue;
                    SceneSpec spec;
                    spec.solver.dt = dt;
                    ObjectSpec below{"plate", {ShapeKind::mesh, {0, 0, 0}, mesh.get()}, Pose<double>::identity(), 0.5};
                    below.mesh = mesh;
                    ObjectSpec o{"can", can, {(half + 0.01) * normal, turn}, 0.5};
                    o.body = solid_body(can, 0.02);
                    spec.objects = {below, o};
                    World world = build_world(spec);
                    Threads threads(1);
                    int steps = 0, converged = 0;
                    while (world.time < 0.3) {
                        step(world, threads);
                        if (world.time > 0.1) ++steps, converged += world.bodies[0].converged;
                    }
                    const auto where = ::testing::Message() << "slope " << slope << ", half " << half << ", smoothing "
                                                            << smoothing << ", " << 1e3 * dt << " ms";
                    EXPECT_GE(converged, 0.9 * steps) << where;
                    EXPECT_NEAR(norm(world.shapes[1].pose.position - o.pose.position), 0, 3e-5) << where;
                }
            }
}

/// Boxes of triangles stand on each other as boxes do, however few vertices they have, and where those lie.
TEST(MeshObject, BoxesOfTrianglesStandOnEachOther) {
    const Vec3<double> half{0.01, 0.01, 0.01};
    for (int parts : {1, 8}) {
        const auto mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(box_surface(half, parts)));
        const Shape of_mesh{ShapeKind::mesh, {0, 0, 0}, mesh.get()}, box{ShapeKind::box, half};
        for (int kinds = 0; kinds < 3; ++kinds)  // both of triangles, then either
            for (double aside : {0.0, 0.002})
                for (double dt : {1e-3, 5e-3, 20e-3}) {
                    SceneSpec spec;
                    spec.solver.dt = dt;
                    spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
                    for (int k = 0; k < 2; ++k) {
                        const bool triangles = kinds == 0 || kinds == k + 1;
                        ObjectSpec o{"box",
                                     triangles ? of_mesh : box,
                                     {{k * aside, 0.5 * k * aside, 0.01 + 0.025 * k}, {1, 0, 0, 0}},
                                     0.5};
                        if (triangles) o.mesh = mesh;
                        o.body = solid_body(o.shape, 0.02);
                        spec.objects.push_back(o);
                    }
                    World world = build_world(spec);
                    Threads threads(1);
                    while (world.time < 0.4) step(world, threads);
                    const Vec3<double>&low = world.shapes[1].pose.position, &high = world.shapes[2].pose.position;
                    const auto where = ::testing::Message() << parts << " parts, kinds " << kinds << ", " << 1e3 * aside
                                                            << " mm aside, " << 1e3 * dt << " ms";
                    EXPECT_NEAR(low.z, 0.01, 1e-4) << where;
                    EXPECT_NEAR(high.z, 0.03, 1e-4) << where;
                    EXPECT_NEAR(high.x, aside, 1e-4) << where;
                }
    }
}

/// A prism of twelve sides that stands along z, about the origin.
Surface prism(double radius, double half) {
    Surface s;
    constexpr int sides = 12;
    for (int i = 0; i < sides; ++i) {
        const double angle = 2 * M_PI * i / sides, x = radius * std::cos(angle), y = radius * std::sin(angle);
        s.vertices.push_back({x, y, -half}), s.vertices.push_back({x, y, half});
    }
    s.vertices.push_back({0, 0, -half}), s.vertices.push_back({0, 0, half});
    for (int i = 0; i < sides; ++i) {
        const int a = 2 * i, b = 2 * ((i + 1) % sides);
        for (const std::array<int, 3>& t :
             {std::array{a, b, b + 1}, {a, b + 1, a + 1}, {2 * sides, b, a}, {2 * sides + 1, a + 1, b + 1}})
            s.triangles.push_back(t);
    }
    return s;
}

/// Of a box that is narrower than the prism on it, only edges at the prism's sides are inside the prism: they leave by
/// its foot all the same. (It was thrown aside and turned over, with a millijoule from nothing: random scene 5219360.)
TEST(MeshObject, WhatStandsTooLowOnANarrowBoxIsLifted) {
    const auto mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(prism(0.0075, 0.009)));
    for (double dt : {1e-3, 5e-3, 20e-3}) {
        SceneSpec spec;
        spec.solver.dt = dt;
        spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
        ObjectSpec box{"box", {ShapeKind::box, {0.01, 0.007, 0.006}}, {{0, 0, 0.006}, {1, 0, 0, 0}}, 0.5};
        box.body = solid_body(box.shape, 0.02);
        constexpr double overlap = 0.36e-3;
        ObjectSpec o{"prism", {ShapeKind::mesh, {0, 0, 0}, mesh.get()}, {{0, 0, 0.021 - overlap}, {1, 0, 0, 0}}, 0.5};
        o.mesh = mesh;
        o.body = solid_body(o.shape, 0.011);
        spec.objects.push_back(box), spec.objects.push_back(o);
        World world = build_world(spec);
        Threads threads(1);
        for (int k = 0; k < int(std::lround(0.2 / dt)); ++k) {
            step(world, threads);
            for (const RigidBody& b : world.bodies) EXPECT_LT(norm(b.velocity), 0.01) << dt << ", step " << k;
        }
        EXPECT_NEAR(norm(world.shapes[2].pose.position - Vec3<double>{0, 0, 0.021}), 0, 5e-5) << dt;
        EXPECT_NEAR(norm(world.shapes[1].pose.position - box.pose.position), 0, 5e-5) << dt;
    }
}

/// Balls that fall into a mug, and balls and cubes that fall on a plate of triangles, stay there in steps of any
/// length.
TEST(MeshObject, WhatFallsOnTrianglesStaysOnThem) {
    const auto of_mug = std::make_shared<const DistanceMesh>(build_distance_mesh(mug()));
    const auto plate = std::make_shared<const DistanceMesh>(build_distance_mesh(box_surface({0.05, 0.05, 0.0025}, 8)));
    const Shape ball{ShapeKind::sphere, {0.008, 0, 0}}, cube{ShapeKind::box, {0.01, 0.01, 0.01}};
    auto ends = [](const std::shared_ptr<const DistanceMesh>& mesh, const Shape& shape, double from, double dt) {
        SceneSpec spec;
        spec.solver.dt = dt;
        ObjectSpec below{"mesh", {ShapeKind::mesh, {0, 0, 0}, mesh.get()}, Pose<double>::identity(), 0.4};
        below.mesh = mesh;
        ObjectSpec o{"body", shape, {{0.005, 0.003, from}, {1, 0, 0, 0}}, 0.4};
        o.body = solid_body(shape, 0.01);
        spec.objects = {below, o};
        World world = build_world(spec);
        Threads threads(1);
        while (world.time < 0.8) step(world, threads);
        return world.shapes[1].pose.position.z;
    };
    for (double dt : {1e-3, 5e-3, 10e-3, 20e-3})
        for (double fall : {0.003, 0.02, 0.055, 0.07}) {
            const auto where = ::testing::Message() << 1e3 * fall << " mm, " << 1e3 * dt << " ms";
            EXPECT_NEAR(ends(of_mug, ball, 0.015 + fall, dt), 0.015, 1e-4) << where;
            EXPECT_NEAR(ends(plate, ball, 0.0105 + fall, dt), 0.0105, 1e-4) << where;
            EXPECT_NEAR(ends(plate, cube, 0.0125 + fall, dt), 0.0125, 1e-4) << where;
        }
}

/// A box that begins 1.7 mm inside a block of triangles no wider than itself leaves it upwards, slowly, and lies on it.
TEST(MeshObject, WhatOverlapsTrianglesLeavesThemByOneWay) {
    const auto block =
        std::make_shared<const DistanceMesh>(build_distance_mesh(box_surface({0.011, 0.0047, 0.008}, 3)));
    for (double dt : {1e-3, 2e-3, 5e-3}) {
        SceneSpec spec;
        spec.solver.dt = dt;
        ObjectSpec below{"mesh", {ShapeKind::mesh, {0, 0, 0}, block.get()}, Pose<double>::identity(), 0.4};
        below.mesh = block;
        ObjectSpec o{"body", {ShapeKind::box, {0.0065, 0.0043, 0.007}}, {{0, 0, 0.0133}, {1, 0, 0, 0}}, 0.4};
        o.body = solid_body(o.shape, 0.1);
        spec.objects = {below, o};
        World world = build_world(spec);
        Threads threads(1);
        double fastest = 0, moved = 0, before = o.pose.position.z;
        while (world.time < 0.3) {
            step(world, threads);
            fastest = std::max(fastest, norm(world.bodies[0].velocity));
            moved = std::max(moved, world.shapes[1].pose.position.z - before);
            before = world.shapes[1].pose.position.z;
        }
        EXPECT_LT(fastest, 0.1) << dt;  // (sideways, of what is less than a tenth of a millimetre inside)
        EXPECT_LT(moved, 1.3 * dt * spec.solver.recovery_speed) << dt;
        EXPECT_NEAR(before, 0.015, 1e-4) << dt;
    }
}

/// A mug stands on its foot, and a ball of triangles lies and rolls nearly as a ball does.
TEST(MeshObject, RoundMeshesStandAndRollOnPlanes) {
    auto ends = [](const Surface& surface, const Vec3<double>& at, const Vec3<double>& velocity, double spin) {
        const auto mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(surface));
        SceneSpec spec;
        spec.solver.dt = 2e-3;
        spec.objects.push_back({"plane", {}, Pose<double>::identity(), 1});
        ObjectSpec o{"mesh", {ShapeKind::mesh, {0, 0, 0}, mesh.get()}, {at, {1, 0, 0, 0}}, 1};
        o.mesh = mesh;
        o.body = solid_body(o.shape, 0.02);
        o.body->velocity = velocity;
        o.body->angular_momentum = {0, o.body->inertia[1][1] * spin, 0};
        spec.objects.push_back(o);
        World world = build_world(spec);
        Threads threads(1);
        while (world.time < 0.3) step(world, threads);
        return std::pair{world.shapes[1].pose.position, world.bodies[0].velocity};
    };
    const Surface foot = mug();
    double lowest = 1e300;
    for (const Point& p : foot.vertices) lowest = std::min(lowest, p[2]);
    EXPECT_NEAR(ends(foot, {0, 0, 1e-3 - lowest}, {0, 0, 0}, 0).first.z, -lowest, 3e-5);
    const Surface round = box_surface({0.015, 0.015, 0.015}, 12, 1);  // 866 vertices
    const auto [position, velocity] = ends(round, {0, 0, 0.0151}, {0.3, 0, 0}, 20);
    EXPECT_NEAR(position.z, 0.0149, 2e-4);
    EXPECT_GT(velocity.x, 0.2);
    EXPECT_LT(std::abs(position.y), 5e-3);
}

}  // namespace
}  // namespace palpate
