// Contact surface matching: one rendering step, 33 points, warm-started along a roll.

#include <benchmark/benchmark.h>

#include <cmath>

#include "devices/matching.h"

namespace palpate {
namespace {

void matching(benchmark::State& state) {
    const auto method = MatchingMethod(state.range(0));
    const DeviceModel model = find_kind("chinello-3rrs")->defaults();
    Coordinates previous = model.rest;
    std::vector<MatchingPoint> points(33);
    int k = 0;
    double evaluations = 0;
    for (auto _ : state) {
        const double roll = 0.4 * std::sin(0.02 * ++k);
        const Platform p = model.kind->platform(model, Eigen::Vector3d(0.05, roll, 0.0242));
        for (int i = 0; i < 33; ++i) {
            const double r = i < 14 ? 0.004 : 0.008, phi = 0.7 * i;
            points[i] = {
                p.centre + p.rotation * Eigen::Vector3d(r * std::cos(phi), r * std::sin(phi), i < 14 ? 0 : -0.001),
                i < 14};
        }
        const MatchingResult result = match(method, model, points, {}, previous);
        previous = result.w;
        evaluations += result.evaluations;
    }
    state.counters["evaluations"] = evaluations / double(state.iterations());
}
BENCHMARK(matching)->ArgName("method")->DenseRange(0, 2)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace palpate
