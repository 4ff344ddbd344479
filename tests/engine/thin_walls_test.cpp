// Thin walls of meshes: the smooth field keeps them where they are, its gradient has length one on the surface, and
// friction follows Coulomb's law on plates, rims and wedges.

#include "engine/contact/mesh_distance.h"
#include "meshes/surface.h"
#include "scenes/load/finger_mesh.h"
#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

/// A plate of n x n squares a side around the origin; at x < 0 thinner by `taper` of its thickness.
Surface plate(double length, double width, double thickness, int n, double taper = 0) {
    Surface s;
    const int m = n + 1;
    for (int side : {1, -1})
        for (int j = 0; j < m; ++j)
            for (int i = 0; i < m; ++i) {
                const double u = double(i) / n - 0.5, v = double(j) / n - 0.5;
                s.vertices.push_back({length * u, width * v, 0.5 * side * thickness * (1 - taper * (0.5 - u))});
            }
    auto quad = [&](int a, int b, int c, int d) { s.triangles.push_back({a, b, c}), s.triangles.push_back({a, c, d}); };
    auto top = [&](int i, int j) { return j * m + i; };
    auto bottom = [&](int i, int j) { return m * m + j * m + i; };
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i) {
            quad(top(i, j), top(i + 1, j), top(i + 1, j + 1), top(i, j + 1));
            quad(bottom(i, j), bottom(i, j + 1), bottom(i + 1, j + 1), bottom(i + 1, j));
        }
    for (int i = 0; i < n; ++i) {
        quad(bottom(i, 0), bottom(i + 1, 0), top(i + 1, 0), top(i, 0));
        quad(bottom(i + 1, n), bottom(i, n), top(i, n), top(i + 1, n));
        quad(bottom(0, i + 1), bottom(0, i), top(0, i), top(0, i + 1));
        quad(bottom(n, i), bottom(n, i + 1), top(n, i + 1), top(n, i));
    }
    return s;
}

ObjectSpec mesh_object(const Surface& surface, double friction) {
    ObjectSpec o{"mesh", {}, Pose<double>::identity(), friction};
    o.mesh = std::make_shared<const DistanceMesh>(build_distance_mesh(surface));
    o.shape.kind = ShapeKind::mesh;
    o.shape.mesh = o.mesh.get();
    return o;
}

TEST(ThinWalls, SmoothedPlatesStayWhereTheyAre) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> u(-1, 1);
    for (double thickness : {0.3e-3, 0.7e-3, 1e-3, 1.6e-3, 2e-3, 2.25e-3, 3e-3, 4e-3}) {
        const DistanceMesh mesh = build_distance_mesh(plate(0.1, 0.08, thickness, 6));
        for (int k = 0; k < 300; ++k) {
            const int side = k % 2 ? 1 : -1;
            const MeshPoint p =
                mesh_contact_distance(mesh, {0.04 * u(random), 0.03 * u(random), 0.5 * side * thickness});
            ASSERT_LT(std::abs(p.distance), 0.01 * thickness) << thickness;
            ASSERT_NEAR(side * p.normal.z, 1, 1e-3) << thickness;
        }
    }
}

TEST(ThinWalls, TheFieldIsItsGradientAndOfUnitSlopeWhereItIsZero) {
    const std::string scenes = source_dir() + "/scenes/";
    std::mt19937 random(4);
    std::uniform_real_distribution<double> u(-1, 1);
    for (const Surface& surface : {read_surface(scenes + "mug.obj", "mm").surface, plate(0.05, 0.04, 1e-3, 5),
                                   plate(0.06, 0.03, 6e-3, 5, 0.9)}) {
        const DistanceMesh mesh = build_distance_mesh(surface);
        auto value = [&](const Vec3<double>& x) { return mesh_contact_distance(mesh, x).distance; };
        int lost = 0, kinks = 0;
        for (int k = 0; k < 2000; ++k) {
            const auto& t = mesh.triangles[random() % mesh.triangles.size()];
            const double a = 0.5 * (u(random) + 1), b = (1 - a) * 0.5 * (u(random) + 1);
            Vec3<double> x = t.corner + a * t.to_second + b * t.to_third;
            MeshPoint p = mesh_contact_distance(mesh, x);
            for (int i = 0; i < 5; ++i) {  // onto the surface of the field
                x = x - (p.distance / std::max(0.1, dot(p.normal, p.normal))) * p.normal;
                p = mesh_contact_distance(mesh, x);
            }
            lost += std::abs(p.distance) > 1e-8;
            if (std::abs(p.distance) <= 1e-8) { ASSERT_NEAR(norm(p.normal), 1, 1e-3); }
            x = x + 2e-5 * Vec3<double>{u(random), u(random), u(random)};
            p = mesh_contact_distance(mesh, x);
            double worst = 0;
            for (int d = 0; d < 3; ++d) {
                Vec3<double> high = x, low = x;
                high[d] += 1e-7, low[d] -= 1e-7;
                worst = std::max(worst, std::abs((value(high) - value(low)) / 2e-7 - p.normal[d]));
            }
            kinks += worst > 1e-3;
        }
        EXPECT_LE(lost, 10);  // at the corners of a sharp edge
        EXPECT_LE(kinks, 4);  // where it is exact, at the middle of an edge
    }
}

