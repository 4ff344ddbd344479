// Bodies between soft fingers: grasps, and what must not blow up.

#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

/// Two blocks of tissue press a body from both sides along y.
struct Pinch : Lab {
    static SceneSpec spec(const ObjectSpec& object, double dt) {
        SceneSpec s;
        s.solver.dt = dt;
        s.objects.push_back(object);
        s.fingers = {finger({{0, -0.0145, 0}, about_x(M_PI / 2)}), finger({{0, 0.0145, 0}, about_x(-M_PI / 2)})};
        return s;
    }
    explicit Pinch(const ObjectSpec& object, double dt = 0.005) : Lab(spec(object, dt)) { world.gravity = {0, 0, 0}; }
    void press(double depth) {
        target(0).position.y = -0.014 + depth;
        target(1).position.y = 0.014 - depth;
    }
    void grip(double depth) {
        run(0.005);
        for (int k = 1; k <= 20; ++k) {
            press(depth * k / 20);
            run(0.01);
        }
    }
};

TEST(Grasp, HoldsFromOneGramToKilogramsAndForcesBalance) {
    int number = 0;
    for (double dt : {0.005, 0.02, 0.001})
        for (double mass : {0.001, 0.02, 0.1}) {
            if (!testing::is_tried(number++, 2)) continue;
            if (dt == 0.001 && mass != 0.02) continue;  // slow, and nothing else than at 5 ms
            Pinch p(body(cube, mass, {0, 0, 0}, 0.8), dt);
            p.grip(0.003);
            p.world.gravity = {0, 0, -g};
            p.run(4);
            const Pose<double> settled = p.world.shapes[0].pose;
            p.run(1);
            const RigidBody& b = p.world.bodies[0];
            EXPECT_LT(norm(p.world.shapes[0].pose.position - settled.position), 1e-6) << mass;
            EXPECT_LT(norm(b.acceleration), 1e-3 * g) << mass;
            EXPECT_LT(norm(b.contact_force + b.mass * (p.world.gravity - b.acceleration)), 1e-4 * mass * g) << mass;
            EXPECT_LT(norm(b.contact_torque), 1e-4 * mass * g * b.size) << mass;
            // Action equals reaction: what the fingers feel is what the body feels.
            Vec3<double> on_fingers{0, 0, 0};
            for (const ContactSurface& c : p.world.contact_surfaces) on_fingers += c.total;
            EXPECT_LT(norm(on_fingers + b.contact_force), 1e-4 * mass * g) << mass;
        }
}

TEST(Grasp, AGramUnderAHardGripIsBalancedToo) {
    SceneSpec spec = Pinch::spec(body(cube, 0.001, {0, 0, 0}, 0.8), 0.005);
    for (FingerSpec& f : spec.fingers) f.coupling.stiffness = 20000;
    Pinch p(body(cube, 0.001, {0, 0, 0}, 0.8));
    static_cast<Lab&>(p).world = build_world(spec);
    p.grip(0.006);
    p.run(2);
    const RigidBody& b = p.world.bodies[0];
    EXPECT_GT(p.world.contact_surfaces[0].normal_force, 40);
    EXPECT_LT(norm(b.contact_force + b.mass * (p.world.gravity - b.acceleration)), 1e-4 * b.mass * g);
    EXPECT_LT(norm(b.acceleration), 1e-3 * g);
}

TEST(Grasp, SlipsAtThePredictedGrip) {
    const double friction = 0.4, mass = 0.02;
    Pinch p(body(cube, mass, {0, 0, 0}, friction), 0.002);
    p.grip(0.0022);
    p.world.gravity = {0, 0, -g};
    p.run(1);
    const double start = p.world.shapes[0].pose.position.z;
    double grip = 0, last = start, depth = 0.0022;
    for (; depth > 0; depth -= grip > 0.6 * mass * g / friction ? 2e-6 : 4e-7) {
        p.press(depth);
        p.run(0.002);
        const double z = p.world.shapes[0].pose.position.z;
        if (last - z > 2e-5) break;  // 10 mm/s: it slides
        grip = 0.5 * (p.world.contact_surfaces[0].normal_force + p.world.contact_surfaces[1].normal_force);
        last = z;
    }
    EXPECT_NEAR(grip, mass * g / (2 * friction), 0.03 * mass * g / (2 * friction));
}

TEST(Grasp, ABallUnderOneFingerRollsHalfItsWay) {
    SceneSpec spec;
    spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.8});
    spec.objects.push_back(body(ball, 0.01, {0, 0, 0.01}, 0.8));
    spec.fingers = {finger({{0, 0, 0.0245}, upright})};
    Lab lab(spec);
    lab.run(0.005);
    for (int k = 0; k < 40; ++k) lab.target(0).position.z -= 2e-5, lab.run(0.005);
    const double start = lab.world.shapes[1].pose.position.x;
    for (int k = 0; k < 100; ++k) lab.target(0).position.x += 3e-5, lab.run(0.01);
    lab.run(0.1);
    EXPECT_NEAR(lab.world.shapes[1].pose.position.x - start, 0.0015, 0.02 * 0.0015);
}

