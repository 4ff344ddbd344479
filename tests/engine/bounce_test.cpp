// Blows with restitution and friction against closed forms, wherever within a step they fall.

#include <random>
#include <sstream>

#include "engine/bodies/body_contact.h"
#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

/// No weight, no sleep.
SceneSpec afloat(double dt) {
    SceneSpec spec;
    spec.solver.dt = dt;
    spec.solver.sleep_speed = 0;
    spec.gravity = {0, 0, 0};
    return spec;
}
ObjectSpec flying(double mass, const Vec3<double>& from, const Vec3<double>& velocity, double restitution,
                  double friction) {
    ObjectSpec o = body(testing::ball, mass, from, friction);
    o.body->velocity = velocity;
    o.body->restitution = restitution;
    return o;
}

/// A ball that meets a wall obliquely loses (1 + e) mu of its speed along it for each of its speed towards it, and no
/// more than rolling takes: 2/7 (without spin before). The step's own contact takes but what is left of the blow.
TEST(Bounce, RubsByCoulombsLawWhereverInAStepItMeets) {
    for (double dt : {1e-3, 5e-3})
        for (double friction : {0.1, 0.2, 1.0})
            for (double restitution : {0.4, 0.8})
                for (double phase : {0.02, 0.3, 0.5, 0.7, 0.98}) {
                    SceneSpec spec = afloat(dt);
                    spec.objects = {{"wall", {ShapeKind::box, {0.2, 0.2, 0.1}}, {{0, 0, -0.1}, upright}, friction},
                                    flying(0.02, {-0.06, 0, 0.01 + (40 + phase) * 1e-3 * dt / 1e-3}, {1, 0, -1},
                                           restitution, friction)};
                    Lab lab(spec);
                    Vec3<double> impulse{0, 0, 0};
                    for (int k = 0; k < int(0.3 / dt); ++k) {
                        lab.run(dt);
                        impulse += dt * lab.world.bodies[0].contact_force;
                    }
                    const Vec3<double> v = lab.world.bodies[0].velocity;
                    const auto where = ::testing::Message() << 1e3 * dt << " ms, " << friction << ", " << phase;
                    const double lost = std::min(friction * (1 + restitution), 2.0 / 7);
                    EXPECT_NEAR(v.z, restitution, 1e-6) << where;
                    EXPECT_NEAR(v.x, 1 - lost, 0.015) << where;
                    // And it is a force of contact.
                    EXPECT_LT(norm(impulse - 0.02 * (v - Vec3<double>{1, 0, -1})), 1e-6) << where;
                }
}

/// Impulses are swept over until speeds change no more: each island's own speeds. A can that lands flat needs other
/// sweeps than a box that lands beside it.
TEST(Bounce, WhatBouncesElsewhereChangesNothing) {
    const auto can = [](const Shape& shape, double x, double friction) {
        ObjectSpec o = flying(0.05, {x, 0, 0.0205}, {0.1, 0, -1}, 0.4, friction);
        o.shape = shape;
        return o;
    };
    SceneSpec spec = afloat(5e-3);
    spec.objects = {{"floor", {ShapeKind::plane}, {{0, 0, 0}, upright}, 0.3},
                    can({ShapeKind::cylinder, {0.01, 0.04, 0}}, 0, 0.3)};
    Lab alone(spec);
    spec.objects.push_back(can({ShapeKind::box, {0.04, 0.03, 0.04}}, 0.7, 0.1));
    Lab beside(spec);
    double fastest = 0;
    for (int k = 0; k < 40; ++k) {
        alone.run(5e-3), beside.run(5e-3);
        const RigidBody &a = alone.world.bodies[0], &b = beside.world.bodies[0];
        EXPECT_EQ(a.velocity.x, b.velocity.x) << k;
        EXPECT_EQ(a.velocity.z, b.velocity.z) << k;
        EXPECT_EQ(a.angular_momentum.y, b.angular_momentum.y) << k;
        fastest = std::max(fastest, a.velocity.z);
    }
    EXPECT_GT(fastest, 0.1) << "it has not bounced";
}

