// Bodies in steps of static equilibrium: forces of contact bear weights, whatever a step's length; a body that nothing
// holds is no equilibrium, and said to be none.

#include <cmath>

#include "scenes/load/scene.h"
#include "scenes/run/grasp.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::scenes;

Simulation static_scene(const std::string& name, const std::string& dt_ms) {
    return make_simulation(load_scene(scenes + name, {"solver.static=true", "dt_ms=" + dt_ms}), 2);
}

/// Runs until `end` [s]; returns the largest share of its weight that contact misses of the first body while fingers
/// alone hold it, in which it is also not to move by more than its fingers.
double worst_balance_while_held(Simulation& s, double end) {
    while (s.world.time < end) advance(s);
    const auto held = s.body_series[0].column("held"), balance = s.body_series[0].column("balance");
    double worst = 0;
    for (std::size_t k = 0; k < held.size(); ++k)
        if (held[k] > 0) worst = std::max(worst, balance[k]);
    return worst;
}

TEST(StaticBodies, WhatIsLiftedIsNotDraggedWhateverTheStep) {
    std::vector<Vec3<double>> ends;
    for (const char* dt_ms : {"5", "20", "2"}) {
        if (dt_ms == std::string("2") && !testing::is_tried(1, 2)) continue;
        Simulation s = static_scene("pinch.toml", dt_ms);
        EXPECT_LT(worst_balance_while_held(s, 1.3), 1e-3) << dt_ms;  // 1.9 with inertia about where a step began
        const BodySummary cube = summarise_bodies(s)[0];
        EXPECT_GE(cube.converged_share, 0.99) << dt_ms;
        EXPECT_GT(cube.held_s, 0.5) << dt_ms;
        EXPECT_EQ(cube.unbalanced_steps, 0) << dt_ms;
        ends.push_back(s.world.shapes[1].pose.position);
    }
    for (const Vec3<double>& end : ends) EXPECT_LT(norm(end - ends[0]), 2e-4);
}

TEST(StaticBodies, VelocitiesAreThoseOfWhatMoves) {
    Simulation s = static_scene("pinch.toml", "5");
    while (s.world.time < 1) advance(s);
    const Pose<double> before = s.world.shapes[1].pose;
    advance(s);
    const Vec3<double> way = s.world.shapes[1].pose.position - before.position;
    EXPECT_GT(norm(way), 1e-4);
    EXPECT_LT(norm(s.world.bodies[0].velocity - (1 / s.world.solver.dt) * way), 1e-9);
    EXPECT_EQ(norm(s.world.bodies[0].acceleration), 0);
}

TEST(StaticBodies, AnEggIsHeldInShortStepsAsInLongOnes) {
    for (const char* dt_ms : {"5", "20"}) {
        if (dt_ms == std::string("20") && !testing::is_tried(1, 2)) continue;
        Simulation s = static_scene("egg.toml", dt_ms);
        worst_balance_while_held(s, 1.6);
        const BodySummary egg = summarise_bodies(s)[0];
        EXPECT_LT(egg.slip_mm, 0.5) << dt_ms;  // 14.7 mm in steps of 5 ms, and dropped
        EXPECT_LT(egg.dropped_at_s, 0) << dt_ms;
        EXPECT_GT(egg.held_s, 0.5) << dt_ms;
    }
}

/// A box above a plane, far from any finger.
const std::string alone = R"(duration_s = 1
[solver]
static = true
[[finger]]
elements = 60
track = [ { t_s = 0, position_mm = [300, 0, 900] } ]
)";
const std::string box = "[[object]]\nname = \"b\"\nkind = \"box\"\nsize_mm = [30, 30, 10]\nmass_g = 50\n";

