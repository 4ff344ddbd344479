// World and step: determinism over threads, no allocation, trackers, what is built and what is not.

#include <oneapi/tbb/global_control.h>

#include <atomic>
#include <cstring>
#include <new>
#include <numbers>

#include "devices/drivers/simulated.h"
#include "devices/loop/loop.h"
#include "engine/step.h"
#include "engine/systems.h"
#include "tests/support.h"

namespace {
std::atomic<long> allocations{0};
}  // namespace

// Sanitisers bring their own allocator.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PALPATE_COUNTS_ALLOCATIONS 0
#else
#define PALPATE_COUNTS_ALLOCATIONS 1
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"  // seen where only one of the two is inlined
void* operator new(std::size_t size) {
    ++allocations;
    if (void* p = std::malloc(size ? size : 1)) return p;
    throw std::bad_alloc();
}
void* operator new(std::size_t size, std::align_val_t alignment) {
    ++allocations;
    if (void* p = std::aligned_alloc(std::size_t(alignment), (size + std::size_t(alignment) - 1) /
                                                                 std::size_t(alignment) * std::size_t(alignment)))
        return p;
    throw std::bad_alloc();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }
#endif

namespace palpate {
namespace {

/// With `bodies`, the fingers press on plates of 10 g that lie loose on the table; fingers 0 and 1 share one.
SceneSpec scene_of(int fingers, bool device, double friction = 0.4, bool bodies = false) {
    SceneSpec spec;
    for (int i = 0; i < fingers; ++i) {
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = testing::block_mesh(3, 2, 2, 0.004);
        for (Point& p : f.mesh.nodes) p[0] *= 1 + 0.1 * i;  // same connectivity, other size
        f.has_limits = true;
        f.start.position = {0.03 * i, 0, 0.0045};
        spec.fingers.push_back(std::move(f));
        if (device) {
            ThimbleSpec t;
            t.finger = i;
            t.model = find_kind("chinello-3rrs")->defaults();
            t.model.mount.translation().z() = -0.004 + 0.0246;
            if (i % 2) t.method = MatchingMethod::force;
            spec.thimbles.push_back(t);
        }
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity(), friction});
    spec.objects.push_back(
        {"ball", {ShapeKind::sphere, {0.01, 0, 0}}, {{0.0, 0.0, -0.0095}, Quaternion<double>::identity()}, friction});
    if (!bodies) return spec;
    spec.objects.pop_back();
    for (int i = 0; i < fingers; ++i) {
        const Shape plate{ShapeKind::box, {i == 0 ? 0.022 : 0.008, 0.01, 0.001}};
        if (i == 1) continue;
        ObjectSpec o{"plate", plate, {{0.03 * i + (i == 0 ? 0.015 : 0), 0, 0.001}, {1, 0, 0, 0}}, friction};
        o.body = solid_body(plate, 0.01);
        spec.objects.push_back(o);
    }
    for (FingerSpec& f : spec.fingers) f.start.position.z += 0.002;
    return spec;
}

void drive(World& world, Threads& threads, int steps, int first = 0) {
    for (int k = first; k < first + steps; ++k) {
        for (std::size_t i = 0; i < world.skins.size(); ++i) {
            TrackerPose& t = *world.tracker_poses.find(world.couplings[i].tracker);
            t.incoming.pose = world.skins[i].start;
            t.incoming.pose.position.z -= 2e-3 * std::min(1.0, k / 20.0);
            t.incoming.pose.position.x += 1e-3 * std::max(0.0, (k - 20) / 20.0);
            t.incoming.time = world.time;
            t.incoming.valid = true;
        }
        step(world, threads);
    }
}

class StepWithBodies : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Step, StepWithBodies, ::testing::Bool(),
                         [](const auto& i) { return i.param ? "WithBodies" : "FixedObjects"; });

