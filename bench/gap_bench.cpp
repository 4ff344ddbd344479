// How far from the global optimum do the fast matchers stop? Contacts drawn from the scenes: fingers placed a little
// otherwise in every run; each contact matched as a rendering step does, from the last step's answer, against the best
// of 65 starts. Writes gap.svg, the distribution of the gap, and gap.csv, its worst cases.

#include <benchmark/benchmark.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <random>

#include "scenes/recording/svg.h"
#include "scenes/run/series.h"
#include "scenes/run/simulation.h"

namespace palpate {
namespace {

/// One rendering step's contact, finger frame; `first` of its finger and run.
struct Contact {
    std::vector<MatchingPoint> points;
    double lowest = 0;  ///< of the undeformed pad [m]
    bool first = false;
    int scene = 0;
};
const std::vector<std::string> scene_names{"press", "edge",      "corner", "cylinder", "ridge",
                                           "hole",  "soft_ball", "ball",   "roll",     "hand"};

std::vector<Contact> draw_contacts(std::size_t count) {
    std::mt19937 random(17);
    std::uniform_real_distribution<double> u(-1, 1);
    std::vector<Contact> contacts;
    for (int round = 0; contacts.size() < count; ++round)
        for (int n = 0; n < int(scene_names.size()) && contacts.size() < count; ++n) {
            Scene scene = load_scene(PALPATE_SOURCE_DIR "/scenes/" + scene_names[std::size_t(n)] + ".toml",
                                     {"solver.preset=balanced"});
            for (FingerMotion& motion : scene.finger_motions) {
                const Vec3<double> shift{0.004 * u(random), 0.004 * u(random), 0.0005 * u(random)};
                const Quaternion<double> turn =
                    rotation_step(Vec3<double>{0.15 * u(random), 0.15 * u(random), 0.5 * u(random)});
                for (Keyframe& k : motion.keyframes)
                    k.pose = {k.pose.position + shift, normalised(turn * k.pose.rotation)};
            }
            Simulation s = make_simulation(std::move(scene), 2);
            std::vector<char> fresh(s.world.matchings.size(), 1);
            while (s.world.time < s.scene.duration && contacts.size() < count) {
                advance(s);
                for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
                    const Matching& m = s.world.matchings[t];
                    const ContactSurface& surface = *s.world.contact_surfaces.find(m.finger);
                    if (!m.fresh || surface.touching == 0) continue;
                    Contact c;
                    for (std::size_t i = 0; i < surface.position.size(); ++i) {
                        const Vec3<double>& p = surface.position[i];
                        c.points.push_back({{p.x, p.y, p.z}, surface.touches[i] != 0});
                    }
                    for (const Point& p : s.world.skins.find(m.finger)->mesh.nodes) c.lowest = std::min(c.lowest, p[2]);
                    c.first = fresh[t], fresh[t] = 0;
                    c.scene = n;
                    contacts.push_back(std::move(c));
                }
            }
        }
    return contacts;
}

struct Gap {
    double relative, value_mm2, best_mm2, us;
    int contact;
};

/// Gaps of one kind and solver over all contacts.
std::vector<Gap> gaps_of(const std::vector<Contact>& contacts, const std::string& kind, MatchingSolver solver,
                         std::vector<double>& best) {
    std::vector<Gap> gaps;
    MatchingSettings settings, global;
    settings.solver = solver;
    global.solver = MatchingSolver::multistart;
    global.evaluations = 300;
    global.tolerance = 1e-6;
    const bool find_best = best.empty();
    Coordinates last;
    for (std::size_t i = 0; i < contacts.size(); ++i) {
        const Contact& c = contacts[i];
        DeviceModel model = find_kind(kind)->defaults();
        model.mount.translation().z() = c.lowest + model.kind->seat_height;
        std::vector<MatchingPoint> points = c.points;
        for (MatchingPoint& p : points) p.position = model.mount.inverse() * p.position;
        if (c.first) last = model.rest;
        // All judged by the objective of this rendering step, with its small smoothing about the last answer.
        const Coordinates before = last;
        const auto start = std::chrono::steady_clock::now();
        const MatchingResult r = match_constrained(model, points, settings, before);
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        last = r.w;
        const double value = r.residual;
        if (find_best) best.push_back(match_constrained(model, points, global, before).residual);
        best[i] = std::min(best[i], value);
        gaps.push_back({(value - best[i]) / (best[i] + 1e-3), value, best[i], 1e6 * seconds, int(i)});
    }
    return gaps;
}

void matching_gap(benchmark::State& state) {
    const auto contacts = draw_contacts(std::size_t(state.range(0)));
    const std::string title = ": gap to the best of 65 starts, " + std::to_string(contacts.size()) + " contacts";
    std::array<Plot, 2> plots;
    for (std::size_t solver : {0u, 1u})
        plots[solver] = {(solver == 0 ? "SLSQP" : "Least squares") + title,
                         "share of the contacts with a larger gap [%]",
                         "gap of the objective [%]",
                         {},
                         {},
                         true,
                         true};
    Series worst{{"kind", "solver", "scene", "contact", "gap_percent", "value_mm2", "best_mm2"}, {}};
    const auto kinds = kind_names();
    // [kind][SLSQP, least squares], worst first.
    std::vector<std::array<std::vector<Gap>, 2>> all(kinds.size());
    for (auto _ : state) {
        oneapi::tbb::parallel_for(std::size_t(0), kinds.size(), [&](std::size_t kind) {
            std::vector<double> best;
            // Least squares first: what it finds counts as a start of the best, too.
            for (const std::size_t solver : {1u, 0u}) {
                all[kind][solver] = gaps_of(contacts, kinds[kind], MatchingSolver(solver), best);
                std::sort(all[kind][solver].begin(), all[kind][solver].end(),
                          [](auto& a, auto& b) { return a.relative > b.relative; });
            }
        });
        state.SetIterationTime(1);
    }
    for (std::size_t kind = 0; kind < kinds.size(); ++kind)
        for (const std::size_t solver : {0u, 1u}) {
            const std::vector<Gap>& gaps = all[kind][solver];
            const auto n = gaps.size();
            std::vector<double> us;
            for (const Gap& g : gaps) us.push_back(g.us);
            std::sort(us.begin(), us.end());
            const char* name = solver == 0 ? "SLSQP" : "least squares";
            std::printf(
                "%-14s %-14s gap: median %.2g %%, p95 %.2g %%, p99 %.2g %%, largest %.3g %%; above 1 %%: %zu; "
                "time: median %.3g us, p99 %.3g us\n",
                kinds[kind].c_str(), name, 100 * gaps[n / 2].relative, 100 * gaps[n / 20].relative,
                100 * gaps[n / 100].relative, 100 * gaps[0].relative,
                std::size_t(std::count_if(gaps.begin(), gaps.end(), [](auto& g) { return g.relative > 0.01; })),
                us[n / 2], us[n * 99 / 100]);
            Curve curve{kinds[kind], {}, {}};
            for (std::size_t k = 0; k < n; k += 1 + k / 50)
                if (gaps[k].relative > 1e-6)
                    curve.x.push_back(100 * double(k + 1) / double(n)), curve.y.push_back(100 * gaps[k].relative);
            if (curve.x.size() > 1) plots[solver].curves.push_back(std::move(curve));
            for (std::size_t k = 0; k < std::min<std::size_t>(20, n); ++k)
                for (double v : {double(kind), double(solver), double(contacts[std::size_t(gaps[k].contact)].scene),
                                 double(gaps[k].contact), 100 * gaps[k].relative, gaps[k].value_mm2, gaps[k].best_mm2})
                    worst.values.push_back(v);
        }
    write_svg("gap.svg", {plots[0], plots[1]});
    write_csv("gap.csv", worst);
}
BENCHMARK(matching_gap)->Arg(10000)->Iterations(1)->UseManualTime();

}  // namespace
}  // namespace palpate