/// Of two balls alike and smooth, what is along the line of their middles is exchanged, by a share of (1 + e) / 2.
TEST(Bounce, BallsThatMeetObliquelyGainNothing) {
    for (double dt : {1e-3, 5e-3, 10e-3})
        for (double restitution : {0.5, 0.8, 1.0})
            for (double offset : {0.0, 0.005, 0.01, 0.015})
                for (double start : {-0.05, -0.0523, -0.0547}) {
                    SceneSpec spec = afloat(dt);
                    spec.objects = {flying(0.05, {start, 0, 0}, {1, 0, 0}, restitution, 0),
                                    flying(0.05, {0, offset, 0}, {0, 0, 0}, restitution, 0)};
                    Lab lab(spec);
                    lab.run(0.12);
                    const Vec3<double> a = lab.world.bodies[0].velocity, b = lab.world.bodies[1].velocity;
                    const double energy = dot(a, a) + dot(b, b), along = 1 - std::pow(offset / 0.02, 2);
                    const double right = 1 - 0.5 * (1 - restitution * restitution) * along;
                    const auto where = ::testing::Message() << 1e3 * dt << " ms, e " << restitution << ", " << offset;
                    EXPECT_LT(norm(a + b - Vec3<double>{1, 0, 0}), 1e-9) << where;
                    // At most what was there; where the step has turned the line of middles, less is lost.
                    EXPECT_LT(energy, 1 + 2e-3) << where;
                    if (restitution == 1) { EXPECT_GT(energy, 1 - 1e-6) << where; }
                    if (dt < 2e-3) {
                        EXPECT_NEAR(energy, right, 0.02) << where;
                        EXPECT_NEAR(b.x, 0.5 * (1 + restitution) * along, 0.05) << where;
                    }
                }
}

TEST(Bounce, AGasOfBallsKeepsItsEnergy) {
    for (double dt : {1e-3, 5e-3}) {
        SceneSpec spec = afloat(dt);
        for (int axis = 0; axis < 3; ++axis)
            for (double side : {-1.0, 1.0}) {
                Vec3<double> at{0, 0, 0}, half{0.1, 0.1, 0.1};
                at[axis] = side * 0.06, half[axis] = 0.02;
                spec.objects.push_back({"wall", {ShapeKind::box, half}, {at, upright}, 0});
            }
        std::mt19937 random(7);
        std::uniform_real_distribution<double> any(-0.5, 0.5);
        for (int k = 0; k < 8; ++k) {
            const Vec3<double> corner{k & 1 ? 0.015 : -0.015, k & 2 ? 0.015 : -0.015, k & 4 ? 0.015 : -0.015};
            spec.objects.push_back(flying(0.02, corner, {any(random), any(random), any(random)}, 1, 0));
        }
        Lab lab(spec);
        auto energy = [&] {
            double sum = 0;
            for (std::size_t k = 0; k < 8; ++k)
                sum += kinetic_energy(lab.world.bodies[k], lab.world.shapes[6 + k].pose.rotation);
            return sum;
        };
        const double before = energy();
        for (int k = 0; k < int(1.0 / dt); ++k) {
            lab.run(dt);
            ASSERT_LT(energy(), before * 1.01) << 1e3 * dt << " ms, step " << k;
        }
        EXPECT_GT(energy(), 0.7 * before) << 1e3 * dt;
    }
}

/// A bat that turns by a track meets with its own speed there, too.
TEST(Bounce, OffABatThatTurns) {
    for (double dt : {1e-3, 5e-3})
        for (double restitution : {0.0, 0.5, 1.0})
            for (double towards : {0.0, 1.0}) {
                SceneSpec spec = afloat(dt);
                const double spin = 5, arm = 0.15;  // the bat turns about z, its face along x
                spec.objects = {{"bat", {ShapeKind::box, {0.2, 0.005, 0.02}}, Pose<double>::identity(), 0},
                                flying(0.02, {arm, 0.0151 + towards * 0.02, 0}, {0, -towards, 0}, restitution, 0)};
                Lab lab(spec);
                lab.run(0.06, [&](double time, World& w) {
                    const double angle = std::min(spin * time, 0.15) / 2;
                    w.shapes[0].pose = {{0, 0, 0}, {std::cos(angle), 0, 0, std::sin(angle)}};
                });
                const Vec3<double> v = lab.world.bodies[0].velocity;
                const double bat = spin * arm, right = bat + restitution * (bat + towards);
                EXPECT_NEAR(norm(v), right, 0.06 * right)
                    << 1e3 * dt << " ms, e " << restitution << ", towards it at " << towards;
            }
}