/// A block of tissue pressed on an object from above and drawn along x: what it feels.
struct Slide {
    double normal = 0, along = 0, coupling = 0;  ///< [N]
    double converged = 0;                        ///< share of steps
};
Slide slide_over(const ObjectSpec& object, double top, double travel) {
    SceneSpec spec;
    spec.objects.push_back(object);
    const double height = top + 0.004;  // the pad of the block is 4 mm below its middle
    spec.fingers.push_back(finger({{-0.5 * travel, 0, height + 0.0005}, upright}));
    spec.fingers[0].coupling.angular_stiffness = 1000;
    Lab lab(spec);
    Slide mean;
    int count = 0;
    lab.run(0.1,
            [&](double t, World&) { lab.target(0).position.z = height + 0.0005 - 0.0012 * std::min(1.0, t / 0.1); });
    lab.run(0.4, [&](double t, World& w) {
        lab.target(0).position.x = -0.5 * travel + travel * (t - 0.1) / 0.4;
        if (t < 0.3) return;
        const ContactSurface& s = w.contact_surfaces[0];
        mean.converged += w.chunks.doubles[0].status[0].converged;
        mean.normal += s.normal_force, mean.along -= s.total.x, ++count;
        mean.coupling += w.couplings[0].force_N;
    });
    return {mean.normal / count, mean.along / count, mean.coupling / count, mean.converged / count};
}

TEST(ThinWalls, AFingerSlidesOverAThinPlateAsOverAThickOne) {
    const ObjectSpec box{"box", {ShapeKind::box, {0.05, 0.04, 0.005}}, {{0, 0, -0.005}, upright}, 0.5};
    const Slide thick = slide_over(box, 0, 0.02);
    EXPECT_NEAR(thick.along, 0.5 * thick.normal, 0.01 * thick.normal);
    for (double thickness : {0.3e-3, 0.5e-3, 1e-3, 1.6e-3, 1.8e-3, 2e-3, 2.25e-3, 2.5e-3}) {
        SCOPED_TRACE(thickness);
        const Slide thin = slide_over(mesh_object(plate(0.1, 0.08, thickness, 6), 0.5), 0.5 * thickness, 0.02);
        EXPECT_NEAR(thin.normal, thick.normal, 0.03 * thick.normal) << thickness;
        EXPECT_NEAR(thin.along, 0.5 * thin.normal, 0.01 * thin.normal) << thickness;
        const double reported = std::hypot(thin.normal, thin.along);
        EXPECT_NEAR(reported, thin.coupling, 0.01 * reported) << thickness;
        // Thinner ones are exact: there a sample that a Newton step carries through sees the other side.
        EXPECT_GE(thin.converged, thickness < 1e-3 ? 0.4 : 1.0) << thickness;
    }
}

