// `palpate sweep`: what settings cost and what they lose.

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/budget.h"
#include "scenes/commands.h"
#include "scenes/recording/svg.h"
#include "scenes/shards.h"
#include "scenes/sweep.h"

namespace palpate {

namespace {

struct SweepArguments {
    std::string scene, out;
    std::vector<std::string> overrides, axes;
    double reference_dt_ms = 0;
    int threads = 0;
    bool quiet = false;
};

const char* const columns =
    "field_error,net_error,area_error,platform_mm,seconds_per_second,median_us,p99_us,dt_ms,limit_violation,"
    "penetration_um,converged,resets,failed";

std::string row_of(const SweepPoint& p) {
    std::ostringstream out;
    out.precision(9);
    for (const std::string& v : p.values) out << v << ",";
    out << p.errors.field << "," << p.errors.net << "," << p.errors.area << "," << p.errors.platform_mm << ","
        << p.seconds_per_second << "," << p.median_us << "," << p.p99_us << "," << p.dt_ms << "," << p.limit_violation
        << "," << p.penetration_um << "," << p.converged << "," << p.resets << "," << int(p.failed);
    return out.str();
}

/// Rows by their settings; one that was not finished is left out.
void read_rows(const std::string& text, std::size_t axes, std::map<std::vector<std::string>, SweepPoint>& rows) {
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) {
        if (line.empty() || line[0] == '#') continue;
        std::vector<std::string> cells;
        std::istringstream cut(line);
        for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
        if (cells.size() != axes + 13) continue;
        SweepPoint p;
        p.values.assign(cells.begin(), cells.begin() + std::ptrdiff_t(axes));
        auto number = [&](std::size_t i) { return std::strtod(cells[axes + i].c_str(), nullptr); };
        p.errors = {number(0), number(1), number(2), number(3)};
        p.seconds_per_second = number(4), p.median_us = number(5), p.p99_us = number(6), p.dt_ms = number(7);
        p.limit_violation = number(8), p.penetration_um = number(9), p.converged = number(10);
        p.resets = std::int64_t(number(11)), p.failed = number(12) != 0;
        rows[p.values] = p;
    }
}

/// Those of an earlier, interrupted sweep of the same kind.
std::map<std::vector<std::string>, SweepPoint> read_rows(const std::filesystem::path& file, const std::string& header,
                                                         std::size_t axes) {
    std::map<std::vector<std::string>, SweepPoint> rows;
    std::ifstream in(file);
    std::string text;
    bool same = false;
    for (std::string line; std::getline(in, line);) {
        if (same && !in.eof()) text += line + "\n";
        same |= line == header;
    }
    read_rows(text, axes, rows);
    return rows;
}

/// The converged reference with the finest step, and what is not known of it.
struct Reference {
    SweepTrace trace;
    SweepErrors uncertainty;  ///< Richardson: the last halving's change, for a method of first order
};

Reference solve_reference(const SweepArguments& a, double dt_ms, double period, const std::atomic<bool>& stop) {
    Reference r;
    SweepTrace coarser;
    for (double dt : {2 * dt_ms, dt_ms}) {
        std::vector<std::string> overrides = a.overrides;
        std::ostringstream text;
        text << "dt_ms=" << dt;
        overrides.insert(overrides.end(), {"solver.preset=reference", text.str()});
        if (!a.quiet) std::fprintf(stderr, "reference at %g ms\n", dt);
        coarser = std::move(r.trace);
        run_point(a.scene, overrides, period, a.threads, stop, r.trace);
    }
    r.uncertainty = errors_of(coarser, r.trace);
    return r;
}

Plot work_precision(const std::vector<SweepPoint>& points, const std::vector<SweepAxis>& axes,
                    const Reference& reference) {
    Plot plot{"Work and precision", "compute time per simulated second [s]", "force-field error", {}, {}, true};
    plot.log_x = true;
    // One curve per value of the first axis; points below three times the reference's own uncertainty apart.
    const double known = 3 * reference.uncertainty.field;
    for (const std::string& value : axes[0].values) {
        Curve c{axes[0].key + " = " + value, {}, {}};
        c.points = true;
        for (const SweepPoint& p : points)
            if (p.values[0] == value && !p.failed && p.errors.field > known)
                c.x.push_back(p.seconds_per_second), c.y.push_back(p.errors.field);
        plot.curves.push_back(std::move(c));
    }
    Curve below{"below 3 x uncertainty", {}, {}}, failed{"failed", {}, {}}, front{"Pareto front", {}, {}};
    below.points = failed.points = true;
    std::vector<SweepPoint> best;
    for (const SweepPoint& p : points) {
        if (p.failed) failed.x.push_back(p.seconds_per_second), failed.y.push_back(1);
        if (!p.failed && p.errors.field <= known)
            below.x.push_back(p.seconds_per_second), below.y.push_back(p.errors.field);
        if (on_front(p, points)) best.push_back(p);
    }
    std::sort(best.begin(), best.end(), [](auto& x, auto& y) { return x.seconds_per_second < y.seconds_per_second; });
    for (const SweepPoint& p : best) front.x.push_back(p.seconds_per_second), front.y.push_back(p.errors.field);
    for (Curve* c : {&below, &failed, &front})
        if (!c->x.empty()) plot.curves.push_back(std::move(*c));
    plot.markers.push_back({"real time", 1});
    return plot;
}

std::string settings_text(const std::vector<SweepAxis>& axes, const SweepPoint& p) {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const std::string& key = axes[i].key;
        text += (i ? ", " : "") + key.substr(key.rfind('.') + 1) + " " + p.values[i];
    }
    return text;
}

