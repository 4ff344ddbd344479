// What detail = "auto" saves and what it costs in error, scene by scene; and whether cost grows with what touches. Runs
// that are compared take steps by turns, so that ratios hold on a busy machine.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "bench/generated_scene.h"
#include "bench/pressed_finger.h"
#include "meshes/mesh_files.h"
#include "scenes/run/simulation.h"

namespace palpate {
namespace {

struct Trade {
    const char* scene;
    std::vector<std::string> both, full, automatic;
};
const std::vector<Trade> trades{
    {"press", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"roll", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"recorded_hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"pinch", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"hold_ball", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"hold_mug", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"two_hands", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"recorded_grasp", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"press", {"solver.preset=reference"}, {}, {"solver.detail=auto"}},
    {"roll", {"solver.preset=reference"}, {}, {"solver.detail=auto"}},
    {"hand", {"solver.preset=reference"}, {}, {"solver.detail=auto"}},
    {"pinch", {"solver.preset=reference"}, {}, {"solver.detail=auto"}},
    {"hold_ball", {"solver.preset=reference"}, {}, {"solver.detail=auto"}},
    {"hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto", "solver.detail_error=0"}},
    {"hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto", "solver.detail_error=0.001"}},
    {"hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto", "solver.detail_error=0.1"}},
    {"hand", {"solver.preset=balanced", "solver.precision=float"}, {}, {"solver.detail=auto"}},
    {"hand", {"solver.preset=balanced", "dt_ms=1"}, {}, {"solver.detail=auto"}},
    {"edge",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_error=0", "solver.detail_penetration_mm=0.1"}},
    {"edge",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_error=0", "solver.detail_penetration_mm=0.03"}},
    {"edge", {"solver.preset=balanced"}, {"solver.sample_refinement=3"}, {"solver.sample_refinement=1"}},
    {"hand",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_error=0", "solver.detail_penetration_mm=0.1"}},
    {"hand",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_error=0", "solver.detail_penetration_mm=0.03"}},
    {"hand", {"solver.preset=balanced"}, {"solver.sample_refinement=3"}, {"solver.sample_refinement=1"}},
};

Simulation simulation_of(const Trade& t, const std::vector<std::string>& own) {
    std::vector<std::string> overrides = t.both;
    overrides.insert(overrides.end(), own.begin(), own.end());
    return make_simulation(load_scene(PALPATE_SOURCE_DIR "/scenes/" + std::string(t.scene) + ".toml", overrides), 1);
}

/// Two runs of a scene, step by step: how far forces of the second are off those of the first.
struct Comparison {
    std::vector<double> of_full, of_automatic;
    double error = 0, force = 0, jump = 0, largest = 0;
    double full_MB = 0, automatic_MB = 0;
    DetailCount states;
};
Comparison compare(Simulation full, Simulation automatic) {
    Comparison c;
    c.full_MB = 1e-6 * double(skin_memory_bytes(full.world));
    c.automatic_MB = 1e-6 * double(skin_memory_bytes(automatic.world));
    std::vector<Vec3<double>> last_off(full.fingers.size(), {0, 0, 0});
    while (full.world.time < full.scene.duration - 1e-9) {
        advance(full), advance(automatic);
        c.of_full.push_back(full.world.profile.total());
        c.of_automatic.push_back(automatic.world.profile.total());
        count_detail(automatic.world, c.states);
        for (std::size_t i = 0; i < full.fingers.size(); ++i) {
            const ContactSurface &a = full.world.contact_surfaces[i], &b = automatic.world.contact_surfaces[i];
            for (std::size_t s = 0; s < a.force.size(); ++s) {
                c.error += norm(b.force[s] - a.force[s]);
                c.force += norm(a.force[s]);
            }
            const Vec3<double> off = b.total - a.total;
            c.jump = std::max(c.jump, norm(off - last_off[i]));
            c.largest = std::max(c.largest, norm(a.total));
            last_off[i] = off;
        }
    }
    return c;
}

void detail_trade(benchmark::State& state) {
    const Trade& t = trades[std::size_t(state.range(0))];
    Comparison c;
    for (auto _ : state) c = compare(simulation_of(t, t.full), simulation_of(t, t.automatic));
    state.counters["time_ratio"] = trimmed_mean_us(c.of_automatic) / trimmed_mean_us(c.of_full);
    state.counters["full_us"] = trimmed_mean_us(c.of_full);
    auto p99 = [](std::vector<double> seconds) {
        std::sort(seconds.begin(), seconds.end());
        return 1e6 * seconds[seconds.size() * 99 / 100];
    };
    state.counters["full_p99_us"] = p99(c.of_full);
    state.counters["p99_us"] = p99(c.of_automatic);
    state.counters["full_MB"] = c.full_MB;
    state.counters["MB"] = c.automatic_MB;
    state.counters["field_error"] = c.error / c.force;
    state.counters["largest_jump_N"] = c.jump;
    state.counters["largest_force_N"] = c.largest;
    state.counters["rigid"] = double(c.states.rigid) / double(c.states.all);
    state.counters["linear"] = double(c.states.linear) / double(c.states.all);
    state.counters["asleep"] = double(c.states.asleep) / double(c.states.all);
    state.counters["fine"] = 1 - double(c.states.coarse) / double(std::max<std::int64_t>(1, c.states.between));
    std::string label = t.scene;
    for (const auto* list : {&t.both, &t.automatic})
        for (const std::string& o : *list) label += " " + o;
    state.SetLabel(label);
}
BENCHMARK(detail_trade)->DenseRange(0, int(trades.size()) - 1)->Iterations(1)->Unit(benchmark::kMillisecond);

/// Does the stated error hold? Forty scenes that the estimate of the error was not made by, solved to convergence:
/// range(0): first scene; range(1): error allowed, in thousandths.
void detail_generated(benchmark::State& state) {
    const double allowed = 1e-3 * double(state.range(1));
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / "palpate-detail";
    std::filesystem::create_directories(folder);
    std::vector<double> errors, jumps, shares, of_full, of_automatic;
    for (auto _ : state) {
        for (int k = 0; k < 40; ++k) {
            const auto file = folder / "scene.toml";
            write_file(file, generated_scene(unsigned(state.range(0) + k)));
            const std::vector<std::string> converged{"solver.preset=accurate", "solver.newton_iterations=100"};
            std::vector<std::string> automatic = converged;
            automatic.emplace_back("solver.detail=auto");
            automatic.push_back("solver.detail_error=" + std::to_string(allowed));
            const Comparison c = compare(make_simulation(load_scene(file, converged), 1),
                                         make_simulation(load_scene(file, automatic), 1));
            if (!(c.largest > 0.02)) continue;  // it hardly touched
            errors.push_back(c.error / c.force);
            jumps.push_back(c.jump / c.largest);
            shares.push_back(double(c.states.linear) / double(c.states.all));
            of_full.insert(of_full.end(), c.of_full.begin(), c.of_full.end());
            of_automatic.insert(of_automatic.end(), c.of_automatic.begin(), c.of_automatic.end());
        }
    }
    auto write = [&](const std::string& name, std::vector<double> v) {
        std::sort(v.begin(), v.end());
        state.counters[name + "_median"] = v[v.size() / 2];
        state.counters[name + "_most"] = v.back();
        state.counters[name + "_above"] =
            double(std::count_if(v.begin(), v.end(), [&](double x) { return x > allowed; }));
    };
    write("error", errors), write("jump", jumps), write("linear", shares);
    state.counters["scenes"] = double(errors.size());
    state.counters["time_ratio"] = trimmed_mean_us(of_automatic) / trimmed_mean_us(of_full);
}
BENCHMARK(detail_generated)
    ->ArgsProduct({{0, 40}, {3, 10, 30, 100}})
    ->ArgNames({"first", "allowed"})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

/// Twenty fingers that press on a table, scattered over `fingers`; the others hang still in the air, or wave.
struct Crowd {
    Crowd(int fingers, bool waves, bool automatic);
    World world;
    Threads threads{1};
    int every = 1;
    bool waves = false;
    std::vector<double> seconds;
    void advance(int k) {
        for (std::size_t i = 0; i < world.skins.size(); ++i) {
            Pose<double> pose = world.skins[i].start;
            if (int(i) % every == 0)
                pose.position.z -= std::min(0.002, 1e-5 * k);
            else if (waves)
                pose.position.x += 0.01 * std::sin(0.01 * k + double(i));
            world.tracker_poses.find(world.couplings[i].tracker)->incoming = {pose, world.time, true};
        }
        step(world, threads);
        seconds.push_back(world.profile.total());
    }
};

Crowd::Crowd(int fingers, bool has_waves, bool automatic) {
    static const TetMesh mesh = index_finger_mesh();
    SceneSpec spec;
    spec.solver.newton_iterations = 1;
    spec.solver.dt = 0.001;
    spec.solver.detail_tolerance = automatic ? 2e-5 : 0;
    every = fingers / 20;
    waves = has_waves;
    for (int i = 0; i < fingers; ++i) {
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = mesh;
        f.single_precision = true;
        // Those that press are where they are among twenty: the same numbers, to the last bit.
        f.start.position = {0.05 * (i % every ? i : i / every), 0,
                            0.0002 + touching_height(mesh) + (i % every ? 0.5 : 0)};
        spec.fingers.push_back(std::move(f));
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity()});
    world = build_world(spec);
}

void detail_crowd(benchmark::State& state) {
    const bool waves = state.range(0) > 0, automatic = state.range(0) == 2;
    Crowd few(20, waves, automatic), many(2000, waves, automatic);
    double largest = 0;
    int k = 0;
    for (; k < 200; ++k) {
        few.advance(k), many.advance(k);
        if (k > 60) largest = std::max(largest, many.seconds.back());
    }
    few.seconds.clear(), many.seconds.clear();
    for (auto _ : state)
        for (int round = 0; round < (waves && !automatic ? 20 : 300); ++round, ++k) few.advance(k), many.advance(k);
    state.counters["ratio"] = trimmed_mean_us(many.seconds) / trimmed_mean_us(few.seconds);
    state.counters["of_20_us"] = trimmed_mean_us(few.seconds);
    state.counters["of_2000_us"] = trimmed_mean_us(many.seconds);
    const StepProfile& last = many.world.profile;
    state.counters["couple_us"] = 1e6 * last.couple;
    state.counters["detect_us"] = 1e6 * last.detect_contacts;
    state.counters["solve_us"] = 1e6 * last.solve_skin;
    state.counters["extract_us"] = 1e6 * last.extract_contact;
    state.counters["gathering_us"] = 1e6 * largest;
    double same = 0;
    for (std::size_t i = 0; i < 20; ++i)
        same += few.world.contact_surfaces[i].total.z == many.world.contact_surfaces[i * 100].total.z;
    state.counters["same_forces"] = same;
    state.SetLabel(!waves ? "1,980 still" : automatic ? "1,980 wave, auto" : "1,980 wave, full");
}
BENCHMARK(detail_crowd)->DenseRange(0, 2)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace palpate