TEST_P(StepWithBodies, SameBitsForAnyNumberOfThreads) {
    const oneapi::tbb::global_control eight_threads(oneapi::tbb::global_control::max_allowed_parallelism, 8);
    std::vector<World> worlds;
    for (int count : {1, 2, 4, 8}) {
        SceneSpec spec = scene_of(6, true, 0.4, GetParam());
        spec.solver.sample_refinement = 2;
        // Two connectivities: several chunks share the bodies' solve.
        for (int i : {1, 4}) {
            spec.fingers[i].mesh = testing::block_mesh(2, 2, 2, 0.004);
            spec.fingers[i].single_precision = i == 4;
        }
        worlds.push_back(build_world(spec));
        Threads threads(count);
        drive(worlds.back(), threads, 40);
    }
    auto compare = [](const char* array, const auto& a, const auto& b) {
        ASSERT_EQ(a.size(), b.size());
        for (std::size_t i = 0; i < a.size(); ++i)
            ASSERT_EQ(a[i], b[i]) << array << "[" << i << "] depends on the number of threads";
    };
    double force = 0;
    for (const ContactSurface& c : worlds[0].contact_surfaces) force += c.normal_force;
    EXPECT_GT(force, 0.1);
    for (std::size_t w = 1; w < worlds.size(); ++w) {
        for (std::size_t c = 0; c < worlds[0].chunks.doubles.size(); ++c) {
            compare("position", worlds[0].chunks.doubles[c].state.position, worlds[w].chunks.doubles[c].state.position);
            compare("velocity", worlds[0].chunks.doubles[c].state.velocity, worlds[w].chunks.doubles[c].state.velocity);
            compare("normal_multiplier", worlds[0].chunks.doubles[c].state.normal_multiplier,
                    worlds[w].chunks.doubles[c].state.normal_multiplier);
            compare("tangential_multiplier", worlds[0].chunks.doubles[c].state.tangential_multiplier,
                    worlds[w].chunks.doubles[c].state.tangential_multiplier);
        }
        for (std::size_t o = 0; o < worlds[0].shapes.size(); ++o) {
            EXPECT_EQ(worlds[0].shapes[o].pose.position.x, worlds[w].shapes[o].pose.position.x);
            EXPECT_EQ(worlds[0].shapes[o].pose.rotation.y, worlds[w].shapes[o].pose.rotation.y);
        }
        for (std::size_t t = 0; t < worlds[0].matchings.size(); ++t)
            EXPECT_EQ(worlds[0].matchings[t].result.w, worlds[w].matchings[t].result.w)
                << "configuration of thimble " << t;
    }
}

/// The matrix of a large finger is factored by several threads.
TEST(Step, ALargeFingerIsTheSameBitsForAnyNumberOfThreads) {
    const oneapi::tbb::global_control four_threads(oneapi::tbb::global_control::max_allowed_parallelism, 4);
    for (const bool with_body : {false, true}) {
        std::vector<World> worlds;
        for (int count : {1, 2, 4}) {
            SceneSpec spec = scene_of(1, true, 0.4, with_body);
            spec.fingers[0].mesh = testing::block_mesh(14, 12, 9, 0.001);
            spec.fingers[0].single_precision = true;
            spec.solver.newton_iterations = 2;
            worlds.push_back(build_world(spec));
            Threads threads(count);
            drive(worlds.back(), threads, 16);
            const auto& chunk = worlds.back().chunks.floats.at(0);
            ASSERT_EQ(chunk.topology->supernodes.workers, SupernodeFactor::most_workers);
            ASSERT_EQ(chunk.threads != nullptr, count > 1);
        }
        EXPECT_GT(worlds[0].contact_surfaces[0].normal_force, 0.05);
        for (std::size_t k = 1; k < worlds.size(); ++k)
            EXPECT_EQ(worlds[0].chunks.floats[0].state.position, worlds[k].chunks.floats[0].state.position)
                << with_body;
    }
}