/// Nothing near, a thrown ball is where its parabola is, at any step.
TEST(Flight, IsAParabolaAtAnyStep) {
    for (double dt : {1e-3, 5e-3, 20e-3}) {
        SceneSpec spec = afloat(dt);
        spec.gravity = {0, 0, -g};
        spec.objects = {flying(0.02, {0, 0, 0}, {0.4, -0.2, 1.5}, 0, 0.5)};
        Lab lab(spec);
        lab.run(0.4);
        EXPECT_LT(norm(lab.world.shapes[0].pose.position - Vec3<double>{0.16, -0.08, 0.6 - 0.5 * g * 0.16}), 1e-9)
            << 1e3 * dt;
        EXPECT_LT(norm(lab.world.bodies[0].velocity - Vec3<double>{0.4, -0.2, 1.5 - g * 0.4}), 1e-9) << 1e3 * dt;
    }
}

/// Nor does it fall otherwise over a table that is wider than it is high above it.
TEST(Flight, IsAParabolaOverAWideTable) {
    const Shape shapes[] = {
        testing::ball, {ShapeKind::box, {0.01, 0.015, 0.02}}, {ShapeKind::cylinder, {0.01, 0.02, 0}}};
    for (const Shape& shape : shapes)
        for (double dt : {1e-3, 5e-3, 20e-3}) {
            SceneSpec spec = afloat(dt);
            spec.gravity = {0, 0, -g};
            spec.objects = {{"table", {ShapeKind::box, {0.4, 0.3, 0.02}}, {{0, 0, -0.3}, upright}, 0.4},
                            body(shape, 0.02, {0, 0, 0})};
            Lab lab(spec);
            lab.run(0.14);
            EXPECT_NEAR(lab.world.shapes[1].pose.position.z, -0.5 * g * 0.14 * 0.14, 1e-9) << 1e3 * dt;
        }
}

/// A brick that tumbles about its middle axis turns over when Euler's equations say, and neither gains nor loses
/// energy, however far it turns in a step.
TEST(Flight, TumblesAsEulerSays) {
    const Shape brick{ShapeKind::box, {0.005, 0.013, 0.02}};
    auto tumbled = [&](double dt, double speed, double& gain) {
        SceneSpec spec = afloat(dt);
        spec.objects = {body(brick, 0.02, {0, 0, 0})};
        spec.objects[0].body->angular_momentum = spec.objects[0].body->inertia * (speed * Vec3<double>{0.01, 1, 0.02});
        Lab lab(spec);
        auto energy = [&] { return kinetic_energy(lab.world.bodies[0], lab.world.shapes[0].pose.rotation); };
        const double before = energy();
        gain = 0;
        for (int k = 0; k < int(1.0 / dt + 0.5); ++k) {
            lab.run(dt);
            gain = std::max(gain, std::abs(energy() / before - 1));
        }
        return lab.world.shapes[0].pose.rotation;
    };
    double gain = 0;
    for (double speed : {20.0, 70.0}) {
        const Quaternion<double> right = tumbled(2.5e-4, speed, gain);
        for (double dt : {1e-3, 5e-3, 20e-3}) {
            const Quaternion<double> found = tumbled(dt, speed, gain);
            const double off = 2 * norm((found * conjugate(right)).vector());
            std::printf("%g rad/s, %g ms: %.2g rad off after 1 s, energy off by %.2g\n", speed, 1e3 * dt, off, gain);
            EXPECT_LT(gain, 1e-5);
            EXPECT_LT(off, 0.05);
        }
    }
}

/// And rises again to e^2 of where it fell from, but for what it loses in the steps near the ground.
TEST(Bounce, RisesAsHighAsRestitutionSays) {
    for (double dt : {1e-3, 5e-3})
        for (double restitution : {0.5, 0.8, 1.0})
            for (double height : {0.05, 0.1, 0.1037}) {
                SceneSpec spec = afloat(dt);
                spec.gravity = {0, 0, -g};
                spec.objects = {{"ground", {ShapeKind::plane, {}}, Pose<double>::identity(), 0.5},
                                flying(0.02, {0, 0, 0.01 + height}, {0, 0, 0}, restitution, 0.5)};
                Lab lab(spec);
                lab.run(std::sqrt(2 * height / g) + 3 * dt);
                double highest = 0;
                for (int k = 0; k < int(0.25 / dt); ++k) {
                    lab.run(dt);
                    highest = std::max(highest, lab.world.shapes[1].pose.position.z - 0.01);
                }
                const double right = restitution * restitution * height;
                std::printf("%g ms, e %.1f, %.0f mm: %.3f of e^2 h\n", 1e3 * dt, restitution, 1e3 * height,
                            highest / right);
                EXPECT_NEAR(highest / right, 1, dt > 2e-3 ? 0.07 : 0.03);
            }
}

