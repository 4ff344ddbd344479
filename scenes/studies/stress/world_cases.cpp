// Extremes of a whole world: contacts, trackers, threads, time, and one finger lost.

#include <cmath>
#include <fstream>
#include <random>

#include "devices/drivers/simulated.h"
#include "devices/loop/loop.h"
#include "scenes/run/detail_count.h"
#include "scenes/studies/stress/cases.h"
#include "scenes/trackers/trajectory.h"

namespace palpate::stress {

namespace {

/// Force on a finger that comes down at `speed` on something, once it rests 1.5 mm below where it would touch.
double force_after(double speed, double dt, const Shape& shape, const Pose<double>& pose, bool& converged) {
    SceneSpec spec = press_spec(150, 0.02);
    spec.solver.dt = dt;
    spec.fingers[0].coupling.max_speed = 100;
    spec.objects[0].shape = shape;
    spec.objects[0].pose = pose;
    World world = build_world(spec);
    Threads threads(1);
    Pose<double> target = spec.fingers[0].start;
    const double lowest = target.position.z - 0.02 - 1.5e-3;
    const int steps = int(0.15 / dt) + int(0.022 / (speed * dt));
    for (int k = 0; k < steps; ++k) {
        target.position.z = std::max(lowest, target.position.z - speed * dt);
        aim(world, 0, target);
        step(world, threads);
    }
    converged = skin_status(world, world.skins.owner(0)).converged && finite(world);
    return norm(world.contact_surfaces[0].total);
}

/// Cards and rods at any speed: the finger ends on the side that it came from, with the force that it has when it comes
/// slowly. A rod may come between nodes; that it did is said.
bool thin_and_fast(std::string& found) {
    struct Case {
        const char* name;
        Shape shape;
        Pose<double> pose;
    };
    const Quaternion<double> lying = from_roll_pitch_yaw(1.5707963, 0.0, 0.0),
                             upright = Pose<double>::identity().rotation;
    const Case cases[] = {
        {"card of 0.1 mm", {ShapeKind::box, {0.04, 0.04, 5e-5}}, {{0, 0, -5e-5}, upright}},
        {"card of 1 mm", {ShapeKind::box, {0.04, 0.04, 5e-4}}, {{0, 0, -5e-4}, upright}},
        {"rod with round ends of 8 mm", {ShapeKind::capsule, {4e-3, 0.03, 0}}, {{0, 0, -4e-3}, lying}},
        {"rod of 8 mm", {ShapeKind::cylinder, {4e-3, 0.03, 0}}, {{0, 0, -4e-3}, lying}},
    };
    int runs = 0, crossed = 0, wrong = 0;
    double worst = 0;
    for (const Case& c : cases) {
        bool converged = true;
        const double right = force_after(0.05, 1e-3, c.shape, c.pose, converged);
        for (double speed : {0.1, 1.0, 10.0})
            for (double dt : {1e-3, 5e-3, 20e-3}) {
                const double force = force_after(speed, dt, c.shape, c.pose, converged);
                const double off = std::abs(force - right) / right;
                ++runs;
                const bool rod = c.shape.kind != ShapeKind::box;
                if (rod && !converged) {
                    ++crossed;
                    continue;
                }
                worst = std::max(worst, off);
                if (off > 0.02 || !converged || !(right > 0.05)) {
                    ++wrong;
                    found += text("%s, %g m/s, %g ms: %.3f N instead of %.3f; ", c.name, speed, 1e3 * dt, force, right);
                }
            }
    }
    found += text("cards and rods: %d of %d kept their side, forces within %.2g %%; %d rods did not, and it is said",
                  runs - crossed - wrong, runs, 100 * worst, crossed);
    return wrong == 0;
}

}  // namespace

/// S8
StressOutcome contacts(int, const std::atomic<bool>&) {
    std::string found;
    bool good = true;
    for (const char* name :
         {"wholly inside a box", "two objects in one place", "at 100 m/s", "on a needle", "on an edge"}) {
        const std::string what = name;
        SceneSpec spec = press_spec(347);
        const Pose<double> start = spec.fingers[0].start;
        if (what == "wholly inside a box") spec.objects[0].shape = {ShapeKind::box, {0.1, 0.1, 0.1}};
        if (what == "two objects in one place") spec.objects.push_back(spec.objects[0]);
        if (what == "on a needle") spec.objects[0].shape = {ShapeKind::capsule, {1e-4, 0.01, 0}};
        if (what == "on an edge") {
            spec.objects[0].shape = {ShapeKind::box, {0.05, 0.05, 0.05}};
            spec.objects[0].pose.rotation = from_roll_pitch_yaw(0.785398, 0.0, 0.0);
            spec.objects[0].pose.position.z = -0.05 * std::sqrt(2.0);
        }
        World world = build_world(spec);
        Threads threads(1);
        int most = 0, resets = 0;
        Pose<double> target = start;
        for (int k = 0; k < 100; ++k) {
            if (what == "at 100 m/s")
                target.position.z = k < 50 ? start.position.z - 0.5 * k : start.position.z;
            else if (k < 30)
                target.position.z -= 1e-4;
            aim(world, 0, target);
            step(world, threads);
            const SkinStatus& s = skin_status(world, world.skins.owner(0));
            most = std::max(most, s.newton_iterations);
            resets += s.reset;
            if (!finite(world)) good = false, found += what + ": not finite; ";
        }
        found += text("%s%s: %d iterations at most, %d resets", found.empty() ? "" : "; ", name, most, resets);
    }
    found += "; ";
    good = thin_and_fast(found) && good;
    return {good, found};
}

/// S10
StressOutcome tracker_faults(int effort, const std::atomic<bool>&) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> u(-1, 1);
    SceneSpec spec = press_spec(150);
    ThimbleSpec thimble;
    thimble.model = find_kind("chinello-3rrs")->defaults();
    spec.thimbles.push_back(thimble);
    World world = build_world(spec);
    Threads threads(1);
    ThimbleLoop loop;
    initialise(loop, thimble.model, {},
               make_simulated_driver({}, thimble.model.kind->joints(thimble.model, thimble.model.rest).q));
    world.device_links[0].mailbox = &loop.mailbox;
    Coordinates before = loop.q, speed = loop.velocity;
    bool good = true;
    const int steps = 2000 * effort;
    for (int k = 0; k < steps && good; ++k) {
        Pose<double> pose = spec.fingers[0].start;
        pose.position.z -= 0.002;
        TrackerPose::Sample s{pose, world.time, true};
        switch (random() % 12) {
            case 0:
                s.pose.position.x = NAN;
                break;
            case 1:
                s.pose.rotation = {0, 0, 0, 0};
                break;
            case 2:
                s.pose.rotation = {-s.pose.rotation.w, -s.pose.rotation.x, -s.pose.rotation.y, -s.pose.rotation.z};
                break;
            case 3:
                s.pose.position.x += 1;
                break;
            case 4:
                s.pose.rotation = {0, 1, 0, 0};
                break;
            case 5:
                s.valid = false;
                break;
            case 6:
                s.time -= 1;
                break;
            case 7:
                s.pose.position.z += 0.01 * u(random);
                break;
            default:
                break;
        }
        world.tracker_poses[0].incoming = s;
        step(world, threads);
        if (!tick(loop, world.time)) continue;
        const double dt = loop.settings.period;
        for (int j = 0; j < loop.q.size(); ++j) {
            good = good && std::isfinite(loop.q[j]) && loop.q[j] >= thimble.model.joint_min[j] &&
                   loop.q[j] <= thimble.model.joint_max[j] &&
                   std::abs(loop.q[j] - before[j]) <= loop.settings.limits.velocity * dt * (1 + 1e-9) &&
                   std::abs(loop.velocity[j] - speed[j]) <= loop.settings.limits.acceleration * dt * (1 + 1e-9);
        }
        before = loop.q, speed = loop.velocity;
    }
    const TrackerPose& t = world.tracker_poses[0];
    return {good && finite(world) && t.not_finite > 0 && t.backward > 0 && t.missing > 0,
            text("%d steps: %lld not finite, %lld backward, %lld missing, all counted; joints inside range, speed and "
                 "acceleration",
                 steps, (long long)t.not_finite, (long long)t.backward, (long long)t.missing)};
}