/// A field knows no sides: a finger that one long step carries through a plate presses on its other face. That is said
/// in every step, until it has come back or is far.
TEST(ThinWalls, WhatALongStepCarriesThroughIsSaidUntilItIsBack) {
    SceneSpec spec;
    spec.solver.dt = 0.02;
    spec.objects.push_back(mesh_object(plate(0.1, 0.08, 3e-3, 6), 0.3));
    spec.objects[0].pose.position.z = -1.5e-3;
    FingerSpec f;
    f.name = "index";
    FingerTemplates templates;
    FingerMeshRequest request;
    request.shape = finger_shape("index");
    std::string note;
    f.mesh = make_finger_mesh(request, templates, note);
    f.has_limits = true;
    f.start.position.z = 0.0275;
    f.coupling.max_speed = 100;
    spec.fingers.push_back(f);
    Lab lab(spec);
    const SkinStatus& status = lab.world.chunks.doubles[0].status[0];
    auto move = [&](double z, double speed) {
        const double from = lab.world.time > 0 ? lab.target(0).position.z : f.start.position.z, began = lab.world.time;
        lab.run(std::abs(z - from) / speed + 0.1, [&](double t, World&) {
            const double way = std::min(speed * (t + 0.02 - began), std::abs(z - from));
            lab.target(0).position.z = from + (z > from ? way : -way);
        });
    };
    // At 0.5 m/s, 10 mm a step, it bounces off the plate through it, and hangs under it by its sides: -21 N for 0.5.
    move(0.007, 0.5);
    ASSERT_LT(lab.world.contact_surfaces[0].total.z, -1);
    EXPECT_GT(status.wrong_sides, 0);
    EXPECT_FALSE(status.converged);
    lab.run(0.2);
    EXPECT_GT(status.wrong_sides, 0);
    // Out from under it, up, and over it again.
    for (const Vec3<double>& place :
         {Vec3<double>{0.15, 0, 0}, Vec3<double>{0.15, 0, 0.05}, Vec3<double>{0, 0, 0.05}}) {
        lab.target(0).position = place;
        lab.run(0.2);
    }
    EXPECT_EQ(status.wrong_sides, 0);
    EXPECT_TRUE(status.converged);
    move(0.007, 0.02);
    EXPECT_EQ(status.wrong_sides, 0);
    EXPECT_TRUE(status.converged);
    EXPECT_GT(lab.world.contact_surfaces[0].total.z, 0.1);
}

/// Coulomb's law sample by sample, on what acts: forces on nodes split along the surface's true normal.
TEST(ThinWalls, FrictionOnTheMugsRimFollowsCoulombsLaw) {
    const Surface mug = read_surface(source_dir() + "/scenes/mug.obj", "mm").surface;
    double top = -1;
    for (const Point& p : mug.vertices) top = std::max(top, p[2]);
    Point rim{0, 0, 0};  // farthest along y at the top
    for (const Point& p : mug.vertices)
        if (p[2] > top - 1e-4 && p[1] > rim[1]) rim = p;
    SceneSpec spec;
    spec.objects.push_back(mesh_object(mug, 0.5));
    spec.fingers.push_back(finger({{-0.01, rim[1], top + 0.0045}, upright}));
    spec.fingers[0].coupling.angular_stiffness = 1000;
    Lab lab(spec);
    int judged = 0;
    lab.run(0.6, [&](double t, World& w) {
        lab.target(0).position.z = top + 0.0045 - 0.0015 * std::min(1.0, t / 0.1);
        lab.target(0).position.x = -0.01 + 0.02 * std::max(0.0, t - 0.1) / 0.5;
        if (t < 0.3) return;
        const ContactSurface& s = w.contact_surfaces[0];
        ASSERT_TRUE(w.chunks.doubles[0].status[0].converged);
        double normal = 0;
        for (std::size_t i = 0; i < s.force.size(); ++i) {
            if (norm(s.force[i]) < 0.005) continue;
            const Vec3<double> gradient =
                surface_point(spec.objects[0].shape, Pose<double>::identity(), transform(s.bone, s.position[i])).normal;
            const double along = dot(s.force[i], gradient) / norm(gradient);
            const double across = std::sqrt(std::max(0.0, dot(s.force[i], s.force[i]) - along * along));
            EXPECT_LT(across, 0.505 * along);
            normal += along;
            judged += across > 0.495 * along;
        }
        EXPECT_NEAR(s.normal_force, normal, 0.01 * normal + 0.005 * s.touching);
    });
    EXPECT_GT(judged, 100);
}

}  // namespace
}  // namespace palpate
