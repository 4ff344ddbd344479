// What a finger touches is its own: any number of objects, whoever shares its chunk, in both precisions.

#include <gtest/gtest.h>

#include <cmath>

#include "engine/build.h"
#include "engine/step.h"
#include "tests/support.h"

namespace palpate {
namespace {

constexpr double pitch = 0.014;

/// Fingers in a row over keys that are narrower than they are; each presses two to four of its own, and lies near
/// more. With `only`, the one finger alone; the keys are the same.
SceneSpec keyboard(int fingers, bool single, int only = -1) {
    SceneSpec spec;
    for (int i = 0; i < fingers; ++i) {
        if (only >= 0 && i != only) continue;
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = testing::block_mesh(3, 3, 2, 0.004);
        f.single_precision = single;
        f.has_limits = true;
        f.start.position = {0.001 * i, pitch * i, 0.0045};
        spec.fingers.push_back(std::move(f));
    }
    const int keys = 4 * 16 + 24;
    for (int k = 0; k < keys; ++k) {
        const double y = pitch / 4 * (k - 8);
        ObjectSpec o{"key" + std::to_string(k),
                     {ShapeKind::box, {0.02, 0.0016, 0.005}},
                     {{0, y, -0.005}, {1, 0, 0, 0}},
                     k % 3 ? 0.4 : 0.0};
        if (k % 4 == 1) o.shape = {ShapeKind::capsule, {0.0016, 0.02, 0}};
        if (k % 4 == 1) o.pose = {{0, y, -0.0016}, {std::sqrt(0.5), 0, std::sqrt(0.5), 0}};
        if (k % 4 == 3) o.shape = {ShapeKind::sphere, {0.003, 0, 0}}, o.pose.position.z = -0.003;
        if (k % 8 == 6) o.stiffness = 1e7;
        spec.objects.push_back(o);
    }
    return spec;
}

World pressed(const SceneSpec& spec, int steps = 24) {
    World world = build_world(spec);
    Threads threads(1);
    for (int k = 0; k < steps; ++k) {
        for (std::size_t i = 0; i < world.skins.size(); ++i) {
            Pose<double> pose = world.skins[i].start;
            pose.position.z -= 2e-3 * std::min(1.0, k / 12.0);
            pose.position.x += 1e-3 * std::max(0.0, (k - 12) / 12.0);
            world.tracker_poses.find(world.couplings[i].tracker)->incoming = {pose, world.time, true};
        }
        step(world, threads);
    }
    return world;
}

int touched(const ContactSurface& c) {
    int count = 0;
    for (const ObjectContact& o : c.objects) count += o.normal_force > 0;
    return count;
}

class Contacts : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Step, Contacts, ::testing::Bool(),
                         [](const auto& i) { return i.param ? "Single" : "Double"; });

/// Chunks of 1, 2, 4, 8 and 16 lanes, as far as the processor has them.
TEST_P(Contacts, AFingerOnAKeyboardIsTheSameAloneAndInChunksOfAnyWidth) {
    constexpr int most = 16;
    std::vector<World> alone;
    for (int i = 0; i < most; ++i) alone.push_back(pressed(keyboard(most, GetParam(), i)));
    for (int fingers : {2, 4, 8, 16}) {
        const World together = pressed(keyboard(fingers, GetParam()));
        for (int i = 0; i < fingers; ++i) {
            const auto row = std::size_t(i);
            const ContactSurface &a = together.contact_surfaces[row], &b = alone[row].contact_surfaces[0];
            EXPECT_GE(touched(a), 2) << "finger " << i << " of " << fingers;
            EXPECT_EQ(a.total.x, b.total.x) << "finger " << i << " of " << fingers;
            EXPECT_EQ(a.total.z, b.total.z) << "finger " << i << " of " << fingers;
            ASSERT_EQ(a.objects.size(), b.objects.size());
            for (std::size_t o = 0; o < a.objects.size(); ++o) {
                EXPECT_EQ(a.objects[o].object, b.objects[o].object);
                EXPECT_EQ(a.objects[o].normal_force, b.objects[o].normal_force);
            }
            EXPECT_EQ(finger_positions(together, together.skins.owner(row)),
                      finger_positions(alone[row], alone[row].skins.owner(0)));
        }
    }
}

TEST(Contacts, PrecisionsAgreeOnAKeyboard) {
    const World d = pressed(keyboard(16, false)), f = pressed(keyboard(16, true));
    for (std::size_t i = 0; i < 16; ++i) {
        EXPECT_GT(d.contact_surfaces[i].normal_force, 0.2);
        EXPECT_NEAR(f.contact_surfaces[i].normal_force, d.contact_surfaces[i].normal_force,
                    5e-3 * d.contact_surfaces[i].normal_force);
    }
}

/// A slot of a chunk that holds a body in one lane, a fixed box in another, and nothing in a third.
TEST_P(Contacts, BodiesAndFixedObjectsShareSlots) {
    auto scene = [&](int only) {
        SceneSpec spec = keyboard(8, GetParam(), only);
        spec.objects.clear();
        for (int i = 0; i < 8; ++i) {
            const Shape plate{ShapeKind::box, {0.008, 0.006, 0.001}};
            ObjectSpec o{"plate", plate, {{0, 4 * pitch * i, 0.001}, {1, 0, 0, 0}}, 0.4};
            if (i % 3 == 1) o.body = solid_body(plate, 0.01);
            if (i % 3 != 2) spec.objects.push_back(o);
        }
        spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.4});
        // Far apart: fingers near one body would share its island.
        for (FingerSpec& f : spec.fingers) f.start.position.y *= 4, f.start.position.z += 0.002;
        return spec;
    };
    const World together = pressed(scene(-1));
    for (int i = 0; i < 8; ++i) {
        if (!testing::is_tried(i, 4)) continue;
        const World alone = pressed(scene(i));
        const auto row = std::size_t(i);
        const double force = together.contact_surfaces[row].total.z, by_itself = alone.contact_surfaces[0].total.z;
        if (GetParam() && i % 3 != 1) {
            // In single precision a finger near no body, beside one that is, takes its decisions in double.
            EXPECT_NEAR(force, by_itself, 1e-3 * by_itself) << i;
            continue;
        }
        EXPECT_EQ(force, by_itself) << i;
        EXPECT_EQ(finger_positions(together, together.skins.owner(row)), finger_positions(alone, alone.skins.owner(0)))
            << i;
        if (i % 3 != 2) { EXPECT_GT(together.contact_surfaces[row].total.z, 0.1) << i; }
    }
}