TEST(Step, WhatIsNearNoBodyIsSolvedBesideBodiesWithTheSameBits) {
    const oneapi::tbb::global_control eight_threads(oneapi::tbb::global_control::max_allowed_parallelism, 8);
    std::vector<World> worlds;
    int apart = 0;
    for (int count : {1, 2, 4, 8}) {
        SceneSpec spec = scene_of(4, false, 0.4, true);
        spec.objects.pop_back();  // the last finger presses on the table
        spec.fingers[3].start.position.z -= 0.002;
        spec.fingers[3].mesh = testing::block_mesh(2, 2, 2, 0.004);
        worlds.push_back(build_world(spec));
        Threads threads(count);
        for (int k = 0; k < 30; ++k) {
            drive(worlds.back(), threads, 1, k);
            apart += solved_apart(worlds.back().chunks);
        }
    }
    EXPECT_GE(apart, 4 * 20);
    EXPECT_GT(worlds[0].contact_surfaces[3].normal_force, 0.01);
    EXPECT_GT(worlds[0].contact_surfaces[0].normal_force, 0.01);
    for (std::size_t w = 1; w < worlds.size(); ++w)
        for (std::size_t c = 0; c < worlds[0].chunks.doubles.size(); ++c) {
            EXPECT_EQ(worlds[0].chunks.doubles[c].state.position, worlds[w].chunks.doubles[c].state.position) << w;
            EXPECT_EQ(worlds[0].chunks.doubles[c].state.velocity, worlds[w].chunks.doubles[c].state.velocity) << w;
        }
}

TEST_P(StepWithBodies, DoesNotAllocate) {
    if (!PALPATE_COUNTS_ALLOCATIONS) GTEST_SKIP() << "allocations are counted in builds without sanitiser";
    // One chunk and no thimble: no oneTBB task, no NLopt, so nothing at all may allocate.
    World world = build_world(scene_of(1, false, 0.4, GetParam()));
    Threads threads(1);
    drive(world, threads, 10);
    const long before = allocations;
    drive(world, threads, 30);
    EXPECT_EQ(allocations - before, 0);
    EXPECT_GT(world.contact_surfaces[0].normal_force, 0.01);
}

TEST(Step, AFingerFarFromEverythingSleepsUntilItsTargetMovesOrAnObjectComes) {
    SceneSpec spec = scene_of(1, false);
    spec.fingers[0].start.position.z = 0.2;
    World world = build_world(spec);
    Threads threads(1);
    TrackerPose& t = world.tracker_poses[0];
    auto advance = [&](const Pose<double>& pose, int steps) {
        for (int k = 0; k < steps; ++k) t.incoming = {pose, world.time, true}, step(world, threads);
    };
    Pose<double> pose = spec.fingers[0].start;
    advance(pose, 20);
    EXPECT_TRUE(world.chunks.doubles[0].asleep_lanes);
    const auto still = finger_positions(world, world.skins.owner(0));
    advance(pose, 20);
    EXPECT_EQ(finger_positions(world, world.skins.owner(0)), still);
    pose.position.x += 0.01;
    advance(pose, 1);
    EXPECT_FALSE(world.chunks.doubles[0].asleep_lanes);
    advance(pose, 400);
    EXPECT_TRUE(world.chunks.doubles[0].asleep_lanes);
    EXPECT_NEAR(finger_positions(world, world.skins.owner(0))[0][0], still[0][0] + 0.01, 1e-6);
    world.shapes[1].pose.position = pose.position - Vec3<double>{0, 0, 0.0135};  // the ball comes from below
    advance(pose, 3);
    EXPECT_FALSE(world.chunks.doubles[0].asleep_lanes);
    EXPECT_GT(world.contact_surfaces[0].normal_force, 0);
}

