// `palpate replay`: runs a recorded run again from what went in, and compares what comes out bit for bit.

#include <cstdio>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/commands.h"
#include "scenes/recording/results.h"
#include "scenes/recording/run_file.h"
#include "scenes/viewer/report.h"

namespace palpate {

namespace {

struct ReplayArguments {
    std::string file, out, report, extract;
    int threads = 0;
};

/// Says where two outcomes of a step differ first; false if nowhere.
bool report_difference(const RecordedRun& run, const RecordedStep& step, std::size_t k, const StepOutcome& now) {
    for (std::size_t a = 0; a < run.arrays.size(); ++a) {
        if (now.hashes[a] == step.outcome.hashes[a]) continue;
        double most = 0;
        for (std::size_t i = 0; i < now.forces.size(); ++i)
            most = std::max(most, norm(now.forces[i] - step.outcome.forces[i]));
        std::printf("differs first in step %zu (%.4f s), array \"%s\"; contact forces there by at most %.3g N\n", k + 1,
                    step.time, run.arrays[a].c_str(), most);
        return true;
    }
    return false;
}

int replay(const ReplayArguments& a, const std::atomic<bool>& stop) {
    const RecordedRun run = read_run(a.file);
    if (!a.extract.empty()) {
        write_file(a.extract, run.text);
        std::printf("%s written\n", a.extract.c_str());
        return 0;
    }
    Simulation s = make_simulation(recorded_scene(run, a.file), a.threads);
    if (array_names(s) != run.arrays)
        throw InputError(a.file + ": the scene builds other fingers or thimbles than the recorded run had");
    ReportRecorder report;
    bool differs = false;
    std::size_t k = 0;
    for (; k < run.steps.size() && !stop; ++k) {
        advance(s, run.steps[k].inputs);
        if (!a.report.empty()) report.record(s);
        if (!differs) differs = report_difference(run, run.steps[k], k, outcome_of(s));
    }
    if (run.unread_bytes > 0)
        std::printf(
            "the last %zu bytes of the file are no complete frame: the recording was cut off or damaged there\n",
            run.unread_bytes);
    if (!differs) std::printf("%zu steps, %.4g s: the same bit for bit\n", k, s.world.time);
    if (!a.out.empty() || !a.report.empty()) {
        const Summary summary = summarise(s);
        if (!a.out.empty()) write_results(a.out, s, summary);
        if (!a.report.empty()) report.write(a.report, s, summary);
    }
    return stop ? 130 : differs ? 1 : 0;
}

}  // namespace

Action add_replay_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("replay", "run a recorded run again and compare bit for bit");
    auto a = std::make_shared<ReplayArguments>();
    c->add_option("file", a->file, "what `palpate run --record` wrote")->required();
    c->add_option("--out", a->out, "folder for results: CSV, VTU, SVG, as of a run");
    c->add_option("--report", a->report, "write one HTML file with 3-D playback, plots and summary");
    c->add_option("--extract", a->extract, "write the recorded scene file, and do nothing else");
    c->add_option("--threads", a->threads, "threads (default: all cores)")->check(CLI::Range(1, 1024));
    return [a, &stop] { return replay(*a, stop); };
}

}  // namespace palpate