void print_results(const std::vector<SweepPoint>& points, const std::vector<SweepAxis>& axes, const Reference& r) {
    std::printf("reference: its own uncertainty is %.2g %% of the field, %.2g %% of the net force\n",
                100 * r.uncertainty.field, 100 * r.uncertainty.net);
    std::printf("\nfastest setting below an error of the force field:\n");
    for (double most : {0.10, 0.05, 0.01}) {
        const SweepPoint* best = nullptr;
        for (const SweepPoint& p : points)
            if (!p.failed && p.errors.field <= most && (!best || p.seconds_per_second < best->seconds_per_second))
                best = &p;
        if (best)
            std::printf("  %4.0f %%: %6.3f s per simulated second, step %.0f us median, %.0f us p99 (%s)\n", 100 * most,
                        best->seconds_per_second, best->median_us, best->p99_us, settings_text(axes, *best).c_str());
        else
            std::printf("  %4.0f %%: no setting of this sweep\n", 100 * most);
    }
    std::printf("\n%-52s %9s %9s %9s %9s %10s %9s %9s\n", "settings on the Pareto front", "field %", "net %", "area %",
                "centre um", "s / s", "p99 us", "limits");
    for (const SweepPoint& p : points)
        if (on_front(p, points))
            std::printf("%-52s %9.3f %9.3f %9.3f %9.2f %10.4f %9.0f %9.1e\n", settings_text(axes, p).c_str(),
                        100 * p.errors.field, 100 * p.errors.net, 100 * p.errors.area, 1e3 * p.errors.platform_mm,
                        p.seconds_per_second, p.p99_us, p.limit_violation);
    int failed = 0;
    for (const SweepPoint& p : points)
        if (p.failed && failed++ < 20) std::printf("failed: %s\n", settings_text(axes, p).c_str());
}

struct SweepPlan {
    const SweepArguments& arguments;
    const std::vector<SweepAxis>& axes;
    const std::vector<std::vector<std::string>>& points;  ///< values of every axis
    const std::vector<std::string>& fingers;
    double period;  ///< of the samples that are compared [s]
};

/// Runs this process's share of the points but for those that are `done`, each row to `out` as it comes. All its rows.
std::string run_share(const SweepPlan& plan, const Reference& reference, const Shards& shards,
                      std::map<std::vector<std::string>, SweepPoint>& done, std::ofstream& out,
                      const std::atomic<bool>& stop) {
    const SweepArguments& a = plan.arguments;
    const auto& all = plan.points;
    const auto start = std::chrono::steady_clock::now();
    std::size_t run_now = 0;
    std::string mine;
    for (std::size_t k = std::size_t(shards.rank); k < all.size() && !stop; k += std::size_t(shards.size)) {
        auto it = done.find(all[k]);
        if (it == done.end()) {
            std::vector<std::string> overrides = a.overrides;
            overrides.push_back("solver.preset=real-time");
            for (auto& o : overrides_of(plan.axes, all[k], plan.fingers)) overrides.push_back(std::move(o));
            SweepTrace trace;
            SweepPoint p = run_point(a.scene, overrides, plan.period, a.threads, stop, trace);
            if (stop) break;
            p.values = all[k];
            p.errors = errors_of(trace, reference.trace);
            p.failed = p.resets > 0 || !std::isfinite(p.errors.net);
            out << row_of(p) << "\n";
            out.flush();
            it = done.emplace(all[k], std::move(p)).first;
            ++run_now;
            const double elapsed = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
            if (!a.quiet && isatty(STDERR_FILENO))
                std::fprintf(stderr, "\r%zu of %zu, about %.0f s left   ", k + 1, all.size(),
                             elapsed / double(run_now) * double(all.size() - k - 1) / shards.size);
        }
        mine += row_of(it->second) + "\n";
    }
    return mine;
}