TEST(StaticBodies, WhatNothingHoldsIsSaid) {
    std::vector<double> sunk;
    for (const char* dt_ms : {"1", "5", "20"}) {
        Simulation s = make_simulation(load_scene_text(alone + box, "falls.toml", {std::string("dt_ms=") + dt_ms}), 1);
        for (int k = 0; k < 10; ++k) {
            advance(s);
            EXPECT_FALSE(s.world.bodies[0].converged) << dt_ms;
        }
        sunk.push_back(-s.world.shapes[0].pose.position.z);
        const std::vector<BodySummary> bodies = summarise_bodies(s);
        EXPECT_EQ(bodies[0].converged_share, 0);
        EXPECT_EQ(bodies[0].unbalanced_steps, 10);
        EXPECT_NE(to_text(bodies).find("in no static equilibrium in 10 steps"), std::string::npos) << to_text(bodies);
    }
    EXPECT_GT(sunk[0], 1e-3);
    EXPECT_LT(sunk[0], 0.05);
    for (const double way : sunk) EXPECT_NEAR(way, sunk[0], 1e-9);
}

TEST(StaticBodies, WhatSinksComesToRestOnWhatHoldsIt) {
    const std::string plane = "[[object]]\nname = \"floor\"\nkind = \"plane\"\nfriction = 0.5\n";
    Simulation s = make_simulation(
        load_scene_text(alone + plane + box + "position_mm = [0, 0, 12]\nfriction = 0.5\n", "s.toml"), 1);
    for (int k = 0; k < 60; ++k) advance(s);
    const RigidBody& body = s.world.bodies[0];
    EXPECT_TRUE(body.converged);
    EXPECT_NEAR(s.world.shapes[1].pose.position.z, 5e-3, 1e-5);
    EXPECT_NEAR(body.contact_force.z, 9.81 * body.mass, 1e-3 * 9.81 * body.mass);
    EXPECT_EQ(norm(body.velocity), 0);
    const BodySummary summary = summarise_bodies(s)[0];
    EXPECT_GT(summary.unbalanced_steps, 0);
    EXPECT_LT(summary.unbalanced_steps, 40);
}

TEST(StaticBodies, WhatHasBeenPushedDoesNotCoast) {
    // Nothing rubs: a ball that has a velocity at the start stays where it is.
    const std::string plane = "[[object]]\nname = \"floor\"\nkind = \"plane\"\n";
    const std::string ball =
        "[[object]]\nname = \"ball\"\nkind = \"sphere\"\nradius_mm = 10\nposition_mm = [0, 0, 10]\nmass_g = 20\n"
        "velocity_m_per_s = [0.3, 0, 0]\n";
    Simulation s = make_simulation(load_scene_text(alone + plane + ball, "coasts.toml"), 1);
    for (int k = 0; k < 20; ++k) advance(s);
    EXPECT_LT(std::abs(s.world.shapes[1].pose.position.x), 1e-9);
    EXPECT_TRUE(s.world.bodies[0].converged);
}

TEST(StaticBodies, ForcesOnABodyBeforeItsReleaseAreThoseOfItsFingers) {
    Simulation s = make_simulation(load_scene(scenes + "pinch.toml", {"object.cube.release_s=10"}), 2);
    while (s.world.time < 0.5) advance(s);
    Vec3<double> by_fingers{0, 0, 0};
    double grip = 0;
    for (const EntityId finger : s.fingers)
        for (const ObjectContact& c : s.world.contact_surfaces.find(finger)->objects)
            if (c.object == 1) by_fingers -= c.force, grip += c.normal_force;
    ASSERT_GT(grip, 1);
    const Series& series = s.body_series[0];
    const char* columns[] = {"contact_x_N", "contact_y_N", "contact_z_N"};
    for (int d = 0; d < 3; ++d) EXPECT_EQ(series.column(columns[d]).back(), by_fingers[d]);
    EXPECT_GT(norm(by_fingers), 0);
    EXPECT_EQ(series.column("held").back(), 0) << "something else holds it, too";
}

}  // namespace
}  // namespace palpate