/// A hand that is seen no more must not go on pressing: its thimble goes to rest, slowly, and comes back with the hand.
TEST(Step, ASilentTrackerLeadsItsThimbleToRest) {
    World world = build_world(scene_of(1, true));
    Threads threads(1);
    const Matching& m = world.matchings[0];
    ThimbleLoop loop;
    initialise(loop, m.model, {}, make_simulated_driver({}, m.model.kind->joints(m.model, m.model.rest).q));
    world.device_links[0].mailbox = &loop.mailbox;
    Pose<double> pressed = world.skins[0].start;
    pressed.position.z -= 0.002;
    double fastest = 0;
    auto run_for = [&](double seconds, bool seen) {
        fastest = 0;
        for (const double end = world.time + seconds; world.time < end;) {
            world.tracker_poses[0].incoming = {pressed, world.time, seen};
            step(world, threads);
            if (tick(loop, world.time)) fastest = std::max(fastest, loop.velocity.cwiseAbs().maxCoeff());
        }
    };
    run_for(1, true);
    ASSERT_GT(world.contact_surfaces[0].normal_force, 0.05);
    const Coordinates pressing = loop.q;
    const double way = (pressing - loop.rest_q).cwiseAbs().maxCoeff();
    ASSERT_GT(way, 0.1);
    run_for(1.5, false);
    EXPECT_LT((loop.q - pressing).cwiseAbs().maxCoeff(), 0.1 * way) << "a short silence changes nothing";
    run_for(3.5, false);
    EXPECT_LT((loop.q - loop.rest_q).cwiseAbs().maxCoeff(), 1e-3);
    EXPECT_GT(world.contact_surfaces[0].normal_force, 0.05) << "the finger stays where it was seen last";
    EXPECT_LT(fastest, 0.7 * way) << "in two seconds";
    EXPECT_EQ(world.device_links[0].retreats, 1);
    run_for(2, true);
    EXPECT_LT((loop.q - pressing).cwiseAbs().maxCoeff(), 0.1 * way);
    EXPECT_EQ(world.device_links[0].retreat, 0);
}

TEST(Step, FingersOfOneConnectivityShareChunks) {
    const World world = build_world(scene_of(5, false));
    int lanes = 0;
    for (const auto& c : world.chunks.doubles) lanes += c.width;
    EXPECT_GE(lanes, 5);
    EXPECT_LE(int(world.chunks.doubles.size()), 3);
    for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ(world.skins[i].name, "finger" + std::to_string(i));
}

TEST(Step, WhatIsNotNamedIsNotBuilt) {
    const World plain = build_world(scene_of(2, false, 0));
    EXPECT_TRUE(plain.matchings.empty());
    EXPECT_TRUE(plain.device_links.empty());
    for (const auto& c : plain.chunks.doubles) EXPECT_TRUE(c.state.tangential_multiplier.empty());
    SceneSpec bare = scene_of(2, true);
    bare.objects.clear();
    for (FingerSpec& f : bare.fingers) f.has_limits = false;
    const World world = build_world(bare);
    EXPECT_TRUE(world.matchings.empty()) << "a thimble on a finger that cannot touch anything";
    for (const auto& c : world.chunks.doubles) {
        EXPECT_TRUE(c.state.normal_multiplier.empty());
        EXPECT_TRUE(c.state.limit_multiplier.empty());
    }
}

/// At rest the filter takes the tremble away; in motion it lags by the delay that it reports, and no more.
/// A hand that moves and turns evenly is where the lead says it will be.
TEST(Trackers, ExtrapolationCarriesPosesOn) {
    for (double lead : {0.0, 0.03}) {
        PoseFilter f;
        f.min_cutoff = 1000, f.speed_cutoff = 20, f.lead = lead;  // hardly a filter
        Pose<double> out;
        double time = 0;
        auto at = [](double t) {
            return Pose<double>{{0.2 * t, -0.1 * t, 0}, {std::cos(1.5 * t), 0, 0, std::sin(1.5 * t)}};
        };
        for (int k = 0; k < 200; ++k) time = 0.005 * k, out = filter_pose(f, at(time), time);
        const Pose<double> wanted = at(time + lead);
        EXPECT_NEAR(out.position.x, wanted.position.x, 1e-4) << lead;
        EXPECT_NEAR(out.position.y, wanted.position.y, 1e-4) << lead;
        EXPECT_LT(norm(shorter_twice_vector(out.rotation * conjugate(wanted.rotation))), 2e-3) << lead;
        EXPECT_NEAR(f.delay, 1 / (2 * M_PI * (1000 + 0.05 * 1e3 * norm(Vec3<double>{0.2, 0.1, 0}))) - lead, 1e-4);
        // At rest it stays, wherever it came from.
        for (int k = 0; k < 400; ++k) time += 0.005, out = filter_pose(f, wanted, time);
        EXPECT_LT(norm(out.position - wanted.position), 1e-6) << lead;
    }
}