int sweep_scene(const SweepArguments& asked, const std::atomic<bool>& stop) {
    // Each process of mpirun takes its share of the points, and the first one merges what they found.
    const Shards shards = join_shards();
    SweepArguments a = asked;
    a.quiet = a.quiet || shards.rank != 0;
    std::vector<SweepAxis> axes;
    for (const std::string& text : a.axes) axes.push_back(parse_axis(text));
    if (axes.empty()) axes = default_axes();
    const Scene scene = load_scene(a.scene, a.overrides);  // mistakes are said before an hour has passed
    std::vector<std::string> names;
    for (const FingerSpec& f : scene.spec.fingers) names.push_back(f.name);
    double finest = 1e3 * scene.spec.solver.dt;
    for (const SweepAxis& axis : axes)
        if (axis.key == "dt_ms") finest = std::strtod(axis.values[0].c_str(), nullptr);
    for (const SweepAxis& axis : axes)
        for (const std::string& v : axis.values)
            if (axis.key == "dt_ms") finest = std::min(finest, std::strtod(v.c_str(), nullptr));
    const auto all = combinations(axes);
    for (const auto& values : all) {
        std::vector<std::string> overrides = a.overrides;
        overrides.push_back("solver.preset=real-time");
        for (auto& o : overrides_of(axes, values, names)) overrides.push_back(o);
        if (&values == &all.front() || &values == &all.back()) load_scene(a.scene, overrides);
    }
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / (scene.file.stem().string() + "-sweep")
                      : std::filesystem::path(a.out);
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
    std::string header;
    for (const SweepAxis& axis : axes) header += axis.key + ",";
    header += columns;
    const auto file = folder / (shards.rank == 0 ? "sweep.csv" : "sweep-" + std::to_string(shards.rank) + ".csv");
    auto done = read_rows(file, header, axes.size());
    std::ofstream out(file, done.empty() ? std::ios::trunc : std::ios::app);
    if (!out) throw InputError(file.string() + ": cannot be written");
    const std::string about = "# palpate " PALPATE_VERSION " " PALPATE_COMMIT ", " + processor() + ", scene " +
                              scene.file.string() + "\n" + header + "\n";
    if (done.empty()) out << about;
    out.flush();

    constexpr double period = 0.02;  // that of a thimble's updates
    const Reference reference =
        solve_reference(a, a.reference_dt_ms > 0 ? a.reference_dt_ms : 0.5 * finest, period, stop);
    const SweepPlan plan{a, axes, all, names, period};
    const std::string mine = run_share(plan, reference, shards, done, out, stop);
    if (!a.quiet && isatty(STDERR_FILENO)) std::fprintf(stderr, "\n");
    if (stop && shards.rank == 0) std::fprintf(stderr, "interrupted; the same command goes on where it was\n");
    const auto texts = gather(shards, mine);
    if (stop) return 130;
    if (shards.rank != 0) {
        out.close();
        std::filesystem::remove(file);
        return 0;
    }
    // In the order of the settings, whoever has run them.
    std::map<std::vector<std::string>, SweepPoint> merged;
    for (const std::string& text : texts) read_rows(text, axes.size(), merged);
    std::vector<SweepPoint> points;
    std::string rows = about;
    for (const auto& values : all) {
        points.push_back(merged.at(values));
        rows += row_of(points.back()) + "\n";
    }
    out.close();
    write_file(file, rows);
    write_svg(folder / "sweep.svg", {work_precision(points, axes, reference)});
    if (!a.quiet) {
        print_results(points, axes, reference);
        std::printf("\nwritten to %s (sweep.csv, sweep.svg)\n", folder.string().c_str());
    }
    return 0;
}

}  // namespace

Action add_sweep_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("sweep", "what settings cost and what they lose, against a converged reference");
    auto a = std::make_shared<SweepArguments>();
    c->add_option("scene", a->scene, "scene file (.toml)")->required();
    c->add_option("--axes", a->axes,
                  "settings to vary, for example dt_ms=1,5,20 solver.newton_iterations=1,2 finger.*.elements=200,800 "
                  "(default: time step, iterations, precision)");
    c->add_option("--out", a->out,
                  "folder for results (default: results/SCENE-sweep); a sweep goes on from what is there");
    c->add_option("--set", a->overrides, "override a value of the scene in all runs")
        ->take_all()
        ->allow_extra_args(false);
    c->add_option("--reference-dt-ms", a->reference_dt_ms, "step of the reference (default: half the smallest)")
        ->check(CLI::Range(1e-3, 200.0));
    c->add_option("--threads", a->threads, "threads (default: all cores)")->check(CLI::Range(1, 1024));
    c->add_flag("--quiet", a->quiet, "print nothing but errors");
    return [a, &stop] { return sweep_scene(*a, stop); };
}

}  // namespace palpate