/// A box that a fixed one overlaps from above has no room on its plane, and is not shot aside.
TEST(Crowd, WhatHasNoRoomIsNotThrown) {
    for (double dt : {1e-3, 5e-3, 10e-3})
        for (double turned : {0.0, 0.1, 0.5}) {
            SceneSpec spec;
            spec.solver.dt = dt;
            spec.objects = {
                {"ground", {ShapeKind::plane, {}}, Pose<double>::identity(), 0.37},
                body({ShapeKind::box, {0.0073, 0.0095, 0.0114}}, 0.005, {0.0028, 0, 0.0114}),
                {"lid", {ShapeKind::box, {0.0073, 0.0113, 0.0072}}, {{0.0027, 0, 0.0282}, about_x(turned)}, 0.5}};
            Lab lab(spec);
            double fastest = 0;
            for (int k = 0; k < int(0.3 / dt); ++k) {
                lab.run(dt);
                fastest = std::max(fastest, norm(lab.world.bodies[0].velocity));
            }
            EXPECT_LT(fastest, 0.4) << 1e3 * dt << " ms, " << turned;
        }
}

/// Bodies that only each other have touched, in steps of all lengths and with solves that end early: together they have
/// the momentum that they began with, no more energy, and forces that say what became of each. (Half of the momentum,
/// or nearly all of it, once was lost with what a short solve had left of a way.)
TEST(Collision, FreeBodiesKeepTheirMomentum) {
    struct Way {
        int iterations;
        double tolerance, dt;
    };
    const Shape box{ShapeKind::box, {0.012, 0.01, 0.008}}, rod{ShapeKind::capsule, {0.006, 0.02, 0}};
    for (const Way& way : {Way{1, 1e-3, 1e-3}, Way{1, 1e-3, 2e-3}, Way{1, 1e-3, 5e-3}, Way{2, 1e-4, 1e-3},
                           Way{2, 1e-4, 5e-3}, Way{200, 1e-7, 1e-3}, Way{200, 1e-7, 5e-3}, Way{200, 1e-7, 1e-2}})
        for (const Shape& hit : {testing::ball, box, rod})
            for (const double aside : {0.0, 0.001, 0.006}) {
                SceneSpec spec = afloat(way.dt);
                spec.solver.newton_iterations = way.iterations;
                spec.solver.tolerance = way.tolerance, spec.solver.multiplier_tolerance = 10 * way.tolerance;
                spec.objects = {body(testing::ball, 0.02, {-0.0513, 0, aside}, 0.3), body(hit, 0.02, {0, 0, 0}, 0.3),
                                body(testing::ball, 0.01, {0.045, 0.002, 0}, 0.3)};
                Lab lab(spec);
                lab.world.bodies[0].velocity = {3, 0, 0};
                lab.world.bodies[1].angular_momentum = {0, 1e-6, 2e-6};
                auto momentum = [&] {
                    Vec3<double> sum{0, 0, 0};
                    for (const RigidBody& b : lab.world.bodies) sum += b.mass * b.velocity;
                    return sum;
                };
                auto energy = [&] {
                    double sum = 0;
                    for (const VirtualObject& o : lab.world.shapes)
                        if (o.body >= 0) sum += kinetic_energy(lab.world.bodies[std::size_t(o.body)], o.pose.rotation);
                    return sum;
                };
                const Vec3<double> begun = momentum();
                double had = energy();
                std::ostringstream what;
                what << way.iterations << " iterations, " << way.dt << " s, kind " << int(hit.kind) << ", " << aside;
                for (double t = 0; t < 0.06; t += way.dt) {
                    std::vector<Vec3<double>> before;
                    for (const RigidBody& b : lab.world.bodies) before.push_back(b.velocity);
                    lab.run(way.dt);
                    EXPECT_LT(norm(momentum() - begun), 2e-5 * norm(begun)) << what.str() << ", " << t;
                    EXPECT_LT(energy(), had * (1 + 2e-5)) << what.str() << ", " << t;
                    had = energy();
                    for (std::size_t i = 0; i < before.size(); ++i) {
                        const RigidBody& b = lab.world.bodies[i];
                        EXPECT_LT(norm(b.contact_force - (b.mass / way.dt) * (b.velocity - before[i])),
                                  1e-4 * norm(begun) / way.dt)
                            << what.str() << ", body " << i << ", " << t;
                    }
                }
                EXPECT_LT(lab.world.bodies[0].velocity.x, 2.9) << what.str();
            }
}

}  // namespace
}  // namespace palpate
