// Settings that change while a scene runs.

#include "scenes/run/carry_over.h"

#include "scenes/load/scene.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/hardware.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::scenes;

/// A run that goes on in another simulation of the same settings gives the same bits; with others it goes on, too.
TEST(CarryOver, GoesOnWhereTheRunWas) {
    int number = 0;
    for (const char* name : {"pinch.toml", "hold_ball.toml"}) {
        if (!testing::is_tried(number++, 2)) continue;
        Simulation run = make_simulation(load_scene(scenes + name), 2);
        while (run.world.time < 1.2) advance(run);
        Simulation other = make_simulation(load_scene(scenes + name), 2);
        Simulation twin = make_simulation(load_scene(scenes + name), 2);
        while (twin.world.time < run.world.time - 1e-9) advance(twin);
        ASSERT_TRUE(carry_over(run, other));
        for (int k = 0; k < 20; ++k) {
            advance(other), advance(twin);
            ASSERT_EQ(outcome_of(other).hashes, outcome_of(twin).hashes) << name << ", step " << k;
        }
        const double held = other.world.shapes[1].pose.position.z;
        Simulation softer = make_simulation(load_scene(scenes + name, {"object.table.friction=0.3"}), 2);
        Simulation finer = make_simulation(load_scene(scenes + name, {"finger.index.elements=500"}), 2);
        EXPECT_FALSE(carry_over(other, finer)) << "other meshes";
        ASSERT_TRUE(carry_over(other, softer));
        for (int k = 0; k < 50; ++k) advance(softer);
        EXPECT_GT(softer.world.time, 1.5);
        EXPECT_GT(softer.world.shapes[1].pose.position.z, held - 0.002) << "it was dropped";
        for (const EntityId finger : softer.fingers) EXPECT_TRUE(skin_status(softer.world, finger).converged);
    }
}

/// Whoever makes a thimble slower while it runs is not to be told nothing and have it as fast as before: limits are
/// taken at once, and where it is armed, it is disarmed.
TEST(CarryOver, NewLimitsOfThimblesAreTakenOrDisarmThem) {
    const auto made = [](std::vector<std::string> overrides, const char* channels = "[0,1,2]") {
        overrides.insert(overrides.end(), {"finger.index.device.driver=maestro-dry", "finger.index.device.serial=\"1\"",
                                           std::string("finger.index.device.channels=") + channels});
        return make_simulation(load_scene(scenes + "press.toml", overrides), 1);
    };
    const std::string slow = "thimbles.velocity_rad_per_s=1";
    Simulation run = made({}), slower = made({slow});
    for (int k = 0; k < 5; ++k) advance(run);
    ASSERT_TRUE(carry_over(run, slower));
    EXPECT_EQ(slower.loops[0]->settings.limits.velocity, 1);
    const testing::ScratchFolder folder;
    arm(slower, {false, folder.path, false});
    Simulation faster = made({}), elsewhere = made({slow}, "[3,4,5]"),
               softer = made({slow, "finger.index.material.young_kPa=20"});
    for (Simulation* other : {&faster, &elsewhere}) {
        EXPECT_FALSE(carry_over(slower, *other));
        EXPECT_FALSE(keep_armed(slower, *other));
    }
    ASSERT_TRUE(carry_over(slower, softer));
    EXPECT_TRUE(softer.hardware);
    EXPECT_EQ(softer.loops[0]->settings.limits.velocity, 1);
    disarm(softer);
}

}  // namespace
}  // namespace palpate
