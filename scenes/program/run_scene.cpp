#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/load/result_files.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
#include "scenes/program/run_news.h"
#include "scenes/program/stream_options.h"
#include "scenes/recording/live_tables.h"
#include "scenes/recording/outputs.h"
#include "scenes/recording/results.h"
#include "scenes/recording/results_folder.h"
#include "scenes/recording/run_file.h"
#include "scenes/recording/video.h"
#include "scenes/run/budget.h"
#include "scenes/run/dead_man.h"
#include "scenes/run/hardware.h"
#include "scenes/run/wrapped.h"
#include "scenes/stream/stream.h"
#include "scenes/viewer/report.h"

namespace palpate {

namespace {

/// Enter on a terminal clears the faults of thimbles whose cause is gone.
struct RearmKey {
    bool listens = isatty(STDIN_FILENO) != 0;
    int steps = 0;
    void look(Simulation& s) {
        if (!listens || ++steps % 20) return;
        pollfd p{STDIN_FILENO, POLLIN, 0};
        if (::poll(&p, 1, 0) <= 0) return;
        char line[64];
        listens = ::read(STDIN_FILENO, line, sizeof line) > 0;
        for (auto& loop : s.loops) loop->rearm_asked = listens;
    }
};

/// The settings for a budget; says what was measured.
std::vector<std::string> affordable_settings(const RunArguments& a, const std::vector<std::string>& overrides,
                                             const std::atomic<bool>& stop) {
    Progress progress("budget", a.quiet);
    const BudgetChoice choice =
        choice_within(a.budget_ms, a.scene, overrides, a.threads, stop, [&](double share) { progress.show(share); });
    progress.clear();
    std::string told;
    for (const BudgetPoint& t : choice.tried) {
        char line[120];
        std::snprintf(line, sizeof line, "%s%s %s%.3g ms%s", told.empty() ? "" : ", ", name_of(t).c_str(),
                      t.exceeded ? "over " : "", t.p99_ms, t.cached ? " (measured earlier)" : "");
        told += line;
    }
    if (!choice.found && !stop)
        throw InputError(a.scene + ": no preset keeps its steps within " + written("%g", a.budget_ms) +
                         " ms on this machine (p99: " + told + "); fewer elements, or fewer fingers, would");
    if (!a.quiet && !a.json) {
        char budget[60];
        std::snprintf(budget, sizeof budget, "budget %.3g ms: p99 of a step: ", a.budget_ms);
        const std::string chosen = choice.found ? "; taken: " + name_of(choice.chosen) : "";
        std::printf("%s", wrapped(budget + told + chosen).c_str());
    }
    return choice.found ? choice.settings() : std::vector<std::string>{"solver.preset=fast"};
}

/// False, and says why, where not all of it could be written.
bool end_recording(RunWriter& record) {
    record.finish();
    if (record.failure().empty()) return true;
    std::fprintf(stderr, "%s; the recording ends there\n", record.failure().c_str());
    return false;
}

/// The same of the stream.
bool end_stream(const RunArguments& a, Stream& stream) {
    const StreamCounts counts = stream.end();
    if (!a.quiet && !a.json) std::printf("%s\n", to_text(counts).c_str());
    if (counts.error == 0) return true;
    std::fprintf(stderr, "standard output: %s; the stream ends there\n", std::strerror(counts.error));
    return false;
}

/// The arguments' own overrides after those of the user.
std::vector<std::string> all_overrides(const RunArguments& a, const std::atomic<bool>& stop) {
    std::vector<std::string> overrides = a.overrides;
    if (a.duration > 0) overrides.push_back("duration_s=" + std::to_string(a.duration));
    if (a.statics) overrides.push_back("solver.static=true");
    if (a.budget_ms > 0)
        for (const std::string& o : affordable_settings(a, overrides, stop)) overrides.push_back(o);
    return overrides;
}

/// The scene, loaded and built; says what is to be said of it.
Simulation simulation_of(const RunArguments& a, const std::vector<std::string>& overrides) {
    const EndsAtOnce loading;
    Scene scene = load_scene(a.scene, overrides);
    if (a.pads_per_second > 0) refuse_colliding_pads(scene);
    tell_of_scene(a, scene);
    const std::size_t told = scene.warnings.size();
    Simulation simulation = make_simulation(std::move(scene), a.threads);
    for (std::size_t k = told; k < simulation.scene.warnings.size(); ++k)
        std::fprintf(stderr, "warning: %s\n", simulation.scene.warnings[k].c_str());
    return simulation;
}

void refuse_film_in_real_time(const RunArguments& a, const std::string& tracker) {
    if (a.video.empty() || (!a.arm && tracker.empty())) return;
    throw InputError("--video " + a.video +
                     ": a film is painted between steps, which real thimbles and live hands do not " +
                     "wait for; --record run.palpate, then palpate replay run.palpate --video " + a.video);
}

/// Live hands, where the arguments or the scene name a tracker.
void follow_tracker(const RunArguments& a, Simulation& simulation) {
    const std::string source = a.tracker.empty() ? simulation.scene.tracker : a.tracker;
    refuse_film_in_real_time(a, source);
    if (source.empty()) return;
    follow_live(simulation, std::make_shared<LiveHands>(source));
    if (!a.quiet && !a.json) std::printf("hands are expected from %s\n", simulation.live->source->about().c_str());
}

void refuse_to_lose_files(const RunArguments& a) {
    refuse_to_replace("--record", a.record, Output::recording);
    refuse_to_replace("--report", a.report, Output::report);
    refuse_to_replace("--video", a.video, Output::film);
}

}  // namespace

int run_scene(RunArguments a, const std::atomic<bool>& stop) {
    refuse_to_lose_files(a);
    refuse_to_hold_unarmed(a.hold, a.arm);
    if (a.stream.target == "-") a.quiet = true, a.json = false;  // standard output is the stream's
    const std::vector<std::string> overrides = all_overrides(a, stop);
    Simulation simulation = simulation_of(a, overrides);
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / simulation.scene.file.stem() : std::filesystem::path(a.out);
    follow_tracker(a, simulation);
    ReportRecorder report;
    PressureScales scales;
    PictureSettings picture;
    picture.hand = !a.no_hand, picture.painted = !a.no_picture;
    std::optional<Video> video;
    if (!a.video.empty()) video.emplace(a.video, picture);
    Progress progress("run", a.quiet);
    ResultsFolder results(folder);
    std::unique_ptr<DeadMan> dead_man;  // what is wrong with it is said before anything moves
    if (a.arm && !a.hold.empty()) dead_man = make_dead_man(a.hold);
    if (a.arm)
        arm(simulation, {!a.no_watchdog, folder});
    else if (!a.quiet && !a.json && drives_hardware(simulation.scene))
        std::printf("thimbles are simulated; --arm moves the real ones\n");
    LiveTables tables(results.part(), simulation);
    std::optional<PadSeries> pads;
    if (a.pads_per_second > 0) pads.emplace(results.part(), a.pads_per_second);
    std::exception_ptr pads_failure;  // thrown when the run is over, and thimbles are at rest
    std::unique_ptr<RunWriter> record;
    if (!a.record.empty()) record = std::make_unique<RunWriter>(a.record, simulation, overrides);
    if (dead_man) obey_dead_man(*dead_man, simulation);
    std::unique_ptr<Stream> stream;
    if (!a.stream.target.empty()) stream = std::make_unique<Stream>(a.stream), tell_address(*stream);
    RearmKey rearm_key;
    DoubtTeller doubts;
    if (dead_man && dead_man->uses_terminal) rearm_key.listens = false;
    run(
        simulation, stop,
        [&](const StepInputs& inputs, double share) {
            if (a.arm) rearm_key.look(simulation);
            if (dead_man) obey_dead_man(*dead_man, simulation), tell_news(*dead_man, progress);
            tell_doubts(doubts, simulation, progress);
            scales.record(simulation);
            if (!a.report.empty()) report.record(simulation);
            if (record) record->record(inputs, simulation);
            if (video) video->record(simulation);
            if (stream) stream->tell(simulation);
            tables.record(simulation);
            try {
                if (pads && !pads_failure) pads->record(simulation);
            } catch (const std::exception&) { pads_failure = std::current_exception(); }
            progress.show(share, simulation.world.step, simulation.world.time);
        },
        [&](StepInputs& inputs) {
            if (stream) obey(*stream, simulation, inputs, stop);
        });
    progress.clear();
    const bool stream_failed = stream && !end_stream(a, *stream);
    const bool at_rest = tell_of_thimbles(a, simulation, dead_man.get(), stop);
    const bool record_failed = record && !end_recording(*record);
    const Summary summary = summarise(simulation);
    if (pads_failure) std::rethrow_exception(pads_failure);
    tables.finish(simulation);
    picture.scales = scales_of(simulation, &scales);
    write_results(results.part(), simulation, summary, picture, true);
    if (pads) pads->finish(simulation);
    const std::vector<std::string> replaced = results.finish();
    if (!a.report.empty()) report.write(a.report, simulation, summary, picture.scales);
    if (simulation.live && !a.quiet && !a.json) std::printf("%s\n", to_text(simulation.live->mailbox.counts()).c_str());
    tell_results(a, summary, results, folder, replaced);
    if (video) {
        const std::string said = video->finish();
        if (!a.quiet && !a.json) std::printf("%s\n", said.c_str());
    }
    if (stop) std::fprintf(stderr, "stopped early at %.3f s\n", simulation.world.time);
    return stop ? 130 : record_failed || stream_failed || !at_rest ? 1 : 0;
}

}  // namespace palpate