TEST(Trackers, OneEuroFilterCalmsAHandAtRestAndReportsItsDelay) {
    PoseFilter f;
    std::mt19937 random(4);
    std::normal_distribution<double> noise(0, 1);
    const Quaternion<double> tilted = normalised(Quaternion<double>{1, 0.3, -0.2, 0.1});
    double raw = 0, calm = 0, turn = 0, calm_turn = 0;
    double t = 0;
    const double dt = 1.0 / 90;
    for (int k = 0; k < 900; ++k, t += dt) {
        const Vec3<double> shake{3e-4 * noise(random), 3e-4 * noise(random), 3e-4 * noise(random)};
        Quaternion<double> q = rotation_step(Vec3<double>{0, 0, 0.01 * noise(random)}) * tilted;
        const double twist = norm(shorter_twice_vector(q * conjugate(tilted)));
        if (k % 2) q = {-q.w, -q.x, -q.y, -q.z};  // the same rotation
        const Pose<double> out = filter_pose(f, {{0.1 + shake.x, shake.y, shake.z}, q}, t);
        if (k < 90) continue;
        raw += norm(shake), calm += norm(out.position - Vec3<double>{0.1, 0, 0});
        turn += twist, calm_turn += norm(shorter_twice_vector(out.rotation * conjugate(tilted)));
    }
    EXPECT_LT(calm, 0.45 * raw);
    EXPECT_LT(calm_turn, 0.6 * turn);
    for (double speed : {0.05, 0.3, 2.0}) {
        PoseFilter moving;
        Pose<double> out;
        Vec3<double> place{0, 0, 0};
        for (int k = 0; k < 300; ++k) {
            place.x = speed * k * 1e-3;
            out = filter_pose(moving, {place, tilted}, k * 1e-3);
        }
        EXPECT_NEAR((place.x - out.position.x) / speed, moving.delay, 0.02 * moving.delay + 1e-4);
    }
    // A gap begins anew; the same time changes nothing.
    const Pose<double> here = filter_pose(f, {{5, 0, 0}, tilted}, t + 10);
    EXPECT_EQ(here.position.x, 5);
    EXPECT_EQ(filter_pose(f, {{6, 0, 0}, tilted}, t + 10).position.x, 5);
}

TEST(Trackers, BadSamplesAreCountedAndNeverUsed) {
    World world = build_world(scene_of(1, false));
    Threads threads(1);
    drive(world, threads, 2);
    TrackerPose& t = world.tracker_poses[0];
    const Pose<double> good = t.newest.pose;
    auto offer = [&](const TrackerPose::Sample& s) {
        t.incoming = s;
        step(world, threads);
        EXPECT_EQ(std::memcmp(&t.newest.pose, &good, sizeof good), 0);
    };
    const double nan = std::numeric_limits<double>::quiet_NaN();
    offer({{{nan, 0, 0}, Quaternion<double>::identity()}, world.time, true});
    offer({{{0, 0, 0}, {0, 0, 0, 0}}, world.time, true});
    offer({{{0, 0, 1e300}, {1, nan, 0, 0}}, world.time, true});
    EXPECT_EQ(t.not_finite, 3);
    offer({good, t.newest.time - 1, true});
    EXPECT_EQ(t.backward, 1);
    offer({good, world.time, false});
    EXPECT_EQ(t.missing, 1);
    for (double x : world.chunks.doubles[0].state.position) EXPECT_TRUE(std::isfinite(x));
}

