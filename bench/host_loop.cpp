// What a host pays for driving five fingers through C: palpate-host-loop [STEPS]
//
// Two equal worlds, one stepped by the engine's own calls, one through libpalpate.so: every tracked pose set, one step,
// net force and samples' forces read by views, and every finger's state. They take turns, step by step, so that what
// else the machine does meets both; times are the thread's own, in which the scheduler's share is not.

#include <palpate/palpate.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "bench/quantile.h"
#include "scenes/run/simulation.h"
#include "scenes/run/state.h"

namespace {

double seconds(clockid_t clock) {
    timespec t{};
    clock_gettime(clock, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

struct Times {
    std::vector<double> us;  ///< [step] shortest so far
    template <class Work>
    void take(long step, Work work) {
        const double begin = seconds(CLOCK_THREAD_CPUTIME_ID);
        work();
        if (step >= 0)
            us[std::size_t(step)] = std::min(us[std::size_t(step)], 1e6 * (seconds(CLOCK_THREAD_CPUTIME_ID) - begin));
    }
};

}  // namespace

int main(int argc, char** argv) {
    const long steps = argc > 1 ? std::atol(argv[1]) : 300, repeats = argc > 2 ? std::atol(argv[2]) : 10;
    constexpr int before = 300, warm = 3;  // until all press; steps after going back that find no cache
    const std::vector<std::string> settings{"dt_ms=1", "solver.preset=balanced", "duration_s=1000"};
    std::vector<const char*> texts;
    for (const std::string& s : settings) texts.push_back(s.c_str());
    PalpateWorldDef def;
    palpate_default_world_def(&def, sizeof def);
    def.settings = texts.data(), def.setting_count = int32_t(texts.size());
    const std::string scene = std::string(PALPATE_SOURCE_DIR) + "/scenes/hand.toml";
    PalpateWorld world = 0;
    if (palpate_load(scene.c_str(), &def, &world) != PALPATE_OK) return std::puts(palpate_last_error()), 1;
    palpate::Simulation own = palpate::make_simulation(palpate::load_scene(scene, settings), 1, false);
    palpate::StepInputs inputs;
    const int fingers = int(own.fingers.size());
    std::vector<PalpateView> views(std::size_t(fingers) + 1);
    for (int i = 0; i <= fingers; ++i) {
        views[std::size_t(i)].size = sizeof(PalpateView);
        palpate_view(world, i < fingers ? PALPATE_FORCES : PALPATE_NET_FORCES, i < fingers ? i : -1,
                     &views[std::size_t(i)]);
    }
    Times engine{std::vector<double>(std::size_t(steps), 1e9)}, host = engine;
    double sum = 0;
    bool same = true;
    for (int k = 0; k < before; ++k) palpate::advance(own);
    palpate_step(world, before);
    std::vector<std::uint8_t> start;
    palpate::append_state(start, own);
    std::int64_t size = 0;
    palpate_save(world, nullptr, 0, &size);
    std::vector<char> host_start(static_cast<std::size_t>(size));
    palpate_save(world, host_start.data(), size, &size);
    std::string why;
    for (long at = 0; at < (steps + warm) * repeats; ++at) {
        const long k = at % (steps + warm) - warm;
        if (k == -warm) {
            palpate::restore_state(own, start.data(), start.size(), why);
            palpate_restore(world, host_start.data(), size);
        }
        palpate::next_inputs(own, inputs);
        std::vector<std::array<double, 7>> poses;
        for (const auto& f : inputs.fingers) {
            const auto& p = f.pose;
            poses.push_back(
                {p.position.x, p.position.y, p.position.z, p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z});
        }
        const auto step_engine = [&] { engine.take(k, [&] { palpate::advance(own, inputs); }); };
        const auto step_host = [&] {
            host.take(k, [&] {
                for (int i = 0; i < fingers; ++i) palpate_set_finger_pose(world, i, poses[std::size_t(i)].data());
                palpate_step(world, 1);
                for (const PalpateView& v : views) sum += static_cast<const double*>(v.data)[2];
                for (int i = 0; i < fingers; ++i) {
                    PalpateFingerState state;
                    state.size = sizeof state;
                    palpate_get_finger(world, i, &state);
                    sum += state.force[2];
                }
            });
        };
        // Whoever goes second finds other things in the cache.
        if (at / (steps + warm) % 2)
            step_engine(), step_host();
        else
            step_host(), step_engine();
        const auto* net = static_cast<const double*>(views.back().data);
        for (int i = 0; i < fingers; ++i) same &= own.world.contact_surfaces[std::size_t(i)].total.z == net[3 * i + 2];
    }
    std::printf("five fingers, %ld steps, the shortest of %ld each, us\n", steps, repeats);
    std::printf("          engine      host      more\n");
    std::vector<double> more;
    for (std::size_t k = 0; k < engine.us.size(); ++k) more.push_back(host.us[k] - engine.us[k]);
    for (const auto& [name, q] : {std::pair{"median", 0.5}, {"p90", 0.9}, {"p99", 0.99}}) {
        const double a = palpate::quantile(engine.us, q), b = palpate::quantile(host.us, q);
        std::printf("%-6s %9.1f %9.1f %9.1f\n", name, a, b, b - a);
    }
    std::printf("of one and the same step: median %.1f more\n", palpate::quantile(more, 0.5));
    std::printf("the same forces: %s%s\n", same ? "yes" : "no", sum == 1234.5 ? " " : "");
    palpate_destroy(world);
    return same ? 0 : 1;
}
