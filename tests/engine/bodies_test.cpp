// Bodies: their potentials against differences, free motion, Coulomb's law, rolling, bounces, sleep.

#include "engine/bodies/body_contact.h"
#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

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
        const std::vector<Feature> features = features_of(shape, false);
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
    EXPECT_NEAR(lab.world.shapes[0].pose.position.z, 1 + 2 * 0.5 - g * 0.125, 1e-9);
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

/// Two fingers slide over a table; only one of them has its own friction. They share a chunk.
TEST(Bodies, AFingerHasItsOwnFriction) {
    for (bool single : {false, true}) {
        auto slid = [&](std::vector<FingerFriction> own) {
            SceneSpec spec;
            spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
            spec.fingers = {finger({{0, 0, 0.0045}, upright}), finger({{0.05, 0, 0.0045}, upright})};
            for (FingerSpec& f : spec.fingers) f.single_precision = single;
            spec.finger_frictions = std::move(own);
            Lab lab(spec);
            lab.run(0.005);
            for (int k = 0; k < 80; ++k) {
                for (int i : {0, 1}) lab.target(i).position.z -= k < 40 ? 4e-5 : 0, lab.target(i).position.x += 1e-4;
                lab.run(0.005);
            }
            std::array<ObjectContact, 2> contacts;
            for (std::size_t i : {0u, 1u}) contacts[i] = lab.world.contact_surfaces[i].objects[0];
            return contacts;
        };
        const auto same = slid({}), own = slid({{1, 0, 0.1}}), none = slid({{1, 0, 0}});
        ASSERT_GT(same[0].normal_force, 0.1);
        EXPECT_NEAR(same[1].friction_force, 0.5 * same[1].normal_force, 0.005 * same[1].normal_force);
        EXPECT_NEAR(own[1].friction_force, 0.1 * own[1].normal_force, 0.001 * own[1].normal_force);
        EXPECT_EQ(none[1].friction_force, 0);
        for (const auto& other : {own, none}) {  // the neighbour feels nothing of it
            EXPECT_NEAR(other[0].friction_force, same[0].friction_force, 1e-4 * same[0].friction_force);
            EXPECT_NEAR(other[0].friction_available, same[0].friction_available, 1e-4 * same[0].friction_available);
        }
    }
}

TEST(Bodies, AreHeldUntilTheirRelease) {
    SceneSpec spec;
    spec.solver.dt = 0.001;
    spec.objects.push_back({"plane", {}, Pose<double>::identity(), 0.5});
    spec.objects.push_back(body(ball, 0.02, {0, 0, 0.06}));
    spec.objects[1].body->release = 0.1;
    Lab lab(spec);
    lab.run(0.099);
    EXPECT_EQ(lab.world.shapes[1].pose.position.z, 0.06);
    lab.run(0.05);
    EXPECT_NEAR(0.06 - lab.world.shapes[1].pose.position.z, 0.5 * g * 0.049 * 0.049, 1e-9);
    lab.run(1);
    EXPECT_NEAR(lab.world.shapes[1].pose.position.z, 0.01, 1e-5);
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

TEST(Bodies, BouncesTheSameInWhateverOrderObjectsAreDeclared) {
    auto fallen = [](bool table_last) {
        SceneSpec spec;
        spec.solver.dt = 0.002;
        ObjectSpec box = body(cube, 0.02, {0, 0, 0.03});
        box.pose.rotation = about_x(0.15);
        box.body->restitution = 0.78;
        box.body->velocity = {0.2, 0, 0};
        ObjectSpec other = body(cube, 0.05, {0.003, 0.002, 0.06});
        spec.objects = {{"plane", {}, Pose<double>::identity(), 0.5}, box, other};
        if (table_last) std::reverse(spec.objects.begin(), spec.objects.end());
        Lab lab(spec);
        std::vector<Vec3<double>> way;
        for (int k = 0; k < 60; ++k) {
            lab.run(0.002);
            way.push_back(lab.world.shapes[1].pose.position);
        }
        return way;
    };
    const auto first = fallen(false), last = fallen(true);
    EXPECT_GT(first.back().z, 0.009);
    for (std::size_t k = 0; k < first.size(); ++k) EXPECT_LT(norm(first[k] - last[k]), 1e-5) << "step " << k;
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

}  // namespace
}  // namespace palpate
