// A firm grasp that is turned: it is held in small steps, and what fingers give the body is what it moves with.

#include <cmath>

#include "scenes/load/scene.h"
#include "scenes/run/grasp.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// A cube between thumb and index, lifted, and turned by 90 degrees in 0.3 s from 1.2 s on.
Simulation turned_grasp(const std::string& mass_g, const std::string& turn_deg, const std::string& dt_ms) {
    return make_simulation(
        load_scene_text("duration_s = 1.5\ndt_ms = " + dt_ms +
                            "\n[limits]\nlow = 0.6\nhigh = 1.4\n"
                            "[[object]]\nname = \"table\"\nfriction = 0.5\n"
                            "[[object]]\nname = \"cube\"\nkind = \"box\"\nsize_mm = [20, 20, 20]\n"
                            "position_mm = [0, 0, 10]\nfriction = 0.8\nmass_g = " +
                            mass_g +
                            "\n[hand]\ntrack = [ { t_s = 0.6, position_mm = [0, 0, 12] }, "
                            "{ t_s = 1, position_mm = [0, 0, 112] }, { t_s = 1.2, position_mm = [0, 0, 112] }, "
                            "{ t_s = 1.5, rotation_deg = " +
                            turn_deg +
                            " } ]\n"
                            "[[finger]]\nname = \"thumb\"\nshape = { finger = \"thumb\" }\n"
                            "track = [ { t_s = 0, position_mm = [0, -22, 0], rotation_deg = [90, 0, 0] }, "
                            "{ t_s = 0.4, position_mm = [0, -14.5, 0], rotation_deg = [90, 0, 0] } ]\n"
                            "[[finger]]\nname = \"index\"\nshape = { finger = \"index\" }\n"
                            "track = [ { t_s = 0, position_mm = [0, 22, 0], rotation_deg = [-90, 0, 0] }, "
                            "{ t_s = 0.4, position_mm = [0, 14, 0], rotation_deg = [-90, 0, 0] } ]\n",
                        "turned.toml"),
        2);
}

TEST(TurnedGrasp, IsHeldInSmallSteps) {
    Simulation s = turned_grasp("100", "[0, 0, 90]", testing::is_tried(1, 2) ? "2" : "3");
    int unconverged = 0, steps = 0;
    while (s.world.time < 1.45) {
        advance(s);
        ++steps;
        for (const EntityId finger : s.fingers) unconverged += !skin_status(s.world, finger).converged;
    }
    EXPECT_LE(unconverged, steps / 100);
    const std::vector<BodySummary> bodies = summarise_bodies(s);
    ASSERT_EQ(bodies.size(), 1u);
    EXPECT_LT(bodies[0].slip_mm, 0.2);
    EXPECT_LT(bodies[0].dropped_at_s, 0);
    ASSERT_EQ(bodies[0].grips.size(), 2u);
    for (const GripSummary& g : bodies[0].grips) EXPECT_LT(g.friction_use, 0.6);
}

TEST(TurnedGrasp, ForcesOfContactAreWhatTheBodyMovesWith) {
    Simulation s = turned_grasp("20", "[90, 0, 0]", "5");
    double worst = 0;
    Vec3<double> before{0, 0, 0};
    while (s.world.time < 1.45) {
        advance(s);
        const RigidBody& body = s.world.bodies[0];
        const Vec3<double> acceleration = (1 / s.world.solver.dt) * (body.velocity - before);
        before = body.velocity;
        if (s.world.time < 1.2 || !body.converged) continue;
        worst = std::max(worst, norm(body.contact_force + body.mass * (s.world.gravity - acceleration)));
    }
    const double weight = 0.02 * 9.81;
    EXPECT_LT(worst, 1e-3 * weight);
}

}  // namespace
}  // namespace palpate
