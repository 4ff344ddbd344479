// Do the presets' errors hold on scenes that were not used to state them? Twice forty generated scenes, a finger each
// of a random size and tissue, pressed on and moved over a random object, with every preset against the converged
// reference at half the time step: bench/README.md states what holds for 38 of the first forty, the second forty check
// it. Writes holdout.csv, a row per scene.

#include <benchmark/benchmark.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "bench/generated_scene.h"
#include "meshes/mesh_files.h"
#include "scenes/studies/sweep.h"

namespace palpate {
namespace {

struct Row {
    double touched = 0;             ///< mean force of the reference [N]
    std::array<double, 3> field{};  ///< per preset
};

void holdout(benchmark::State& state) {
    const char* const presets[] = {"fast", "balanced", "accurate"};
    const double dt_ms = double(state.range(0));
    const auto first = unsigned(state.range(1));
    constexpr unsigned scenes = 40;
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / "palpate-holdout";
    std::filesystem::create_directories(folder);
    std::array<Row, scenes> rows;
    const std::atomic<bool> stop{false};
    for (auto _ : state) {
        oneapi::tbb::parallel_for(0u, scenes, [&](unsigned k) {
            const auto file = folder / ("scene" + std::to_string(first + k) + ".toml");
            write_file(file, generated_scene(first + k));
            SweepTrace reference, trace;
            run_point(file, {"solver.preset=reference", "dt_ms=" + std::to_string(0.5 * dt_ms)}, 0.02, 1, stop,
                      reference);
            double samples = 0;
            for (const auto& fingers : reference.samples)
                for (const auto& f : fingers)
                    if (norm(f.net) > 0) rows[k].touched += norm(f.net), ++samples;
            rows[k].touched /= std::max(1.0, samples);
            for (std::size_t p = 0; p < 3; ++p) {
                run_point(file, {std::string("solver.preset=") + presets[p], "dt_ms=" + std::to_string(dt_ms)}, 0.02, 1,
                          stop, trace);
                rows[k].field[p] = errors_of(trace, reference).field;
            }
        });
        state.SetIterationTime(1);
    }
    Series table{{"scene", "mean_force_N", "fast_percent", "balanced_percent", "accurate_percent"}, {}};
    int compared = 0;
    std::array<std::vector<double>, 3> errors;
    for (unsigned k = 0; k < scenes; ++k) {
        if (!(rows[k].touched > 0.02)) continue;  // it hardly touched
        ++compared;
        table.values.insert(table.values.end(), {double(first + k), rows[k].touched});
        for (std::size_t p = 0; p < 3; ++p) {
            table.values.push_back(100 * rows[k].field[p]);
            errors[p].push_back(100 * rows[k].field[p]);
        }
    }
    write_csv("holdout.csv", table);
    for (std::size_t p = 0; p < 3; ++p) {
        std::vector<double>& e = errors[p];
        std::sort(e.begin(), e.end());
        std::printf(
            "%2.0f ms %-9s field error on %d generated scenes from %u: median %.2f %%, 95 %% of them below %.2f %%, "
            "largest %.2f %%\n",
            dt_ms, presets[p], compared, first, e[e.size() / 2], e[std::size_t(std::ceil(0.95 * double(e.size()))) - 1],
            e.back());
    }
}
BENCHMARK(holdout)->ArgsProduct({{1, 5, 20}, {0, 40}})->ArgNames({"dt_ms", "first"})->Iterations(1)->UseManualTime();

}  // namespace
}  // namespace palpate
