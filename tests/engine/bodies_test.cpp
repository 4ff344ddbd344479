// Bodies: their potentials against differences, free motion, Coulomb's law, rolling, bounces, grasps, and what must
// not blow up.

#include <cmath>

#include "engine/bodies/body_contact.h"
#include "engine/step.h"
#include "tests/support.h"

namespace palpate {
namespace {

constexpr double g = 9.81;
const Quaternion<double> upright = Quaternion<double>::identity();
const Quaternion<double> about_x(double angle) { return {std::cos(angle / 2), std::sin(angle / 2), 0, 0}; }

ObjectSpec body(const Shape& shape, double mass, const Vec3<double>& position, double friction = 0.5) {
    ObjectSpec o{"body", shape, {position, upright}, friction};
    o.body = solid_body(shape, mass);
    return o;
}
const Shape cube{ShapeKind::box, {0.01, 0.01, 0.01}};
const Shape ball{ShapeKind::sphere, {0.01, 0, 0}};

/// A block of tissue as finger, its pad facing along `turn` (-z) at `bone`.
FingerSpec finger(const Pose<double>& bone) {
    FingerSpec f;
    f.name = "finger";
    f.mesh = testing::block_mesh(3, 2, 2, 0.004);
    f.has_limits = true;
    f.start = bone;
    return f;
}

struct Lab {
    World world;
    oneapi::tbb::task_arena arena{2};
    explicit Lab(const SceneSpec& spec) : world(build_world(spec)) {}
    /// Steps for a time; `place` aims the fingers.
    void run(double seconds, const std::function<void(double, World&)>& place = {}) {
        for (const double end = world.time + seconds; world.time < end - 1e-9;) {
            for (std::size_t i = 0; i < world.skins.size(); ++i) {
                TrackerPose::Sample& s = world.tracker_poses.find(world.couplings[i].tracker)->incoming;
                if (!s.valid) s.pose = world.skins[i].start;
                s.valid = true, s.time = world.time;
            }
            if (place) place(world.time, world);
            step(world, arena);
        }
    }
    Pose<double>& target(int i) { return world.tracker_poses.find(world.couplings[i].tracker)->incoming.pose; }
};

TEST(Bodies, InertiaIsTheGradientOfItsPotential) {
    RigidBody b = solid_body({ShapeKind::box, {0.01, 0.02, 0.03}}, 0.1);
    b.inertia[0][1] = b.inertia[1][0] = 4e-6;
    const Pose<double> target{{0.1, 0, 0.02}, normalised(Quaternion<double>{1, 0.2, -0.1, 0.3})};
    const Pose<double> pose{{0.1, 0.001, 0.02}, normalised(Quaternion<double>{1, 0.5, 0.1, 0.2})};
    const BodyTerms t = body_inertia(b, target, pose, 0.005);
    for (int k = 0; k < 6; ++k) {
        const double h = 1e-6;
        Motion along = Motion::Zero();
        along[k] = 1;
        const double high = body_inertia(b, target, moved(pose, along, h), 0.005).energy;
        const double low = body_inertia(b, target, moved(pose, along, -h), 0.005).energy;
        EXPECT_NEAR(t.gradient[k], (high - low) / (2 * h), 1e-6 * t.gradient.norm()) << k;
    }
    // At the target the curvature is exact.
    const BodyTerms at = body_inertia(b, target, target, 0.005);
    for (int k = 0; k < 6; ++k) {
        Motion along = Motion::Zero();
        along[k] = 1;
        const double h = 1e-5;
        const Motion high = body_inertia(b, target, moved(target, along, h), 0.005).gradient,
                     low = body_inertia(b, target, moved(target, along, -h), 0.005).gradient;
        EXPECT_LT(((high - low) / (2 * h) - at.curvature.col(k)).norm(), 1e-6 * at.curvature.norm());
    }
}

TEST(Bodies, ContactBetweenObjectsIsTheGradientOfItsPotential) {
    const Shape shapes[] = {cube, {ShapeKind::cylinder, {0.01, 0.02, 0}}, {ShapeKind::capsule, {0.01, 0.02, 0}}, ball};
    const Shape base{ShapeKind::box, {0.1, 0.1, 0.01}};
    for (const Shape& shape : shapes) {
        const std::vector<Feature> features = features_of(shape);
        const auto lean = normalised(Quaternion<double>{1, 0.3, 0.2, 0.1});
        ContactBody a{&shape, {{0.01, 0, 0.0195}, lean}, {{0.011, 0.002, 0.019}, lean}, {}, 0};
        ContactBody b{&base, {{0, 0, 0}, upright}, {{0, 0.001, 0}, about_x(0.01)}, {}, 1};
        BodyPair pair;
        pair.friction = 0.5;
        pair.contacts.resize(features.size());
        begin_pair(pair, features, a, b);
        for (FeatureContact& c : pair.contacts) {
            c.normal_multiplier = 2;
            c.friction_radius = 5;
            c.friction_normal = {0, 0, 1};
            c.tangential_multiplier = {0.3, -0.2, 0};
        }
        auto energy = [&](const Motion& ma, const Motion& mb) {
            ContactBody x = a, y = b;
            for (auto [o, m] : {std::pair{&x, &ma}, std::pair{&y, &mb}}) {
                o->pose = moved(o->pose, *m, 1);
                o->centre = o->pose.position;
            }
            return evaluate_pair(pair, features, x, y, 1).energy;
        };
        for (int end = 0; end < 2; ++end) {
            a.centre = a.pose.position, b.centre = b.pose.position;
            evaluate_pair(pair, features, a, b, 1);
            Motion gradient = Motion::Zero();
            for (const FeatureContact& c : pair.contacts)
                for (const PairTerm& t : c.terms) {
                    const Vec3<double> arm = end ? t.arm_of_b : t.arm_of_a, torque = cross(arm, t.gradient);
                    for (int k = 0; k < 3; ++k) {
                        gradient[k] += (end ? -1 : 1) * t.gradient[k];
                        gradient[3 + k] += (end ? -1 : 1) * torque[k];
                    }
                }
            ASSERT_GT(gradient.norm(), 0.1);
            for (int k = 0; k < 6; ++k) {
                Motion along = Motion::Zero();
                along[k] = 1e-7;
                const Motion none = Motion::Zero(), back = -along;
                const double high = end ? energy(none, along) : energy(along, none);
                const double low = end ? energy(none, back) : energy(back, none);
                EXPECT_NEAR(gradient[k], (high - low) / 2e-7, 2e-5 * gradient.norm()) << int(shape.kind) << " " << k;
            }
        }
    }
}

TEST(Bodies, FreeFlightKeepsItsMomenta) {
    SceneSpec spec;
    spec.solver.dt = 0.001;
    ObjectSpec o = body({ShapeKind::box, {0.01, 0.02, 0.035}}, 0.1, {0, 0, 1});
    o.body->velocity = {1, 0, 2};
    const Vec3<double> spin{0.5, 12, 0.3};  // near the middle axis: it tumbles
    o.body->angular_momentum = o.body->inertia * spin;
    spec.objects.push_back(o);
    Lab lab(spec);
    const Vec3<double> L0 = o.body->angular_momentum;
    auto energy = [&] {
        const RigidBody& b = lab.world.bodies[0];
        return 0.5 * dot(b.angular_momentum, angular_velocity(b, lab.world.shapes[0].pose.rotation));
    };
    const double E0 = energy();
    lab.run(0.5);
    const RigidBody& b = lab.world.bodies[0];
    EXPECT_LT(norm(b.angular_momentum - L0), 1e-9 * norm(L0));
    EXPECT_NEAR(energy(), E0, 0.01 * E0);
    EXPECT_NEAR(b.velocity.x, 1, 1e-9);
    EXPECT_NEAR(b.velocity.z, 2 - g * 0.5, 1e-8);
    // Implicit Euler falls g dt t / 2 farther than the parabola.
    EXPECT_NEAR(lab.world.shapes[0].pose.position.z, 1 + 2 * 0.5 - g * 0.125 - g * 0.001 * 0.25, 1e-7);
    EXPECT_NEAR(lab.world.shapes[0].pose.position.x, 0.5, 1e-9);
}

/// Plane with gravity leaning by `angle`.
SceneSpec incline(double angle, double friction, double dt) {
    SceneSpec spec;
    spec.solver.dt = dt;
    spec.gravity = {g * std::sin(angle), 0, -g * std::cos(angle)};
    spec.objects.push_back({"plane", {}, Pose<double>::identity(), friction});
    spec.objects.push_back(body(cube, 0.05, {0, 0, 0.01}, friction));
    return spec;
}

TEST(Bodies, CoulombOnAnInclinedPlane) {
    for (double dt : {0.001, 0.005, 0.02})
        for (double friction : {0.3, 0.8}) {
            const double limit = std::atan(friction);
            Lab sticks(incline(0.99 * limit, friction, dt)), slides(incline(1.01 * limit, friction, dt));
            sticks.run(0.5), slides.run(0.5);
            EXPECT_LT(sticks.world.shapes[1].pose.position.x, 0.5e-6) << "creeps, dt = " << dt;
            EXPECT_GT(slides.world.shapes[1].pose.position.x, 1e-4) << "sticks, dt = " << dt;
            Lab fast(incline(1.3 * limit, friction, dt));
            fast.run(0.3);
            const double before = fast.world.bodies[0].velocity.x;
            fast.run(0.2);
            const double a = (fast.world.bodies[0].velocity.x - before) / 0.2;
            const double expected = g * (std::sin(1.3 * limit) - friction * std::cos(1.3 * limit));
            EXPECT_NEAR(a, expected, 0.01 * expected) << "dt = " << dt;
        }
}

TEST(Bodies, PairsHaveTheirOwnFriction) {
    SceneSpec spec = incline(0.3, 1.0, 0.005);
    spec.pair_frictions = {{1, 0, 0.1}};
    Lab lab(spec);
    lab.run(0.3);
    EXPECT_GT(lab.world.shapes[1].pose.position.x, 0.01);
}

TEST(Bodies, BouncesAsItsRestitutionSays) {
    for (double restitution : {0.0, 0.5, 0.9}) {
        SceneSpec spec;
        spec.solver.dt = 0.001;
        spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
        spec.objects.push_back(body(ball, 0.02, {0, 0, 0.06}));
        spec.objects[1].body->restitution = restitution;
        Lab lab(spec);
        lab.run(0.102);  // it has met the plane
        double top = 0;
        for (int k = 0; k < 150; ++k) {
            lab.run(0.001);
            top = std::max(top, lab.world.shapes[1].pose.position.z - 0.01);
        }
        EXPECT_NEAR(top, restitution * restitution * 0.05, 0.003) << restitution;
    }
}

TEST(Bodies, ABallRollsWithoutSlipping) {
    for (double dt : {0.001, 0.01}) {
        SceneSpec spec;
        spec.solver.dt = dt;
        spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
        spec.objects.push_back(body(ball, 0.02, {0, 0, 0.01}));
        spec.objects[1].body->velocity = {0.1, 0, 0};  // slides first, then rolls with 5/7 of its speed
        Lab lab(spec);
        lab.run(1);
        const RigidBody& b = lab.world.bodies[0];
        EXPECT_NEAR(b.velocity.x, 0.1 * 5 / 7, 0.003) << dt;
        EXPECT_NEAR(angular_velocity(b, lab.world.shapes[1].pose.rotation).y, b.velocity.x / 0.01, 0.02) << dt;
    }
}

TEST(Bodies, AStackOfBoxesStands) {
    SceneSpec spec;
    spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
    for (int i = 0; i < 4; ++i)
        spec.objects.push_back(body(cube, 0.02 + 0.1 * (i == 3), {0.001 * i, 0, 0.0101 + 0.0201 * i}));
    Lab lab(spec);
    lab.run(1);
    for (int i = 0; i < 4; ++i) {
        EXPECT_NEAR(lab.world.shapes[1 + i].pose.position.z, 0.01 + 0.02 * i, 2e-5);
        EXPECT_NEAR(lab.world.shapes[1 + i].pose.position.x, 0.001 * i, 2e-5);
    }
}

TEST(Bodies, SleepAtRestAndWakeWhenSomethingComes) {
    SceneSpec spec;
    spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
    spec.objects.push_back(body(cube, 0.02, {0, 0, 0.01}));
    spec.objects.push_back(body(cube, 0.02, {0, 0, 0.03}));
    spec.objects.push_back(body(ball, 0.02, {-0.3, 0, 0.01}));
    spec.objects[3].body->velocity = {0.5, 0, 0};
    Lab lab(spec);
    const World& w = lab.world;
    lab.run(0.3);
    EXPECT_TRUE(w.bodies[0].asleep);
    EXPECT_TRUE(w.bodies[1].asleep);
    EXPECT_FALSE(w.bodies[2].asleep);
    EXPECT_NEAR(w.bodies[1].contact_force.z, 0.02 * g, 1e-5);  // still known
    lab.run(0.7);                                              // the ball has hit the lower cube
    EXPECT_GT(w.shapes[1].pose.position.x, 1e-4);
    lab.run(2);
    EXPECT_TRUE(w.bodies[0].asleep);
    lab.world.shapes[0].pose.position.z -= 0.05;  // the ground goes
    lab.run(0.1);
    EXPECT_FALSE(w.bodies[0].asleep);
    EXPECT_LT(w.shapes[1].pose.position.z, 0.01 - 0.02);
}

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
    for (double dt : {0.001, 0.005, 0.02})
        for (double mass : {0.001, 0.02, 0.1}) {
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

TEST(Grasp, SlipsAtThePredictedGrip) {
    const double friction = 0.4, mass = 0.02;
    Pinch p(body(cube, mass, {0, 0, 0}, friction), 0.002);
    p.grip(0.0022);
    p.world.gravity = {0, 0, -g};
    p.run(1);
    const double start = p.world.shapes[0].pose.position.z;
    double grip = 0, last = start, depth = 0.0022;
    for (; depth > 0; depth -= 4e-7) {
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
                    const RigidShape& r = lab.world.shapes[0];
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
    for (const RigidShape& s : world.shapes) {
        const Vec3<double>& x = s.pose.position;
        if (!std::isfinite(dot(x, x)) || !std::isfinite(s.pose.rotation.w)) return false;
    }
    for (const auto& c : world.double_chunks)
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
    for (const Case& c : cases)
        for (double dt : {0.001, 0.005, 0.02}) {
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

}  // namespace
}  // namespace palpate