TEST(Trackers, OppositeQuaternionsAreOneRotation) {
    auto run = [](bool alternate) {
        World world = build_world(scene_of(1, false));
        Threads threads(1);
        for (int k = 0; k < 20; ++k) {
            TrackerPose& t = world.tracker_poses[0];
            t.incoming = {world.skins[0].start, world.time, true};
            t.incoming.pose.rotation = normalised(Quaternion<double>{0.9, 0.1, 0.2, 0.05 * k});
            Quaternion<double>& q = t.incoming.pose.rotation;
            if (alternate && k % 2) q = {-q.w, -q.x, -q.y, -q.z};
            step(world, threads);
        }
        return finger_positions(world, world.skins.owner(0));
    };
    EXPECT_EQ(run(false), run(true));
}

TEST(Trackers, ATeleportIsSlowedDown) {
    World world = build_world(scene_of(1, false));
    Threads threads(1);
    drive(world, threads, 5);
    TrackerPose& t = world.tracker_poses[0];
    t.incoming.pose.position = {1, 1, 1};
    t.incoming.time = world.time;
    const Vec3<double> before = world.couplings[0].target.position;
    step(world, threads);
    EXPECT_LE(norm(world.couplings[0].target.position - before),
              world.couplings[0].max_speed * world.solver.dt * (1 + 1e-12));
    EXPECT_EQ(world.couplings[0].slowed, 1);
}

TEST(Trackers, AFlipIsSlowedDown) {
    World world = build_world(scene_of(1, false));
    Threads threads(1);
    drive(world, threads, 5);
    const std::int64_t before = world.couplings[0].slowed;
    const Quaternion<double> from = world.couplings[0].target.rotation;
    TrackerPose& t = world.tracker_poses[0];
    const double half = 0.5 * 170 * std::numbers::pi / 180;
    t.incoming.pose.rotation = normalised(Quaternion<double>{std::cos(half), 0, std::sin(half), 0} * from);
    auto angle = [](const Quaternion<double>& a, const Quaternion<double>& b) {
        const Quaternion<double> e = a * conjugate(b);
        return 2 * std::atan2(norm(e.vector()), std::abs(e.w));
    };
    const double most = world.couplings[0].max_spin * world.solver.dt;
    Quaternion<double> last = from;
    int steps = 0;
    for (; steps < 100 && angle(t.incoming.pose.rotation, last) > 1e-6; ++steps) {
        t.incoming.time = world.time;
        step(world, threads);
        const Quaternion<double> now = world.couplings[0].target.rotation;
        EXPECT_LE(angle(now, last), most * (1 + 1e-9));
        last = now;
    }
    const int limited = int(std::ceil(2 * half / most));  // turns that fill all of 170 degrees
    EXPECT_EQ(steps, limited);
    EXPECT_EQ(world.couplings[0].slowed - before, limited - 1);  // the last turn is whole
}

TEST(Trackers, TheCouplingsTorqueIsLimitedAndNotTheTurn) {
    SceneSpec spec = scene_of(1, false);
    spec.solver.inertia = false;
    spec.objects.clear();
    spec.fingers[0].coupling.max_torque = 0.01;
    spec.fingers[0].coupling.max_spin = 1e4;
    World world = build_world(spec);
    Threads threads(1);
    TrackerPose& t = world.tracker_poses[0];
    t.incoming = {spec.fingers[0].start, 0, true};
    step(world, threads);
    // Nothing holds the finger: a torque that is limited turns it all the way.
    t.incoming.pose.rotation = normalised(Quaternion<double>{1, 0, 1, 0} * t.incoming.pose.rotation);
    step(world, threads);
    const Quaternion<double> e = bone_pose(world, world.skins.owner(0)).rotation * conjugate(t.incoming.pose.rotation);
    EXPECT_LT(norm(e.vector()), 1e-6);
}

TEST(Build, RefusesNonsenseWithSentences) {
    SceneSpec spec = scene_of(1, false);
    spec.fingers[0].poisson_ratio = 0.6;
    spec.fingers[0].limit_low = 1.2;
    spec.solver.dt = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(spec.validate().size(), 3u);
    EXPECT_THROW(build_world(spec), std::invalid_argument);
    EXPECT_TRUE(scene_of(1, true).validate().empty());
}

}  // namespace
}  // namespace palpate