namespace {
double resident_MB() {
    std::ifstream in("/proc/self/statm");
    double pages = 0, resident = 0;
    in >> pages >> resident;
    return resident * 4096e-6;
}

struct Soak {
    bool finite = true;
    long steps = 0, resets = 0;
    double growth_MB = 0, linear = 0;  ///< share of the steps of fingers
};
/// Ten fingers, each told to be elsewhere in one of `every` steps.
Soak soak_fingers(long steps, unsigned every, bool automatic, const std::atomic<bool>& stop) {
    std::mt19937 random(4);
    std::uniform_real_distribution<double> u(-1, 1);
    SceneSpec spec = press_spec(150);
    spec.objects[0].friction = 0.5;
    spec.objects.push_back({"ball", {ShapeKind::sphere, {0.02, 0, 0}}, {{0, 0, -0.012}, {1, 0, 0, 0}}, 0.5});
    const FingerSpec first = spec.fingers[0];
    spec.solver.newton_iterations = 2;
    spec.solver.detail_tolerance = automatic ? 2e-5 : 0;
    spec.solver.detail_error = automatic ? 0.01 : 0;
    for (int i = 1; i < 10; ++i) {
        spec.fingers.push_back(first);
        spec.fingers.back().name += std::to_string(i);
        spec.fingers.back().start.position.x += 0.03 * i;
        spec.fingers.back().single_precision = i >= 5;
    }
    World world = build_world(spec);
    Threads threads(2);
    Soak s;
    DetailCount count;
    double memory = 0;
    for (; s.steps < steps && !stop; ++s.steps) {
        for (std::size_t i = 0; i < 10; ++i) {
            if (random() % every) continue;
            Pose<double> pose = spec.fingers[i].start;
            pose.position += 0.004 * Vec3<double>{u(random), u(random), u(random)};
            pose.rotation = from_roll_pitch_yaw(0.5 * u(random), 0.5 * u(random), 3 * u(random));
            if (random() % 500 == 0) pose.position.x += 1000 * u(random);
            aim(world, i, pose);
            if (random() % 300 == 0) world.tracker_poses[i].incoming.pose.position.y = NAN;
        }
        world.shapes[1].pose.position.x = 0.1 * std::sin(0.001 * double(s.steps));
        step(world, threads);
        count_detail(world, count);
        for (std::size_t i = 0; i < 10; ++i) s.resets += skin_status(world, world.skins.owner(i)).reset;
        if (!(s.finite = finite(world))) return s;
        if (s.steps == std::min(1000L, steps / 2)) memory = resident_MB();
    }
    s.growth_MB = resident_MB() - memory;
    s.linear = double(count.linear) / double(std::max<std::int64_t>(1, count.all));
    return s;
}

}  // namespace

