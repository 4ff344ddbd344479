#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/load/result_files.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
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
#include "scenes/trackers/hand_doubts.h"
#include "scenes/viewer/report.h"

namespace palpate {

namespace {

struct RunArguments {
    std::string scene, out, report, record, tracker, hold, video;
    StreamSettings stream;
    std::vector<std::string> overrides;
    int threads = 0;
    double duration = 0, pads_per_second = 0, budget_ms = 0;
    bool quiet = false, json = false, statics = false, arm = false, no_watchdog = false, no_hand = false,
         no_picture = false;
};

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

void tell_news(DeadMan& dead_man, Progress& progress) {
    const std::string news = take_news(dead_man);
    if (news.empty()) return;
    progress.clear();
    std::fprintf(stderr, "%s\n", news.c_str());
}

/// What is likely wrong with the hands that come, once each.
void tell_doubts(DoubtTeller& doubts, const Simulation& simulation, Progress& progress) {
    if (!simulation.live) return;
    for (const std::string& text : doubts.news(simulation.live->mailbox)) {
        progress.clear();
        std::fprintf(stderr, "warning: live hand: %s\n", text.c_str());
    }
}

/// What thimbles went through, and where they are now: whatever becomes of the results. False: of some nobody knows
/// that they are in their rest pose (a fault that latched, a board that is gone).
bool tell_of_thimbles(const RunArguments& a, const Simulation& simulation, const DeadMan* dead_man, bool stopped) {
    if (!simulation.hardware) return true;
    if (!a.quiet && !a.json) std::printf("%s", hardware_report(simulation).c_str());
    if (dead_man && dead_man->counts.held == 0)
        std::fprintf(stderr, "%s", hold_report(*dead_man).c_str());  // the run was for nothing: that is always said
    else if (dead_man && !a.quiet && !a.json)
        std::printf("%s", hold_report(*dead_man).c_str());
    bool at_rest = true;
    const std::string rest = rest_report(simulation, at_rest);
    if (!at_rest || stopped || !a.quiet) std::fprintf(stderr, "%s", rest.c_str());
    return at_rest;
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

void tell_of_scene(const RunArguments& a, const Scene& scene) {
    print_warnings(scene);
    if (a.quiet || a.json) return;
    // What is true of several fingers is said once.
    for (std::size_t i = 0; i < scene.mesh_notes.size(); ++i) {
        std::string names;
        for (std::size_t k = 0; k < scene.mesh_notes.size(); ++k)
            if (scene.mesh_notes[k] == scene.mesh_notes[i])
                names += (names.empty() ? "" : ", ") + scene.spec.fingers[k].name;
        const auto first = std::find(scene.mesh_notes.begin(), scene.mesh_notes.end(), scene.mesh_notes[i]);
        if (first == scene.mesh_notes.begin() + std::ptrdiff_t(i))
            std::printf("%s", wrapped(names + ": " + scene.mesh_notes[i]).c_str());
    }
    for (const auto& recording : scene.recordings)
        if (recording && !recording->note.empty()) std::printf("recorded hand: %s\n", recording->note.c_str());
}

/// What was felt, and which files hold it now.
void tell_results(const RunArguments& a, const Summary& summary, const ResultsFolder& results,
                  const std::filesystem::path& folder, const std::vector<std::string>& replaced) {
    if (a.json) std::printf("%s\n", to_json(summary).dump(2).c_str());
    if (a.json || a.quiet) return;
    std::printf("\n%s\n%s", to_text(summary).c_str(),
                wrapped(std::to_string(results.files()) + " files in " + folder.string() +
                        (a.no_picture ? " (" : " (picture.png, ") +
                        "plots.svg, summary.json, per finger .csv, _nodes.csv and .vtu)")
                    .c_str());
    for (const std::string& sentence : replaced) std::printf("%s: %s\n", folder.string().c_str(), sentence.c_str());
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

int run_scene(RunArguments a, const std::atomic<bool>& stop) {
    refuse_to_lose_files(a);
    refuse_to_hold_unarmed(a.hold, a.arm);
    if (a.stream.target == "-") a.quiet = true, a.json = false;  // standard output is the stream's
    const std::vector<std::string> overrides = all_overrides(a, stop);
    std::optional<EndsAtOnce> loading(std::in_place);
    Scene scene = load_scene(a.scene, overrides);
    if (a.pads_per_second > 0) refuse_colliding_pads(scene);
    tell_of_scene(a, scene);
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / scene.file.stem() : std::filesystem::path(a.out);
    Simulation simulation = make_simulation(std::move(scene), a.threads);
    loading.reset();
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

}  // namespace

Action add_run_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("run", "simulate a scene");
    auto a = std::make_shared<RunArguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--out", a->out, "folder for results (default: results/SCENE)");
    c.option("--pads-per-second", a->pads_per_second, "also write pads over time for ParaView (.vtu, .pvd)")
        .range(1e-3, 1e5);
    c.option("--record", a->record, "record inputs and outcome of every step; `palpate replay` runs it again");
    c.option("--tracker", a->tracker,
             "fingers that follow a hand follow a live one, in real time: udp:PORT, websocket:PORT, openxr, "
             "ultraleap[:HOST:PORT]");
    add_stream_options(c, a->stream);
    c.option("--report", a->report, "write one HTML file with 3-D playback, plots and summary; opens offline");
    c.option("--video", a->video,
             "film of the run: .webm, .gif or .mp4 by ffmpeg; where that is not, pictures in a folder");
    c.flag("--no-picture", a->no_picture, "no picture.png, which takes a second: for many runs");
    c.flag("--no-hand", a->no_hand, "pictures and films without the hand around the fingertips");
    c.option(
         "--set", a->overrides,
         "override a value of the scene, for example finger.index.material.young_kPa=40; finger.*. for every finger")
        .repeatable();
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.option("--duration", a->duration, "seconds to simulate (default: the scene's)").range(1e-3, 1e5);
    c.flag("--static", a->statics, "static equilibrium in every step: no inertia, no damping");
    c.option("--budget-ms", a->budget_ms,
             "take the most accurate preset and, where nobody says how many elements fingers have, mesh whose steps "
             "(p99) end "
             "within this time on this machine")
        .range(1e-3, 1e4);
    c.flag("--arm", a->arm, "drive real thimbles, in real time; without it nothing moves");
    c.option("--hold", a->hold,
             "with --arm: thimbles move only while this is held: key, joystick:/dev/input/js0[:BUTTON], "
             "heartbeat:PORT (UDP datagrams \"1\" to this machine, ten a second; \"0\", another or none lets go)");
    c.flag("--no-watchdog", a->no_watchdog, "drive controllers that would hold their force if palpate were killed");
    c.flag("--quiet", a->quiet, "print nothing but errors");
    c.flag("--json", a->json, "print the summary as JSON");
    return [a, &stop] { return run_scene(*a, stop); };
}

}  // namespace palpate
