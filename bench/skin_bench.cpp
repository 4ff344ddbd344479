// The skin solve alone: one chunk of the default finger pressed 2.5 mm on a plane, by lane type.

#include <benchmark/benchmark.h>

#include "engine/skin/solve_skin.h"
#include "scenes/finger_mesh.h"

namespace palpate {
namespace {

const TetMesh& default_mesh() {
    static const TetMesh mesh = [] {
        FingerTemplates templates;
        std::string note;
        FingerMeshRequest request;
        request.shape = finger_shape("index");
        return make_finger_mesh(request, templates, note);
    }();
    return mesh;
}

template <class T>
void aim(SkinChunk<T>& c, double z) {
    const double v[9] = {2000, 2, 0, 0, z, 1, 0, 0, 0};
    for (int s = 0; s < bone_spring_count; ++s)
        for (int i = 0; i < 9; ++i)
            for (int l = 0; l < c.width; ++l)
                c.scratch.bone_springs[(9 * s + i) * c.width + l] = T(s > 0 && i < 2 ? 0 : v[i]);
}

/// Steps of 1 ms while the finger goes 2.5 mm down in 0.25 s.
template <class T>
void press(benchmark::State& state) {
    const int width = int(state.range(0)), iterations = int(state.range(1));
    const auto topology = std::make_shared<SkinTopology>(build_topology(default_mesh()));
    SkinParameters p;
    p.mesh = &default_mesh();
    p.young_modulus = {30e3};
    p.has_limits = true;
    p.limit_low = {0.6};
    p.limit_high = {1.4};
    SolverSettings settings;
    settings.dt = 1e-3;
    settings.newton_iterations = iterations;
    settings.tolerance = 1e-4;
    settings.multiplier_tolerance = 1e-3;
    const double start = 0.0084;
    SkinChunk<T> chunk;
    int k = 250;
    for (auto _ : state) {
        state.PauseTiming();
        if (k == 250) {
            chunk = {};
            allocate_chunk(chunk, topology, width, true, false, 1);
            for (int l = 0; l < width; ++l) set_lane(chunk, l, l, p, {{0, 0, start}, Quaternion<double>::identity()});
            chunk.slots[0] = {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0};
            k = 0;
        }
        aim(chunk, start - 2.5e-3 * ++k / 250);
        state.ResumeTiming();
        solve_skin(chunk, settings);
    }
    state.counters["s_per_finger"] = benchmark::Counter(double(state.iterations()) * width,
                                                        benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
    state.counters["elements"] = double(topology->elements.size());
    state.counters["bytes_per_finger"] = double(memory_bytes(chunk)) / width;
}

BENCHMARK_TEMPLATE(press, double)
    ->ArgNames({"lanes", "iterations"})
    ->ArgsProduct({{1, 2, 4}, {1, 2, 4}})
    ->Iterations(500)
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(press, float)
    ->ArgNames({"lanes", "iterations"})
    ->ArgsProduct({{1, 4, 8}, {1, 2, 4}})
    ->Iterations(500)
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
