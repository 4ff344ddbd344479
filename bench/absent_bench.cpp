// What costs nothing when it is not needed: a finger (or ten) pressed on a table, with and without something that does
// not act. Both run by turns, so that ratios hold on a busy machine; forces must be the same bits.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>

#include "bench/pressed_finger.h"
#include "engine/build.h"
#include "engine/step.h"

namespace palpate {
namespace {

SceneSpec pressed(int fingers) {
    static const TetMesh mesh = index_finger_mesh();
    SceneSpec spec;
    spec.solver.newton_iterations = 2;
    spec.solver.dt = 0.001;
    for (int i = 0; i < fingers; ++i) {
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = mesh;
        f.start.position = {0.05 * i, 0, 0.0002 + touching_height(mesh) + (i > 0 ? 0.5 : 0)};  // the first one touches
        spec.fingers.push_back(std::move(f));
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity()});
    return spec;
}

struct Lane {
    World world;
    Threads threads{1};
    std::vector<double> seconds;
    explicit Lane(const SceneSpec& spec) : world(build_world(spec)) {}
    void advance(int k) {
        for (std::size_t i = 0; i < world.skins.size(); ++i) {
            Pose<double> pose = world.skins[i].start;
            if (i == 0) pose.position.z -= std::min(0.002, 1e-5 * k);
            world.tracker_poses.find(world.couplings[i].tracker)->incoming = {pose, world.time, true};
        }
        const auto start = std::chrono::steady_clock::now();
        step(world, threads);
        seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
};

void absent(benchmark::State& state) {
    SceneSpec without = pressed(1), with = without;
    const char* what = "";
    switch (state.range(0)) {
        case 0:
            what = "nothing (the noise)";
            break;
        case 1: {
            what = "an object with friction, far away";
            ObjectSpec far{"far", {ShapeKind::sphere, {0.01, 0, 0}}, {{1, 0, 1}, {1, 0, 0, 0}}, 0.5};
            with.objects.push_back(far);
            break;
        }
        case 2:
            what = "strain limits that nothing reaches";
            with.fingers[0].has_limits = true;
            with.fingers[0].limit_low = 0.05;
            with.fingers[0].limit_high = 20;
            break;
        case 3: {
            what = "a hundred fixed objects, far away";
            for (int i = 0; i < 100; ++i)
                with.objects.push_back({"far" + std::to_string(i),
                                        {ShapeKind::sphere, {0.01, 0, 0}},
                                        {{1 + 0.1 * i, 0, 1}, {1, 0, 0, 0}}});
            break;
        }
        case 4: {
            what = "a body asleep, far away";
            ObjectSpec far{"far", {ShapeKind::box, {0.01, 0.01, 0.01}}, {{1, 0, 0.01}, {1, 0, 0, 0}}, 0.5};
            far.body = solid_body(far.shape, 0.05);
            with.objects.push_back(far);
            break;
        }
        case 5:
            what = "nine more fingers, asleep";
            with = pressed(10);
            break;
        default: {
            what = "a thimble on a finger that touches (one match in 20 steps)";
            ThimbleSpec t;
            t.model = find_kind("chinello-3rrs")->defaults();
            with.thimbles.push_back(t);
        }
    }
    Lane a(without), b(with);
    const std::size_t bytes_a = skin_memory_bytes(a.world), bytes_b = skin_memory_bytes(b.world);
    // Until all that will sleep does.
    for (int k = 0; k < 300; ++k) a.advance(k), b.advance(k);
    a.seconds.clear(), b.seconds.clear();
    int k = 300;
    for (auto _ : state) {
        for (int round = 0; round < 20; ++round, ++k) {
            // Slowly on, so that there is work to do.
            for (Lane* lane : k % 2 ? std::array<Lane*, 2>{&a, &b} : std::array<Lane*, 2>{&b, &a}) lane->advance(k);
        }
        state.SetIterationTime(1e-6);
    }
    const auto force = [](const Lane& l) { return l.world.contact_surfaces[0].total; };
    const bool same = force(a).z == force(b).z && force(a).x == force(b).x;
    state.counters["ratio"] = trimmed_mean_us(b.seconds) / trimmed_mean_us(a.seconds);
    state.counters["without_us"] = trimmed_mean_us(a.seconds);
    state.counters["bytes_more"] = double(bytes_b) - double(bytes_a);
    state.SetLabel(std::string(what) + (same ? ", same bits" : ", other bits"));
}
BENCHMARK(absent)->DenseRange(0, 6)->Iterations(100)->UseManualTime();

}  // namespace
}  // namespace palpate
