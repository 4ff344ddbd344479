// `palpate sweep`: what settings cost and what they lose.

#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
#include "scenes/program/sweep_output.h"
#include "scenes/program/version.h"
#include "scenes/recording/file_stamp.h"
#include "scenes/run/budget.h"
#include "scenes/run/wrapped.h"
#include "scenes/studies/processes.h"
#include "scenes/studies/sweep.h"

namespace palpate {

namespace {

struct SweepArguments {
    std::string scene, out;
    std::vector<std::string> overrides, axes;
    double reference_dt_ms = 0;
    int threads = 0;
    bool quiet = false, json = false;
};

/// What rows are of, as a comment: the scene with all files that it names, what is set, the program.
std::string basis_of(const SweepArguments& a, const Scene& scene) {
    std::vector<std::filesystem::path> files = scene.files;
    files.push_back(scene.file);
    std::ostringstream all;
    for (const FileStamp& f : stamps_of(files)) all << f.file << " " << f.bytes << " " << f.hash << "\n";
    for (const std::string& o : a.overrides) all << o << "\n";
    all << a.reference_dt_ms << "\n" << program_version << " " << program_commit;
    const std::string text = all.str();
    std::ostringstream out;
    out << "# of " << std::hex << hash_of(text.data(), text.size());
    return out.str();
}

/// Those of an earlier, interrupted sweep with the same basis and columns. A file of another sweep is put aside.
std::map<std::vector<std::string>, SweepPoint> read_rows(const std::filesystem::path& file, const std::string& basis,
                                                         const std::string& header, std::size_t axes) {
    std::map<std::vector<std::string>, SweepPoint> rows;
    std::ifstream in(file);
    std::string text;
    bool of_this = false, same = false;
    for (std::string line; std::getline(in, line);) {
        if (same && !in.eof()) text += line + "\n";
        of_this |= line == basis;
        same |= of_this && line == header;
    }
    read_rows(text, axes, rows);
    std::error_code none;
    if (same || !std::filesystem::exists(file, none)) return rows;
    const std::string aside = file.string() + ".before";
    std::filesystem::rename(file, aside, none);
    if (!none)
        std::fprintf(stderr, "%s: is of another scene, settings, axes or palpate, and is called %s now\n",
                     file.string().c_str(), aside.c_str());
    return rows;
}

using References = std::map<SweepReference, ReferenceRun>;

std::vector<std::string> overrides_of(const SweepArguments& a, const SweepPlan& plan,
                                      const std::vector<std::string>& values) {
    std::vector<std::string> all = a.overrides;
    all.push_back("solver.preset=balanced");
    for (auto& o : overrides_of(plan, values)) all.push_back(std::move(o));
    return all;
}

constexpr double period = 0.02;  // of the samples that are compared: that of a thimble's updates [s]

/// Runs this process's share of the points but for those that are `done`, each row to `out` as it comes. All its rows.
std::string run_share(const SweepArguments& a, const SweepPlan& plan, const References& references,
                      const Processes& processes, std::map<std::vector<std::string>, SweepPoint>& done,
                      std::ofstream& out, const std::atomic<bool>& stop) {
    const auto& all = plan.points;
    std::size_t run_now = 0, to_run = 0;
    for (std::size_t k = std::size_t(processes.rank); k < all.size(); k += std::size_t(processes.size))
        to_run += !done.contains(all[k]);
    Progress progress("sweep", a.quiet);
    std::string mine;
    for (std::size_t k = std::size_t(processes.rank); k < all.size() && !stop; k += std::size_t(processes.size)) {
        auto it = done.find(all[k]);
        if (it == done.end()) {
            SweepTrace trace;
            SweepPoint p = run_point(a.scene, overrides_of(a, plan, all[k]), period, a.threads, stop, trace);
            if (stop) break;
            p.values = all[k];
            const ReferenceRun& reference = references.at(reference_of(all[k]));
            p.errors = errors_of(trace, reference.trace, reference.comparison);
            p.failed = p.resets > 0 || !std::isfinite(p.errors.net);
            out << row_of(p) << "\n";
            out.flush();
            it = done.emplace(all[k], std::move(p)).first;
            ++run_now;
            progress.show(double(run_now) / double(to_run));
        }
        mine += row_of(it->second) + "\n";
    }
    return mine;
}

/// The settings to try. Mistakes are said before an hour has passed.
SweepPlan checked_plan(const SweepArguments& a, const Scene& scene) {
    std::vector<SweepBlock> blocks(a.axes.empty() ? 0 : 1);
    for (const std::string& text : a.axes) blocks[0].push_back(parse_axis(text));
    const SweepPlan plan = plan_sweep(blocks.empty() ? default_blocks(scene) : blocks, scene);
    std::set<std::string> tried;  // every value once is enough
    for (const auto& values : plan.points) {
        bool is_new = false;
        for (std::size_t i = 0; i + 1 < values.size(); ++i)
            is_new |= tried.insert(plan.keys[i] + "=" + values[i]).second;
        if (is_new) load_scene(a.scene, overrides_of(a, plan, values));
    }
    return plan;
}

References solve_references(const SweepArguments& a, const SweepPlan& plan, const std::atomic<bool>& stop) {
    References references;
    for (const SweepReference kind : {SweepReference::step, SweepReference::mesh}) {
        const double finest = plan.finest_dt_ms[int(kind)];
        if (finest <= 0) continue;
        // What is asked for the step would take days with the finest mesh.
        const double asked = a.reference_dt_ms, half = 0.5 * finest;
        const double dt_ms = kind == SweepReference::mesh ? std::max(asked, half) : asked > 0 ? asked : half;
        ReferenceRequest request{a.scene, a.overrides, dt_ms, period, a.threads, {}};
        if (!a.quiet)
            request.progress = [](const std::string& what) { std::fprintf(stderr, "%s", wrapped(what).c_str()); };
        references[kind] = solve_reference(request, plan, kind, stop);
    }
    return references;
}

int sweep_scene(const SweepArguments& asked, const std::atomic<bool>& stop) {
    // Each process of mpirun takes its share of the points, and the first one merges what they found.
    const Processes processes = join_processes();
    SweepArguments a = asked;
    a.quiet = a.quiet || processes.rank != 0;
    std::optional<EndsAtOnce> loading(std::in_place);
    const Scene scene = load_scene(a.scene, a.overrides);
    loading.reset();
    const SweepPlan plan = checked_plan(a, scene);
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / (scene.file.stem().string() + "-sweep")
                      : std::filesystem::path(a.out);
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
    std::string header;
    for (const std::string& key : plan.keys) header += key + ",";
    header += sweep_columns;
    const auto file = folder / (processes.rank == 0 ? "sweep.csv" : "sweep-" + std::to_string(processes.rank) + ".csv");
    const std::string basis = basis_of(a, scene);
    auto done = read_rows(file, basis, header, plan.keys.size());
    std::ofstream out(file, done.empty() ? std::ios::trunc : std::ios::app);
    if (!out) throw InputError(file.string() + ": cannot be written");
    const std::string about = std::string("# palpate ") + program_version + " " + program_commit + ", " + processor() +
                              ", scene " + scene.file.string() + "\n" + basis + "\n" + header + "\n";
    if (done.empty()) out << about;
    out.flush();

    const References references = solve_references(a, plan, stop);
    const std::string mine = run_share(a, plan, references, processes, done, out, stop);
    if (stop && processes.rank == 0) std::fprintf(stderr, "interrupted; the same command goes on where it was\n");
    const auto texts = gather(processes, mine);
    if (stop) return 130;
    if (processes.rank != 0) {
        out.close();
        std::filesystem::remove(file);
        return 0;
    }
    // In the order of the settings, whoever has run them.
    std::map<std::vector<std::string>, SweepPoint> merged;
    for (const std::string& text : texts) read_rows(text, plan.keys.size(), merged);
    std::map<SweepReference, std::vector<SweepPoint>> points;
    std::string rows = about;
    for (const auto& values : plan.points) {
        const SweepPoint& p = merged.at(values);
        points[reference_of(values)].push_back(p);
        rows += row_of(p) + "\n";
    }
    out.close();
    write_file(file, rows);
    std::vector<Plot> plots;
    std::vector<SweptPoints> swept;
    for (const auto& [kind, of_kind] : points) {
        const ReferenceRun& reference = references.at(kind);
        plots.push_back(work_precision(of_kind, plan, reference, false));
        if (kind == SweepReference::step) plots.push_back(work_precision(of_kind, plan, reference, true));
        swept.push_back({kind, reference, of_kind});
        if (!a.json && !a.quiet) print_results(of_kind, plan, reference);
    }
    write_svg(folder / "sweep.svg", plots);
    if (a.json)
        std::printf("%s\n", json_text(swept, plan).c_str());
    else if (!a.quiet)
        std::printf("\nwritten to %s (sweep.csv, sweep.svg)\n", folder.string().c_str());
    return 0;
}

}  // namespace

Action add_sweep_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c =
        program.subcommand("sweep", "what settings cost and what they lose, against a converged reference");
    auto a = std::make_shared<SweepArguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--axes", a->axes,
             "settings to vary, for example dt_ms=1,5,20 solver.newton_iterations=1,2 finger.*.elements=200,800 "
             "(default: time step, iterations, precision; meshes; limits, contact, friction and matching one by one)");
    c.option("--out", a->out, "folder for results (default: results/SCENE-sweep); a sweep goes on from what is there");
    c.option("--set", a->overrides, "override a value of the scene in all runs").repeatable();
    c.option("--reference-dt-ms", a->reference_dt_ms,
             "step of the reference (default: half the smallest); of that of meshes no less than half theirs")
        .range(1e-3, 200.0);
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.flag("--quiet", a->quiet, "print nothing but errors");
    c.flag("--json", a->json, "print every point and its reference as JSON");
    return [a, &stop] { return sweep_scene(*a, stop); };
}

}  // namespace palpate
