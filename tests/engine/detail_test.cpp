// What fingers near nothing are left out of, and how those that are solved come together.

#include <gtest/gtest.h>

#include <bit>
#include <random>

#include "engine/build.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "engine/step.h"
#include "tests/support.h"

namespace palpate {
namespace {

struct Touches {
    std::vector<double> from, to;  ///< [finger] [step] it is pressed down
};

SceneSpec fingers_over_a_table(int fingers, bool single, double detail_tolerance, double detail_error = 0) {
    SceneSpec spec;
    spec.solver.dt = 0.002;
    spec.solver.newton_iterations = 3;
    spec.solver.detail_tolerance = detail_tolerance;
    spec.solver.detail_error = detail_error;
    for (int i = 0; i < fingers; ++i) {
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = testing::block_mesh(3, 2, 2, 0.004);
        for (Point& p : f.mesh.nodes) p[0] *= 1 + 0.01 * i;
        f.has_limits = true;
        f.single_precision = single;
        f.start.position = {0.05 * i, 0, 0.03};
        spec.fingers.push_back(std::move(f));
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
    spec.objects.push_back({"ball", {ShapeKind::sphere, {0.01, 0, 0}}, {{0.05, 0.001, -0.0085}, {1, 0, 0, 0}}, 0.3});
    return spec;
}

/// Where finger i is told to be: down and up again within its time, and otherwise still high above.
Pose<double> told(const Pose<double>& start, int i, int k, const Touches& touches) {
    Pose<double> pose = start;
    const double in = k - touches.from[std::size_t(i)], left = touches.to[std::size_t(i)] - k;
    pose.position.z -= 0.0272 * std::clamp(std::min(in, left) / 15.0, 0.0, 1.0);
    pose.position.y += 1e-3 * std::clamp(in / 60.0, 0.0, 1.0);
    return pose;
}

void advance(World& world, Threads& threads, int k, const std::vector<int>& numbers, const Touches& touches) {
    for (std::size_t row = 0; row < world.skins.size(); ++row)
        world.tracker_poses.find(world.couplings[row].tracker)->incoming = {
            told(world.skins[row].start, numbers[row], k, touches), world.time, true};
    step(world, threads);
}

Touches random_touches(int fingers, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> start(20, 200), length(30, 150);
    Touches t;
    for (int i = 0; i < fingers; ++i) {
        t.from.push_back(start(random));
        t.to.push_back(t.from.back() + length(random));
    }
    return t;
}

int solved_lanes(const World& world) {
    int lanes = 0;
    for (const auto& c : world.chunks.doubles) lanes += active_lanes(c) ? c.width : 0;
    for (const auto& c : world.chunks.floats) lanes += active_lanes(c) ? c.width : 0;
    return lanes;
}

struct Case {
    bool single;
    double detail_tolerance, detail_error;
};
class Gathering : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(All, Gathering,
                         ::testing::Values(Case{false, 0, 0}, Case{true, 0, 0}, Case{false, 2e-5, 0},
                                           Case{true, 2e-5, 0}, Case{false, 2e-5, 0.05}, Case{true, 2e-5, 0.05}),
                         [](const auto& i) {
                             return std::string(i.param.single ? "Float" : "Double") +
                                    (i.param.detail_tolerance > 0 ? "Auto" : "Full") +
                                    (i.param.detail_error > 0 ? "Linear" : "");
                         });

TEST_P(Gathering, LeavesEveryFingerTheBitsItHasAlone) {
    constexpr int fingers = 21;
    const auto [single, tolerance, error] = GetParam();
    const Touches touches = random_touches(fingers, 3);
    const SceneSpec spec = fingers_over_a_table(fingers, single, tolerance, error);
    World together = build_world(spec);
    std::vector<World> alone;
    std::vector<int> numbers;
    for (int i = 0; i < fingers; ++i) {
        SceneSpec own = spec;
        own.fingers = {spec.fingers[std::size_t(i)]};
        alone.push_back(build_world(own));
        numbers.push_back(i);
    }
    Threads threads(1);
    std::vector<std::pair<int, int>> places;
    for (const Skin& skin : together.skins) places.emplace_back(skin.chunk, skin.lane);
    int touching = 0, moved = 0, linear = 0, beside = 0;
    for (int k = 0; k < 400; ++k) {
        advance(together, threads, k, numbers, touches);
        for (int i = 0; i < fingers; ++i) {
            World& one = alone[std::size_t(i)];
            advance(one, threads, k, {i}, touches);
            ASSERT_EQ(finger_positions(together, together.skins.owner(std::size_t(i))),
                      finger_positions(one, one.skins.owner(0)))
                << "finger " << i << " in step " << k;
            const ContactSurface &a = together.contact_surfaces[std::size_t(i)], &b = one.contact_surfaces[0];
            ASSERT_EQ(a.normal_force, b.normal_force) << "finger " << i << " in step " << k;
            ASSERT_EQ(a.total.y, b.total.y) << "finger " << i << " in step " << k;
            touching += a.normal_force > 0.01;
        }
        auto count_linear = [&](const auto& chunks) {
            for (const auto& c : chunks) {
                linear += std::popcount(c.linear_lanes);
                if (active_lanes(c) & ~c.linear_lanes) beside += std::popcount(c.linear_lanes);
            }
        };
        count_linear(together.chunks.doubles), count_linear(together.chunks.floats);
        for (std::size_t i = 0; i < places.size(); ++i)
            moved += places[i] != std::pair{together.skins[i].chunk, together.skins[i].lane};
    }
    EXPECT_GT(touching, 1000);
    if (error > 0) {
        EXPECT_GT(linear, 1000);
        EXPECT_GT(beside, 100) << "lanes beside others that are not linear";
    } else {
        EXPECT_EQ(linear, 0);
    }
    EXPECT_GT(moved, 0);
}

TEST_P(Gathering, SolvesFewLanesWhereFewFingersTouch) {
    constexpr int fingers = 40;
    const auto [single, tolerance, error] = GetParam();
    World world = build_world(fingers_over_a_table(fingers, single, tolerance, error));
    const int all = int(world.skins.size());
    Touches touches;
    std::vector<int> numbers;
    for (int i = 0; i < fingers; ++i) {  // three that lie far apart touch, one after the other
        numbers.push_back(i);
        touches.from.push_back(i % 16 == 5 ? double(60 + 40 * (i / 16)) : 1e9);
        touches.to.push_back(2e9);
    }
    Threads threads(1);
    for (int k = 0; k < 120; ++k) advance(world, threads, k, numbers, touches);
    int widest = 1;
    for (const auto& c : world.chunks.doubles) widest = std::max(widest, c.width);
    for (const auto& c : world.chunks.floats) widest = std::max(widest, c.width);
    EXPECT_LE(solved_lanes(world), std::max(widest, 4)) << "of " << all;
    for (int k = 120; k < 260; ++k) advance(world, threads, k, numbers, touches);
    EXPECT_LE(solved_lanes(world), std::max(widest, 4));
    for (int i : {5, 21, 37}) EXPECT_GT(world.contact_surfaces[std::size_t(i)].normal_force, 0.01);
}

TEST(ExchangeLanes, ThereAndBackIsNothing) {
    SceneSpec spec = fingers_over_a_table(12, false, 0);
    World world = build_world(spec);
    const Touches touches = random_touches(12, 5);
    std::vector<int> numbers;
    for (int i = 0; i < 12; ++i) numbers.push_back(i);
    Threads threads(1);
    for (int k = 0; k < 120; ++k) advance(world, threads, k, numbers, touches);
    auto& chunks = world.chunks.doubles;
    int exchanged = 0;
    for (auto& a : chunks)
        for (auto& b : chunks) {
            if (&a == &b) continue;
            for (int l = 0; l < a.width; ++l)
                for (int m = 0; m < b.width; ++m) {
                    if (!((active_lanes(a) >> l) & 1u) || !((b.asleep_lanes >> m) & 1u)) continue;
                    const SkinState<double> before_a = a.state, before_b = b.state;
                    const ContactSlots contacts = a.contacts;
                    exchange_lanes(a, l, b, m);
                    EXPECT_NE(a.state.position, before_a.position);
                    exchange_lanes(b, m, a, l);
                    EXPECT_EQ(a.state.position, before_a.position);
                    EXPECT_EQ(b.state.position, before_b.position);
                    EXPECT_EQ(a.state.origin, before_a.origin);
                    EXPECT_EQ(a.state.normal_multiplier, before_a.normal_multiplier);
                    EXPECT_EQ(a.state.tangential_multiplier, before_a.tangential_multiplier);
                    EXPECT_EQ(a.state.limit_multiplier, before_a.limit_multiplier);
                    EXPECT_EQ(a.contacts.count, contacts.count);
                    for (int s = 0; s < contacts.count[std::size_t(l)]; ++s)
                        EXPECT_EQ(a.contacts.at(s, l).object, contacts.at(s, l).object);
                    ++exchanged;
                }
        }
    EXPECT_GT(exchanged, 0);
}

/// A finger led through the air, stopped, pressed, rolled, lifted.
Pose<double> journey(const Pose<double>& start, double t) {
    Pose<double> pose = start;
    pose.position.x += 0.1 * std::sin(2 * t) * std::clamp(t, 0.0, 1.0);
    pose.position.z += 0.015 * std::sin(9 * t) - 0.0125;
    const double angle = 0.3 * std::sin(5 * t);
    pose.rotation = {std::cos(angle / 2), std::sin(angle / 2), 0, 0};
    return pose;
}

TEST(RigidSkin, GivesTheForcesOfTheFullSolveWithinItsTolerance) {
    auto run = [](double tolerance, int& rigid, std::vector<Vec3<double>>& forces, std::vector<double>& pulls) {
        SceneSpec spec = fingers_over_a_table(1, false, tolerance);
        spec.solver.dt = 0.001;
        spec.solver.newton_iterations = 30;
        World world = build_world(spec);
        Threads threads(1);
        rigid = 0;
        for (int k = 0; k < 3000; ++k) {
            world.tracker_poses[0].incoming = {journey(world.skins[0].start, 0.001 * k), world.time, true};
            step(world, threads);
            rigid += world.chunks.doubles[0].rigid_lanes != 0;
            forces.push_back(world.contact_surfaces[0].total);
            pulls.push_back(world.couplings[0].force_N);
        }
    };
    std::vector<Vec3<double>> full, automatic;
    std::vector<double> full_pull, automatic_pull;
    int rigid = 0, none = 0;
    run(0, none, full, full_pull);
    run(2e-5, rigid, automatic, automatic_pull);
    EXPECT_EQ(none, 0);
    EXPECT_GT(rigid, 500);
    double largest = 0, off = 0, off_pull = 0;
    for (std::size_t k = 0; k < full.size(); ++k) {
        largest = std::max(largest, norm(full[k]));
        off = std::max(off, norm(full[k] - automatic[k]));
        off_pull = std::max(off_pull, std::abs(full_pull[k] - automatic_pull[k]));
    }
    EXPECT_GT(largest, 0.5);
    EXPECT_LT(off, 0.01 * largest);
    EXPECT_LT(off_pull, 0.01 * largest);
}

TEST(RigidSkin, MovesAsTheBoneOfTheFullSolve) {
    auto bones = [](double tolerance) {
        SceneSpec spec = fingers_over_a_table(1, false, tolerance);
        spec.fingers[0].start.position.z = 0.2;
        World world = build_world(spec);
        Threads threads(1);
        std::vector<Pose<double>> all;
        for (int k = 0; k < 500; ++k) {
            world.tracker_poses[0].incoming = {journey(world.skins[0].start, 0.002 * k), world.time, true};
            step(world, threads);
            all.push_back(bone_pose(world, world.skins.owner(0)));
        }
        return all;
    };
    const auto full = bones(0), rigid = bones(1e-3);
    for (std::size_t k = 0; k < full.size(); ++k) {
        EXPECT_LT(norm(full[k].position - rigid[k].position), 2e-5) << "step " << k;
        EXPECT_LT(norm((full[k].rotation * conjugate(rigid[k].rotation)).vector()), 2e-3) << "step " << k;
    }
}

/// A pad of nodes 4 mm apart over a thin rod, pressed and led along; and over a table.
struct RodRun {
    double force = 0;
    int fine_steps = 0;
};
RodRun press_on(bool rod, int refinement, double penetration) {
    SceneSpec spec = fingers_over_a_table(1, false, 0);
    spec.solver.sample_refinement = refinement;
    spec.solver.detail_penetration = penetration;
    spec.objects.resize(1);
    if (rod) {
        Shape capsule{ShapeKind::capsule, {0.0005, 0.05, 0}};
        spec.objects[0] = {"rod", capsule, {{0.0002, 0, 0}, {std::sqrt(0.5), std::sqrt(0.5), 0, 0}}, 0};
    }
    World world = build_world(spec);
    Threads threads(1);
    RodRun run;
    for (int k = 0; k < 200; ++k) {
        Pose<double> pose = world.skins[0].start;
        pose.position.z -= std::min(rod ? 0.0258 : 0.0265, 0.0003 * k);
        world.tracker_poses[0].incoming = {pose, world.time, true};
        step(world, threads);
        run.fine_steps += world.chunks.doubles[0].fine_lanes & 1u;
        run.force = world.contact_surfaces[0].normal_force;
    }
    return run;
}

TEST(SamplesBetweenNodes, CountWhereAThinRodWouldSinkInBetweenNodesAndNotOnATable) {
    const RodRun coarse = press_on(true, 1, 0), fine = press_on(true, 4, 0), chosen = press_on(true, 4, 5e-5);
    EXPECT_LT(coarse.force, 0.3 * fine.force) << "the rod falls between nodes";
    EXPECT_NEAR(chosen.force, fine.force, 0.02 * fine.force);
    EXPECT_GT(chosen.fine_steps, 20);
    EXPECT_LT(chosen.fine_steps, 150);
    const RodRun table = press_on(false, 4, 5e-5), plain = press_on(false, 1, 0);
    EXPECT_GT(plain.force, 0.01);
    EXPECT_EQ(table.fine_steps, 0);
    EXPECT_EQ(table.force, plain.force);
}

}  // namespace
}  // namespace palpate
