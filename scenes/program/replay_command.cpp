// `palpate replay`: runs what was recorded again from what went in, and compares what comes out bit for bit.

#include <cstdio>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/program/commands.h"
#include "scenes/program/progress.h"
#include "scenes/program/replay_run.h"
#include "scenes/recording/outputs.h"
#include "scenes/recording/results.h"
#include "scenes/recording/results_folder.h"
#include "scenes/recording/video.h"
#include "scenes/viewer/report.h"

namespace palpate {

namespace {

struct ReplayArguments {
    std::string file, out, report, extract, video;
    int threads = 0, run = 0;
};

void extract(const ReplayArguments& a, const RecordedRun& run) {
    write_file(a.extract, run.text);
    std::printf("%s written\n", a.extract.c_str());
}

/// False where it comes out otherwise, or not all of it could be run.
bool replay_one(const ReplayArguments& a, const Recording& recording, std::size_t number, ResultsFolder* results,
                const std::atomic<bool>& stop) {
    const RecordedRun& run = recording.runs[number];
    ReportRecorder report;
    PressureScales scales;
    std::optional<Video> video;
    if (!a.video.empty()) video.emplace(a.video, PictureSettings{});
    for (const std::string& change : changes_of(run.files, "the run was recorded"))
        std::fprintf(stderr, "%s\n", change.c_str());
    Progress progress("replay");
    const Replay replay = replay_run(run, a.file, a.threads, stop, [&](const Simulation& s) {
        progress.show(double(s.world.step) / double(std::max<std::size_t>(1, run.steps.size())), s.world.step,
                      s.world.time);
        scales.record(s);
        if (!a.report.empty()) report.record(s);
        if (video) video->record(s);
    });
    progress.clear();
    const Simulation& s = *replay.simulation;
    const std::string which = recording.runs.size() > 1 ? "run " + std::to_string(number + 1) + ": " : "";
    if (const auto& d = replay.difference)
        std::printf("%sdiffers first in step %zu (%.4f s), array \"%s\"; contact forces there by at most %.3g N\n",
                    which.c_str(), d->step + 1, run.steps[d->step].time, d->array.c_str(), d->force_N);
    else
        std::printf("%s%zu steps, %.4g s: the same bit for bit\n", which.c_str(), replay.steps, s.world.time);
    if (replay.steps < run.steps.size() && !stop)
        std::printf("%s%zu steps behind damaged bytes cannot be run again; `palpate convert` reads them\n",
                    which.c_str(), run.steps.size() - replay.steps);
    if (results || !a.report.empty()) {
        const Summary summary = summarise(s);
        PictureSettings picture;
        picture.scales = scales_of(s, &scales);
        if (results) {
            const std::filesystem::path folder = folder_of_run(results->part(), recording, number);
            std::filesystem::create_directories(folder);
            write_results(folder, s, summary, picture);
        }
        if (!a.report.empty()) report.write(a.report, s, summary, picture.scales);
    }
    if (video) std::printf("%s\n", video->finish().c_str());
    return !replay.difference;
}

int replay(const ReplayArguments& a, const std::atomic<bool>& stop) {
    refuse_to_replace("--extract", a.extract, Output::scene);
    refuse_to_replace("--report", a.report, Output::report);
    refuse_to_replace("--video", a.video, Output::film);
    const Recording recording = read_recording(a.file);
    const std::size_t count = recording.runs.size();
    if (a.run > int(count))
        throw InputError(a.file + ": --run " + std::to_string(a.run) + ": it holds " + std::to_string(count) + " runs");
    if (!(a.report.empty() && a.video.empty()) && count > 1 && a.run == 0)
        throw InputError(a.file + ": it holds " + std::to_string(count) +
                         " runs; --run N says which of them --report or --video shows");
    const std::size_t first = a.run > 0 ? std::size_t(a.run - 1) : 0, last = a.run > 0 ? first + 1 : count;
    if (!a.extract.empty()) {
        extract(a, recording.runs[first]);
        return 0;
    }
    std::optional<ResultsFolder> results;
    if (!a.out.empty()) results.emplace(a.out);
    bool same = true;
    for (std::size_t k = first; k < last && !stop; ++k)
        same &= replay_one(a, recording, k, results ? &*results : nullptr, stop);
    if (results)
        for (const std::string& sentence : results->finish()) std::printf("%s: %s\n", a.out.c_str(), sentence.c_str());
    const bool lost = report_losses(recording, a.file);
    return stop ? 130 : same && !lost ? 0 : 1;
}

}  // namespace

Action add_replay_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("replay", "run what was recorded again and compare bit for bit");
    auto a = std::make_shared<ReplayArguments>();
    c.option("file", a->file, "what `palpate run --record` or `palpate view --record` wrote").required();
    c.option("--run", a->run, "of several runs in the file, this one alone (1, 2, ...)").range(1, 1000000000);
    c.option("--out", a->out, "folder for results: CSV, VTU, SVG, as of a run");
    c.option("--report", a->report, "write one HTML file with 3-D playback, plots and summary");
    c.option("--video", a->video,
             "film of the run: .webm, .gif or .mp4 by ffmpeg; where that is not, pictures in a folder");
    c.option("--extract", a->extract, "write the recorded scene file, and do nothing else");
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.footer(
        "Exit code 0: all of it came out the same. 1: it came out otherwise, or the recording is not whole (what is "
        "missing is said).");
    return [a, &stop] { return replay(*a, stop); };
}

}  // namespace palpate
