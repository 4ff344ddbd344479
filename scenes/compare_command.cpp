#include <unistd.h>

#include <cmath>
#include <cstdio>

#include "meshes/input_error.h"
#include "scenes/commands.h"
#include "scenes/compare.h"
#include "scenes/recording/svg.h"

namespace palpate {

namespace {

const char* const method_names[3] = {"constrained", "unconstrained", "plane"};
const char* const method_titles[3] = {"constrained optimisation", "unconstrained + projection",
                                      "plane fit + projection"};

Series to_series(const std::vector<ComparedStep>& steps) {
    Series s{{"time_s", "roll_deg", "virtual_force_N"}, {}};
    for (const char* m : method_names)
        for (const char* column :
             {"_error_N", "_theta_deg", "_psi_deg", "_dz_mm", "_at_limit", "_converged", "_evaluations"})
            s.columns.push_back(std::string(m) + column);
    for (const ComparedStep& row : steps) {
        for (double v : {row.time, row.roll_deg, row.virtual_force_N}) s.values.push_back(v);
        for (int m = 0; m < 3; ++m) {
            const MatchingResult& r = row.result[m];
            for (double v : {row.error_N[m], r.w[0] * 57.29577951308232, r.w[1] * 57.29577951308232, 1e3 * r.w[2],
                             double(r.constraint_active), double(row.converged[m]), double(r.evaluations)})
                s.values.push_back(v);
        }
    }
    return s;
}

/// Error over roll where the finger rolls by more than five degrees, over time elsewhere.
Plot error_plot(const std::string& finger, const std::vector<ComparedStep>& steps) {
    double low = 1e300, high = -1e300;
    for (const ComparedStep& row : steps) low = std::min(low, row.roll_deg), high = std::max(high, row.roll_deg);
    const bool rolls = high - low > 5;
    Plot plot{"Force-field error, " + finger,
              rolls ? "roll angle [degrees]" : "time [s]",
              "sum |F_i - Fbar_i| [N]",
              {},
              {},
              true};
    for (int m = 0; m < 3; ++m) {
        Curve c{method_titles[m], {}, {}};
        for (const ComparedStep& row : steps) {
            if (rolls && row.virtual_force_N < 0.05 * steps.back().virtual_force_N) continue;
            c.x.push_back(rolls ? std::abs(row.roll_deg) : row.time);
            c.y.push_back(row.error_N[m]);
        }
        plot.curves.push_back(std::move(c));
    }
    for (const ComparedStep& row : steps)
        if (row.result[0].constraint_active) {
            plot.markers.push_back({"device limit reached", rolls ? std::abs(row.roll_deg) : row.time});
            break;
        }
    return plot;
}

struct CompareArguments {
    std::string scene, out;
    std::vector<std::string> overrides;
    int threads = 0;
    bool quiet = false;
};

void print_table(const std::string& finger, const std::vector<ComparedStep>& steps) {
    std::printf("%s: %zu rendering steps with contact; mean and largest error sum |F_i - Fbar_i| [N]\n", finger.c_str(),
                steps.size());
    for (int m = 0; m < 3; ++m) {
        double sum = 0, largest = 0, share = 0;
        int unconverged = 0;
        for (const ComparedStep& row : steps) {
            sum += row.error_N[m];
            largest = std::max(largest, row.error_N[m]);
            share += row.error_N[m] / row.virtual_force_N;
            unconverged += !row.converged[m];
        }
        const double n = double(std::max<std::size_t>(1, steps.size()));
        std::printf("  %-28s %8.4f %8.4f   relative to sum |Fbar_i| %5.1f %%   not converged %d\n", method_titles[m],
                    sum / n, largest, 100 * share / n, unconverged);
    }
}

int compare_scene(const CompareArguments& a, const std::atomic<bool>& stop) {
    Scene scene = load_scene(a.scene, a.overrides);
    if (scene.spec.thimbles.empty() || scene.spec.objects.empty())
        throw InputError(a.scene +
                         ": no finger has a device and something to touch; compare needs both (device = { kind = "
                         "\"chinello-3rrs\" })");
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / (scene.file.stem().string() + "-compare")
                      : std::filesystem::path(a.out);
    Simulation simulation = make_simulation(std::move(scene), a.threads);
    std::function<void(double)> progress;
    if (!a.quiet && isatty(STDERR_FILENO))
        progress = [](double share) { std::fprintf(stderr, "\r%3d %%%s", int(100 * share), share >= 1 ? "\n" : ""); };
    const auto all = compare(simulation, stop, progress);
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
    std::vector<Plot> plots;
    for (std::size_t t = 0; t < all.size(); ++t) {
        const std::string& finger = simulation.scene.spec.fingers[simulation.scene.spec.thimbles[t].finger].name;
        write_csv(folder / (finger + "-errors.csv"), to_series(all[t]));
        if (all[t].empty())
            std::printf("%s: never in contact\n", finger.c_str());
        else
            plots.push_back(error_plot(finger, all[t]));
        if (!a.quiet && !all[t].empty()) print_table(finger, all[t]);
    }
    write_svg(folder / "errors.svg", plots);
    if (!a.quiet) std::printf("written to %s (errors.svg, one -errors.csv per finger)\n", folder.string().c_str());
    return stop ? 130 : 0;
}

}  // namespace

Action add_compare_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("compare", "error analysis of the rendering methods (Perez et al. 2017, Fig. 7)");
    auto a = std::make_shared<CompareArguments>();
    c->add_option("scene", a->scene, "scene file (.toml)")->required();
    c->add_option("--out", a->out, "folder for results (default: results/SCENE-compare)");
    c->add_option("--set", a->overrides, "override a value of the scene")->take_all()->allow_extra_args(false);
    c->add_option("--threads", a->threads, "threads (default: all cores)")->check(CLI::Range(1, 1024));
    c->add_flag("--quiet", a->quiet, "print nothing but errors");
    return [a, &stop] { return compare_scene(*a, stop); };
}

}  // namespace palpate