/// Memory for more objects is made where they come near, before the solve, and counted; then there is enough.
TEST(Contacts, MemoryGrowsWithWhatIsNearAndIsCounted) {
    World world = pressed(keyboard(2, false), 12);
    EXPECT_GT(world.contact_growths, 0);
    const auto grown = world.contact_growths;
    Threads threads(1);
    for (int k = 0; k < 10; ++k) step(world, threads);
    EXPECT_EQ(world.contact_growths, grown);
    for (const auto& c : world.chunks.doubles)
        for (int lane = 0; lane < c.width; ++lane) {
            EXPECT_LE(c.contacts.count[std::size_t(lane)], c.contacts.capacity);
            for (int slot = 1; slot < c.contacts.count[std::size_t(lane)]; ++slot)
                EXPECT_LT(c.contacts.at(slot - 1, lane).object, c.contacts.at(slot, lane).object);
        }
}

/// What an object does to a finger, in sum over its samples, is what it is pushed with: also in the steps in which
/// samples leave it, and friction acts without a normal force.
TEST(Contacts, ReportedForcesBalanceWhileAFingerIsWipedOffABody) {
    SceneSpec spec = keyboard(1, false);
    spec.objects.clear();
    const Shape plate{ShapeKind::box, {0.02, 0.02, 0.001}};
    ObjectSpec o{"plate", plate, {{0, 0, 0.001}, {1, 0, 0, 0}}, 0.8};
    o.body = solid_body(plate, 20);
    spec.objects.push_back(o);
    spec.gravity = {0, 0, 0};
    spec.solver.newton_iterations = 1;
    spec.fingers[0].start.position.z += 0.002;
    World world = build_world(spec);
    Threads threads(1);
    double worst = 0;
    int alone = 0;
    for (int k = 0; k < 60; ++k) {
        Pose<double> pose = spec.fingers[0].start;
        pose.position.z -= 2e-3 * std::min(1.0, k / 6.0) - 4e-4 * std::max(0, k - 12);
        pose.position.x += 6e-4 * std::max(0, k - 6);
        world.tracker_poses[0].incoming = {pose, world.time, true};
        step(world, threads);
        const auto& c = world.chunks.doubles[0];
        for (std::size_t s = 0; s < c.state.friction_radius.size() && c.contacts.count[0] > 0; ++s)
            alone += c.state.normal_multiplier[s] <= 0 && std::abs(c.state.tangential_multiplier[3 * s]) > 1e-4;
        const Vec3<double> sum = world.contact_surfaces[0].total + world.bodies[0].contact_force;
        worst = std::max(worst, norm(sum));
    }
    EXPECT_GT(alone, 0) << "no sample left while it was rubbed: the test tests nothing";
    EXPECT_LT(worst, 1e-6);
}

}  // namespace
}  // namespace palpate
