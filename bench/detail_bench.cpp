// What detail = "auto" saves and what it costs in error, scene by scene; and whether cost grows with what touches. Runs
// that are compared take steps by turns, so that ratios hold on a busy machine.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "bench/pressed_finger.h"
#include "scenes/simulation.h"

namespace palpate {
namespace {

struct Trade {
    const char* scene;
    std::vector<std::string> both, full, automatic;
};
const std::vector<Trade> trades{
    {"hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"recorded_hand", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"recorded_grasp", {"solver.preset=balanced"}, {}, {"solver.detail=auto"}},
    {"edge",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_penetration_mm=0.1"}},
    {"edge",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_penetration_mm=0.03"}},
    {"edge", {"solver.preset=balanced"}, {"solver.sample_refinement=3"}, {"solver.sample_refinement=1"}},
    {"hand",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_penetration_mm=0.1"}},
    {"hand",
     {"solver.preset=balanced", "solver.sample_refinement=3"},
     {},
     {"solver.detail=auto", "solver.detail_penetration_mm=0.03"}},
    {"hand", {"solver.preset=balanced"}, {"solver.sample_refinement=3"}, {"solver.sample_refinement=1"}},
};

Simulation simulation_of(const Trade& t, const std::vector<std::string>& own) {
    std::vector<std::string> overrides = t.both;
    overrides.insert(overrides.end(), own.begin(), own.end());
    return make_simulation(load_scene(PALPATE_SOURCE_DIR "/scenes/" + std::string(t.scene) + ".toml", overrides), 1);
}

void detail_trade(benchmark::State& state) {
    const Trade& t = trades[std::size_t(state.range(0))];
    Simulation full = simulation_of(t, t.full), automatic = simulation_of(t, t.automatic);
    std::vector<double> of_full, of_automatic;
    std::vector<Vec3<double>> last_off(full.fingers.size(), {0, 0, 0});
    double error = 0, force = 0, jump = 0, largest = 0;
    DetailCount states;
    for (auto _ : state) {
        while (full.world.time < full.scene.duration - 1e-9) {
            advance(full), advance(automatic);
            of_full.push_back(full.world.profile.total());
            of_automatic.push_back(automatic.world.profile.total());
            count_detail(automatic.world, states);
            for (std::size_t i = 0; i < full.fingers.size(); ++i) {
                const ContactSurface &a = full.world.contact_surfaces[i], &b = automatic.world.contact_surfaces[i];
                for (std::size_t s = 0; s < a.force.size(); ++s) {
                    error += norm(b.force[s] - a.force[s]);
                    force += norm(a.force[s]);
                }
                const Vec3<double> off = b.total - a.total;
                jump = std::max(jump, norm(off - last_off[i]));
                largest = std::max(largest, norm(a.total));
                last_off[i] = off;
            }
        }
    }
    state.counters["time_ratio"] = trimmed_mean_us(of_automatic) / trimmed_mean_us(of_full);
    state.counters["full_us"] = trimmed_mean_us(of_full);
    state.counters["field_error"] = error / force;
    state.counters["largest_jump_N"] = jump;
    state.counters["largest_force_N"] = largest;
    state.counters["rigid"] = double(states.rigid) / double(states.all);
    state.counters["asleep"] = double(states.asleep) / double(states.all);
    state.counters["fine"] = 1 - double(states.coarse) / double(std::max<std::int64_t>(1, states.between));
    std::string label = t.scene;
    for (const auto* list : {&t.both, &t.automatic})
        for (const std::string& o : *list) label += " " + o;
    state.SetLabel(label);
}
BENCHMARK(detail_trade)->DenseRange(0, int(trades.size()) - 1)->Iterations(1)->Unit(benchmark::kMillisecond);

/// Twenty fingers that press on a table, scattered over `fingers`; the others hang still in the air, or wave.
struct Crowd {
    World world;
    oneapi::tbb::task_arena arena{1};
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
        step(world, arena);
        seconds.push_back(world.profile.total());
    }
};

Crowd crowd_of(int fingers, bool waves, bool automatic) {
    static const TetMesh mesh = index_finger_mesh();
    SceneSpec spec;
    spec.solver.newton_iterations = 1;
    spec.solver.dt = 0.001;
    spec.solver.detail_tolerance = automatic ? 2e-5 : 0;
    Crowd c;
    c.every = fingers / 20;
    c.waves = waves;
    for (int i = 0; i < fingers; ++i) {
        FingerSpec f;
        f.name = "finger" + std::to_string(i);
        f.mesh = mesh;
        f.single_precision = true;
        // Those that press are where they are among twenty: the same numbers, to the last bit.
        f.start.position = {0.05 * (i % c.every ? i : i / c.every), 0,
                            0.0002 + touching_height(mesh) + (i % c.every ? 0.5 : 0)};
        spec.fingers.push_back(std::move(f));
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity()});
    c.world = build_world(spec);
    return c;
}

void detail_crowd(benchmark::State& state) {
    const bool waves = state.range(0) > 0, automatic = state.range(0) == 2;
    Crowd few = crowd_of(20, waves, automatic), many = crowd_of(2000, waves, automatic);
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