/// A rod thinner than the spacing of nodes sinks in between them; samples between nodes stop it.
TEST(Grasp, SamplesBetweenNodesHoldAThinRod) {
    auto depth_of = [](int refinement) {
        SceneSpec spec;
        spec.solver.sample_refinement = refinement;
        FingerSpec f = finger({{0, 0, 0.0055}, upright});
        spec.fingers.push_back(f);
        // Along x, midway between two rows of nodes.
        const Shape rod{ShapeKind::capsule, {0.0008, 0.02, 0}};
        spec.objects.push_back({"rod", rod, {{0, 0.0019, 0}, {std::sqrt(0.5), 0, std::sqrt(0.5), 0}}, 0.5});
        Lab lab(spec);
        lab.run(0.005);
        for (int k = 0; k < 40; ++k) lab.target(0).position.z -= 5e-5, lab.run(0.005);
        lab.run(0.3);
        // How deep faces of the pad are inside the rod, wherever.
        const auto nodes = finger_positions(lab.world, lab.world.skins.owner(0));
        double deepest = 0;
        for (const auto& t : f.mesh.surface)
            for (int i = 0; i <= 12; ++i)
                for (int j = 0; i + j <= 12; ++j) {
                    Vec3<double> x;
                    for (int d = 0; d < 3; ++d)
                        x[d] = (i * nodes[t[0]][d] + j * nodes[t[1]][d] + (12 - i - j) * nodes[t[2]][d]) / 12;
                    const VirtualObject& r = lab.world.shapes[0];
                    deepest = std::max(deepest, -surface_point(r.shape, r.pose, x).distance);
                }
        return std::pair{deepest, lab.world.contact_surfaces[0].normal_force};
    };
    const auto [coarse, no_force] = depth_of(1);
    const auto [fine, force] = depth_of(4);
    std::printf("thin rod: %.3f mm inside the pad with samples at nodes (%.3f N), %.3f mm refined (%.3f N)\n",
                1e3 * coarse, no_force, 1e3 * fine, force);
    EXPECT_LT(no_force, 0.01);  // it went through
    EXPECT_GT(force, 0.2);
    EXPECT_LT(fine, 0.5 * coarse);
}

bool finite_and_near(const World& world, double reach) {
    for (const VirtualObject& s : world.shapes) {
        const Vec3<double>& x = s.pose.position;
        if (!std::isfinite(dot(x, x)) || !std::isfinite(s.pose.rotation.w)) return false;
    }
    for (const auto& c : world.chunks.doubles)
        for (double x : c.state.position)
            if (!(std::abs(x) < reach)) return false;
    return true;
}

TEST(Grasp, SurvivesWhatHandsDo) {
    struct Case {
        const char* name;
        std::function<void(SceneSpec&)> change;
        std::function<void(double, World&)> place;
    };
    const std::vector<Case> cases{
        {"thrown at 10 m/s",
         [](SceneSpec& s) {
             s.objects[0].body->velocity = {0, 10, 0};
         },
         {}},
        {"thrown past",
         [](SceneSpec& s) {
             s.objects[0].body->velocity = {10, 1, 0};
         },
         {}},
        {"inside a finger", [](SceneSpec& s) { s.objects[0].pose.position.y = 0.012; }, {}},
        {"spinning",
         [](SceneSpec& s) {
             s.objects[0].body->angular_momentum = {0, 0, 1e-3};
         },
         {}},
        {"smaller than an element",
         [](SceneSpec& s) {
             s.objects[0] = body({ShapeKind::sphere, {0.0005, 0, 0}}, 1e-6, {0, 0, 0});
         },
         {}},
        {"thin card",
         [](SceneSpec& s) {
             s.objects[0] = body({ShapeKind::box, {0.03, 0.0001, 0.02}}, 0.002, {0, 0, 0});
         },
         {}},
        {"squeezed wedge-wise",
         [](SceneSpec& s) {
             s.objects[0].pose.rotation = normalised(Quaternion<double>{1, 0.4, 0.1, 0.3});
         },
         {}},
        {"ten fingers on one spot",
         [](SceneSpec& s) {
             for (int i = 0; i < 8; ++i) s.fingers.push_back(s.fingers[i % 2]);
         },
         {}},
        {"teleported away and back",
         {},
         [](double t, World& w) {
             if (std::abs(t - 0.2) < 1e-9) w.shapes[0].pose.position.z = w.shapes[0].previous.position.z = 0.5;
             if (std::abs(t - 0.25) < 1e-9) w.shapes[0].pose.position = w.shapes[0].previous.position = {0, 0.01, 0};
         }},
    };
    int number = 0;  // of a row of the table of cases and steps, by diagonals
    for (const Case& c : cases) {
        ++number;
        for (double dt : {0.001, 0.005, 0.02}) {
            if (!testing::is_tried(number++, 6)) continue;
            SceneSpec spec = Pinch::spec(body(cube, 0.02, {0, 0, 0}, 0.8), dt);
            if (c.change) c.change(spec);
            Lab lab(spec);
            for (int k = 0; k <= 50; ++k)
                lab.run(0.02, [&](double t, World& w) {
                    // Close, press hard, open.
                    const double depth = 0.004 * std::sin(M_PI * std::min(1.0, t / 0.9));
                    for (std::size_t i = 0; i < w.skins.size(); ++i)
                        lab.target(int(i)).position.y = (i % 2 ? 1 : -1) * (0.0145 - depth);
                    if (c.place) c.place(t, w);
                });
            EXPECT_TRUE(finite_and_near(lab.world, 0.2)) << c.name << ", dt = " << dt;
            for (std::size_t i = 0; i < lab.world.skins.size(); ++i) {
                // Open again: the fingers are back at rest.
                const SkinStatus& s = skin_status(lab.world, lab.world.skins.owner(i));
                EXPECT_TRUE(s.converged) << c.name << ", dt = " << dt;
                EXPECT_LT(s.limit_violation, 1e-2) << c.name;
            }
        }
    }
}

}  // namespace
}  // namespace palpate
