// Contact surface matching: one rendering step, 33 points, warm-started along a roll.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "devices/matching/matching.h"

namespace palpate {
namespace {

void matching(benchmark::State& state) {
    const auto method = state.range(0) < 3 ? MatchingMethod(state.range(0)) : MatchingMethod::constrained;
    MatchingSettings settings;
    settings.solver = state.range(0) < 3 ? MatchingSolver::slsqp : MatchingSolver::least_squares;
    const DeviceModel model = find_kind(kind_names()[std::size_t(state.range(1))])->defaults();
    const DeviceModel shown = find_kind("chinello-3rrs")->defaults();
    std::vector<double> times;
    Coordinates previous = model.rest;
    std::vector<MatchingPoint> points(33);
    int k = 0;
    double evaluations = 0;
    for (auto _ : state) {
        const double roll = 0.4 * std::sin(0.02 * ++k);
        const Platform p = shown.kind->platform(shown, Eigen::Vector3d(0.05, roll, 0.0242));
        for (int i = 0; i < 33; ++i) {
            const double r = i < 14 ? 0.004 : 0.008, phi = 0.7 * i;
            points[i] = {
                p.centre + p.rotation * Eigen::Vector3d(r * std::cos(phi), r * std::sin(phi), i < 14 ? 0 : -0.001),
                i < 14};
        }
        const auto start = std::chrono::steady_clock::now();
        const MatchingResult result = match(method, model, points, settings, previous);
        times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        state.SetIterationTime(times.back());
        previous = result.w;
        evaluations += result.evaluations;
    }
    std::sort(times.begin(), times.end());
    state.counters["median_us"] = 1e6 * times[times.size() / 2];
    state.counters["p99_us"] = 1e6 * times[times.size() * 99 / 100];
    state.SetLabel(model.kind->name + (state.range(0) == 3 ? ", least squares" : ""));
    state.counters["evaluations"] = evaluations / double(state.iterations());
}
void arguments(benchmark::internal::Benchmark* b) {
    for (int method = 0; method < 4; ++method)
        for (std::size_t kind = 0; kind < kind_names().size(); ++kind)
            if (method == 0 || method == 3 || kind == 0) b->Args({method, std::int64_t(kind)});
}
BENCHMARK(matching)->ArgNames({"method", "kind"})->Apply(arguments)->UseManualTime()->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