/// S12
StressOutcome soak(int effort, const std::atomic<bool>& stop) {
    const long steps = effort >= 10 ? 1000000 : 3000L * effort;
    const Soak full = soak_fingers(steps, 3, false, stop);
    if (!full.finite) return {false, text("not finite in step %ld", full.steps)};
    const Soak automatic = soak_fingers(steps / 3, 60, true, stop);
    if (!automatic.finite) return {false, text("not finite in step %ld with detail = auto", automatic.steps)};
    return {
        full.growth_MB < 2 && automatic.growth_MB < 2,
        text("%ld steps of ten fingers: finite, %ld resets, memory %+.1f MB; %ld with detail = auto (tissue linear in "
             "%.0f %%): finite, %ld resets, %+.1f MB",
             full.steps, full.resets, full.growth_MB, automatic.steps, 100 * automatic.linear, automatic.resets,
             automatic.growth_MB)};
}

/// S13
StressOutcome determinism(int effort, const std::atomic<bool>&) {
    std::vector<std::vector<double>> results;
    for (int count : {1, 2, 3, 8, 32, 1}) {
        SceneSpec spec = press_spec(150);
        const FingerSpec first = spec.fingers[0];
        for (int i = 1; i < 20; ++i) {
            spec.fingers.push_back(first);
            spec.fingers.back().name += std::to_string(i);
            spec.fingers.back().young_modulus *= 1 + 0.05 * i;
        }
        World world = build_world(spec);
        Threads threads(count);
        for (int k = 0; k < 20 * effort; ++k) {
            for (std::size_t i = 0; i < 20; ++i) {
                Pose<double> pose = first.start;
                pose.position.z -= std::min(0.002, 1e-4 * k);
                aim(world, i, pose);
            }
            step(world, threads);
        }
        std::vector<double> all;
        for (const auto& c : world.chunks.doubles)
            all.insert(all.end(), c.state.position.begin(), c.state.position.end());
        results.push_back(std::move(all));
    }
    int same = 0;
    for (const auto& r : results) same += r == results[0];
    return {same == int(results.size()),
            text("1, 2, 3, 8, 32 threads and once more: %d of %zu the same bits", same, results.size())};
}

/// S14
StressOutcome one_finger_lost(int, const std::atomic<bool>&) {
    auto run = [](bool poison, int& resets) {
        SceneSpec spec = press_spec(150);
        const FingerSpec first = spec.fingers[0];
        for (int i = 1; i < 4; ++i) spec.fingers.push_back(first), spec.fingers.back().name += std::to_string(i);
        World world = build_world(spec);
        Threads threads(1);
        for (int k = 0; k < 60; ++k) {
            for (std::size_t i = 0; i < 4; ++i) {
                Pose<double> pose = first.start;
                pose.position.z -= std::min(0.002, 1e-4 * k);
                aim(world, i, pose);
            }
            auto& c = world.chunks.doubles[0];
            if (poison && k == 30) c.state.position[std::size_t(3 * 7 * c.width + 1)] = NAN;
            step(world, threads);
            resets += skin_status(world, world.skins.owner(1)).reset;
        }
        return world;
    };
    int resets = 0, none = 0;
    const World clean = run(false, none), poisoned = run(true, resets);
    const auto &a = clean.chunks.doubles[0], &b = poisoned.chunks.doubles[0];
    long different = 0;
    for (std::size_t i = 0; i < a.state.position.size(); ++i)
        if (int(i) % a.width != 1) different += a.state.position[i] != b.state.position[i];
    return {different == 0 && resets >= 1 && none == 0 && finite(poisoned),
            text("reset and reported %d time(s), %ld numbers of its neighbours differ", resets, different)};
}

}  // namespace palpate::stress
