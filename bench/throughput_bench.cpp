// How many fingers a machine steps: 1 to 10,000 pressed on a plane, the whole step. Writes throughput.svg.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <map>

#include "bench/batched_baseline.h"
#include "bench/pressed_finger.h"
#include "engine/build.h"
#include "engine/step.h"
#include "scenes/load/finger_mesh.h"
#include "scenes/recording/svg.h"

namespace palpate {
namespace {

struct Measured {
    double steps_per_s_and_core = 0, kB_per_finger = 0;
};
struct Case {
    int stiffness_steps, threads;
    auto operator<=>(const Case&) const = default;
};
std::map<Case, std::map<int, Measured>> measured;  ///< [..][fingers]

void draw() {
    Plot rate{"Pressed fingers, limits and friction, 1 ms steps, one iteration, float",
              "fingers",
              "finger-steps per second and core",
              {},
              {}};
    Plot memory{"Memory of the skins", "fingers", "kB per finger", {}, {}};
    rate.log_x = memory.log_x = true;
    for (const auto& [of, by_fingers] : measured) {
        const std::string matrices = of.stiffness_steps > 1 ? ", matrices kept" : "";
        Curve r{std::to_string(of.threads) + (of.threads == 1 ? " thread" : " threads") + matrices, {}, {}}, m = r;
        m.name = of.stiffness_steps > 1 ? "matrices kept" : "none kept";
        for (const auto& [fingers, v] : by_fingers) {
            r.x.push_back(fingers), r.y.push_back(v.steps_per_s_and_core);
            m.x.push_back(fingers), m.y.push_back(v.kB_per_finger);
        }
        rate.curves.push_back(r);
        if (of.threads == 1) memory.curves.push_back(m);
    }
    write_svg("throughput.svg", {rate, memory});
}

World pressed_world(int fingers, int stiffness_steps) {
    FingerTemplates templates;
    std::string note;
    FingerMeshRequest request;
    request.shape = finger_shape("index");
    SceneSpec spec;
    spec.solver.dt = 1e-3;
    spec.solver.newton_iterations = 1;
    spec.solver.stiffness_steps = stiffness_steps;
    spec.solver.tolerance = 1e-4;
    spec.solver.multiplier_tolerance = 1e-3;
    FingerSpec f;
    f.name = "finger";
    f.mesh = make_finger_mesh(request, templates, note);
    f.has_limits = f.single_precision = true;
    f.start.position.z = 0;
    for (int node : f.mesh.pad_nodes)
        f.start.position.z = std::max(f.start.position.z, -f.mesh.nodes[std::size_t(node)][2]);
    spec.fingers.assign(std::size_t(fingers), f);
    spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
    return build_world(spec);
}

void throughput(benchmark::State& state) {
    const int fingers = int(state.range(0)), stiffness_steps = int(state.range(1)), count = int(state.range(2));
    World world = pressed_world(fingers, stiffness_steps);
    const double rest = world.skins[0].start.position.z;
    Threads threads(count);
    // Warm up while the fingers come down by 1.5 mm, then measure while they go on at 1.25 mm/s, each at its own pace:
    // as many steps whatever their number, so that all do the same; the middle one of several presses.
    const int warm = 30, counted = 40, presses = std::clamp(1000 / fingers, 1, 15);
    std::vector<double> totals;
    for (auto _ : state) {
        for (int press = 0; press < presses; ++press) {
            World world = pressed_world(fingers, stiffness_steps);
            double total = 0;
            for (int k = 1; k <= warm + counted; ++k) {
                const double depth = k <= warm ? 1.5e-3 * k / warm : 1.5e-3 + 1.25e-6 * (k - warm);
                for (int i = 0; i < fingers; ++i)
                    world.tracker_poses[std::size_t(i)].incoming = {
                        {{0, 0, rest - depth * (1 - 0.02 * (i % 8))}, Quaternion<double>::identity()}, k * 1e-3, true};
                step(world, threads);
                if (k > warm) total += world.profile.total();
            }
            totals.push_back(total);
        }
        std::nth_element(totals.begin(), totals.begin() + std::ptrdiff_t(totals.size() / 2), totals.end());
        state.SetIterationTime(totals[totals.size() / 2] / counted);
    }
    const double total = totals[totals.size() / 2];
    auto& by_fingers = measured[{stiffness_steps, count}];
    Measured& m = by_fingers[fingers];
    m = {fingers * counted / total / count, 1e-3 * double(skin_memory_bytes(world)) / fingers};
    state.counters["finger_steps_per_s_and_core"] = m.steps_per_s_and_core;
    state.counters["kB_per_finger"] = m.kB_per_finger;
    // Beside what the arithmetic alone costs, and beside thirty fingers, which fit the cache.
    state.counters["B0s_per_finger"] =
        1e6 / (m.steps_per_s_and_core * time_batched_baseline(index_finger_mesh()).us_per_finger);
    if (const auto thirty = by_fingers.find(30); thirty != by_fingers.end())
        state.counters["times_30"] = thirty->second.steps_per_s_and_core / m.steps_per_s_and_core;
    draw();
}
BENCHMARK(throughput)
    ->ArgsProduct({{1, 3, 10, 30, 100, 300, 1000, 3000, 10000}, {1, 16}, {1, 2}})
    ->ArgNames({"fingers", "stiffness_steps", "threads"})
    ->Iterations(1)
    ->UseManualTime()
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
