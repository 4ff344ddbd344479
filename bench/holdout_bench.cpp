// Do the presets' errors hold on scenes that were not used to state them? Twice forty generated scenes, a finger each
// of a random size and tissue, pressed on and moved over a random object, with every preset against the converged
// reference at half the time step: the README states what holds for 38 of the first forty, the second forty check it.
// Writes holdout.csv, a row per scene.

#include <benchmark/benchmark.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <sstream>

#include "meshes/mesh_files.h"
#include "scenes/sweep.h"

namespace palpate {
namespace {

/// The text of a scene; the same for the same number.
std::string generated_scene(unsigned number) {
    std::mt19937 random(1000 + number);
    auto between = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
    auto one_of = [&](std::initializer_list<const char*> words) { return *(words.begin() + random() % words.size()); };
    std::ostringstream out;
    out << "duration_s = 0.6\n[limits]\nlow = " << between(0.5, 0.75) << "\nhigh = " << between(1.25, 1.6)
        << "\n[[object]]\nname = \"thing\"\n";
    const std::string kind = one_of({"plane", "sphere", "box", "cylinder", "capsule"});
    out << "kind = \"" << kind << "\"\n";
    double top = 0;  // of the object below the finger [mm]
    if (kind == "sphere") {
        top = between(5, 40);
        out << "radius_mm = " << top << "\n";
    }
    if (kind == "box") {
        const double size = between(8, 40);
        top = 0.5 * size;
        out << "size_mm = [" << between(8, 60) << ", " << between(8, 60) << ", " << size << "]\n";
    }
    if (kind == "cylinder" || kind == "capsule") {
        top = between(4, 20);
        out << "radius_mm = " << top << "\nlength_mm = " << between(20, 60) << "\n";
    }
    out << "position_mm = [" << between(-3, 3) << ", " << between(-3, 3) << ", " << -top << "]\n";
    if (kind == "cylinder" || kind == "capsule") out << "rotation_deg = [90, 0, " << between(-90, 90) << "]\n";
    if (random() % 2) out << "friction = " << between(0.1, 1.0) << "\n";
    out << "[[finger]]\nname = \"finger\"\nshape = { finger = \""
        << one_of({"thumb", "index", "middle", "ring", "little"}) << "\" }\nelements = " << 250 + random() % 400
        << "\nmaterial = { young_kPa = " << between(10, 60) << ", poisson = " << between(0.2, 0.47)
        << " }\ndevice = { kind = \"chinello-3rrs\" }\n";
    // Down in 0.25 s, then aside.
    const double tilt = between(-20, 20), turn = between(-20, 20), depth = between(1.5, 3.5);
    auto keyframe = [&](double t, double x, double y, double z) {
        out << "    { t_s = " << t << ", position_mm = [" << x << ", " << y << ", " << z << "], rotation_deg = ["
            << turn << ", " << tilt << ", 0] },\n";
    };
    const double aside = between(0, 6), along = between(-3, 3);
    out << "track = [\n";
    keyframe(0, 0, 0, 9.5);
    keyframe(0.25, 0, 0, 8.5 - depth);
    keyframe(0.35, 0, 0, 8.5 - depth);
    keyframe(0.6, along, aside, 8.5 - depth);
    out << "]\n";
    return out.str();
}

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
