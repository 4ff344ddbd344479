// `palpate view`: runs a scene in real time and shows it in a browser.

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/load/presets.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"
#include "scenes/program/stream_options.h"
#include "scenes/recording/outputs.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/carry_over.h"
#include "scenes/run/dead_man.h"
#include "scenes/run/hardware.h"
#include "scenes/stream/stream.h"
#include "scenes/trackers/hand_doubts.h"
#include "scenes/viewer/report.h"
#include "scenes/viewer/server.h"

namespace palpate {

namespace {

struct ViewArguments {
    std::string scene;
    std::vector<std::string> overrides;
    int threads = 0, port = 8420;
    std::string tracker, record, hold;
    StreamSettings stream;
    bool any_address = false, arm = false, remote_arm = false, no_watchdog = false;
};

/// The scene's main settings: label, the keys they change, range (a slider) or choices, and value now.
nlohmann::json settings_of(const Scene& scene) {
    nlohmann::json out = nlohmann::json::array();
    auto add = [&](const std::string& label, std::vector<std::string> keys, double min, double max, double step,
                   double value) {
        out.push_back({{"label", label},
                       {"keys", std::move(keys)},
                       {"min", min},
                       {"max", max},
                       {"step", step},
                       {"value", value}});
    };
    std::vector<std::string> young, low, high;
    bool limits = false;
    for (const FingerSpec& f : scene.spec.fingers) {
        young.push_back("finger." + f.name + ".material.young_kPa");
        limits |= f.has_limits;
    }
    add("Young's modulus, kPa", young, 5, 200, 1, scene.spec.fingers[0].young_modulus / 1e3);
    if (limits) {
        add("stretch at least", {"limits.low"}, 0.3, 0.98, 0.01, scene.spec.fingers[0].limit_low);
        add("stretch at most", {"limits.high"}, 1.02, 2, 0.01, scene.spec.fingers[0].limit_high);
    }
    for (const ObjectSpec& o : scene.spec.objects)
        if (o.friction > 0) add("friction, " + o.name, {"object." + o.name + ".friction"}, 0, 2, 0.05, o.friction);
    std::vector<std::string> methods;
    for (const ThimbleSpec& t : scene.spec.thimbles)
        methods.push_back("finger." + scene.spec.fingers[std::size_t(t.finger)].name + ".device.method");
    const std::vector<std::string> choices{"constrained", "unconstrained", "plane", "force"};  // as MatchingMethod
    if (!methods.empty())
        out.push_back({{"label", "matching method"},
                       {"keys", methods},
                       {"choices", choices},
                       {"value", choices[std::size_t(scene.spec.thimbles[0].method)]}});
    add("Newton iterations", {"solver.newton_iterations"}, 1, 20, 1, std::min(20, scene.spec.solver.newton_iterations));
    return out;
}

/// Whether one of the lines sets a key, here `key = ...` or there `table.key=...`; comments apart.
bool sets_key(const std::string& text, const std::string& key) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
        line.resize(std::min(line.size(), line.find('#')));
        for (std::size_t at = line.find(key); at != std::string::npos; at = line.find(key, at + 1)) {
            const std::size_t after = line.find_first_not_of(" \t", at + key.size());
            const bool begins =
                at == 0 || !(std::isalnum(static_cast<unsigned char>(line[at - 1])) || line[at - 1] == '_');
            if (begins && after != std::string::npos && line[after] == '=') return true;
        }
    }
    return false;
}

/// Whether a scene or an override says itself which preset runs: a preset or a deadline is set.
bool names_preset(const Scene& scene, const std::vector<std::string>& overrides) {
    std::string text = read_file(scene.file);
    for (const std::string& o : overrides) text += "\n" + o;
    if (scene.deadline > 0) return true;
    return sets_key(text, "preset") || sets_key(text, "deadline_ms") || sets_key(text, "static");
}

/// How far from real time a run is: simulated over passed time, smoothed over about two seconds.
struct Pace {
    using Clock = std::chrono::steady_clock;
    Clock::time_point since = Clock::now();
    double simulated = 0;  ///< since then [s]
    double factor = 0;     ///< 0: not known yet
    void begin() { since = Clock::now(), simulated = 0; }
    /// True, with a new factor, every half second.
    bool look() {
        const double passed = std::chrono::duration<double>(Clock::now() - since).count();
        if (passed < 0.5) return false;
        const double now = simulated / passed;
        factor = factor == 0 ? now : factor + 0.25 * (now - factor);
        begin();
        return true;
    }
};

/// A scene that runs again and again, at some speed, until it is told otherwise.
struct LiveRun {
    const ViewArguments& arguments;
    ViewServer& server;
    std::shared_ptr<LiveHands> hands{};  ///< null: fingers follow the scene's recording
    std::vector<std::string> overrides = arguments.overrides;
    std::unique_ptr<Simulation> simulation{};
    std::unique_ptr<RenderedPadsThread> rendered_pads{};
    std::unique_ptr<DrawnHands> drawn_hands{};
    std::string holds_time{};  ///< the override by which presets step down to hold real time; empty: none
    Pace pace{};
    bool paused = false;
    int single_steps = 0;
    double speed = 1;

    /// Loads the scene, and begins it anew; or, where it can, goes on where the run is.
    void start(bool go_on = false) {
        std::optional<EndsAtOnce> loading;  // of the first one, before anything is armed or recorded
        if (!simulation) loading.emplace();
        Scene scene = load_scene(arguments.scene, overrides);
        if (!simulation) {
            print_warnings(scene);
            // Real thimbles get what the scene says; a picture is to keep up with the clock.
            if (!arguments.arm && !names_preset(scene, overrides)) {
                scene.deadline = scene.spec.solver.dt;
                holds_time = "solver.deadline_ms=" + std::to_string(1e3 * scene.deadline);
                overrides.push_back(holds_time);
            }
        }
        nlohmann::json data{{"live", true},
                            {"about", "live"},
                            {"summary", ""},
                            {"scene", read_file(scene.file)},
                            {"settings", settings_of(scene)}};
        // Rows are for results, which a live run has none of: without end, they would fill the memory.
        auto fresh = std::make_unique<Simulation>(make_simulation(std::move(scene), arguments.threads, false));
        loading.reset();
        // A recorded run has one scene file.
        const bool goes_on =
            go_on && simulation && !(record && data["scene"] != text) && carry_over(*simulation, *fresh);
        // Nobody but a person arms: thimbles stay armed where they stay the same, faults and all, and are disarmed
        // else.
        const bool stays_armed = goes_on || (simulation && keep_armed(*simulation, *fresh));
        if (!stays_armed && simulation) disarm(*simulation);
        // A run that begins again begins with the preset that held real time.
        if (!goes_on && simulation && simulation->governor && fresh->governor)
            fresh->governor->preset = std::min(simulation->governor->preset, fresh->governor->highest);
        pace.begin();
        simulation = std::move(fresh);  // the old one's controllers are free again
        rendered_pads = std::make_unique<RenderedPadsThread>(*simulation);
        drawn_hands = std::make_unique<DrawnHands>(*simulation);
        text = data["scene"];
        if (!goes_on) open_outside();
        if (goes_on && record) record->change_settings(*simulation, overrides);
        data["model"] = page_model(*simulation);
        if (!page_data.is_null() && page_data["model"] == data["model"]) return;  // sliders know their own place
        page_data = std::move(data);
        server.set_page(page_with(page_data));
    }
    std::string text{};  ///< of the scene file, as it was read last
    /// Hands, the recording and controllers of a run that begins.
    void open_outside() {
        const std::string source = arguments.tracker.empty() ? simulation->scene.tracker : arguments.tracker;
        if (!source.empty()) {
            if (!hands) hands = std::make_shared<LiveHands>(source, arguments.any_address);
            follow_live(*simulation, hands);
        }
        if (record) {
            record->finish();
            record->begin(*simulation, overrides);
        } else if (!arguments.record.empty()) {
            record = std::make_unique<RunWriter>(arguments.record, *simulation, overrides);
        }
        if (arguments.arm && !has_run) arm();
        has_run = true;
    }
    void arm() {
        palpate::arm(*simulation, {!arguments.no_watchdog, "."});
        if (!arguments.hold.empty() && !dead_man) dead_man = make_dead_man(arguments.hold);
        look_at_dead_man();
    }
    void look_at_dead_man() {
        if (!dead_man || !simulation->hardware) return;
        obey_dead_man(*dead_man, *simulation);
        if (const std::string news = take_news(*dead_man); !news.empty()) std::fprintf(stderr, "%s\n", news.c_str());
    }
    /// A person asks for it: faults are cleared, and what was disarmed since is armed again.
    void rearm() {
        if (arguments.arm && !simulation->hardware) {
            try {
                arm();
            } catch (const InputError& error) { tell_error(error); }
        }
        for (auto& loop : simulation->loops) loop->rearm_asked = true;
    }
    void tell_error(const InputError& error) {
        std::string all;
        for (const auto& message : error.messages) all += message + "\n";
        server.tell({{"error", all}});
    }
    bool has_run = false;
    std::unique_ptr<DeadMan> dead_man{};
    nlohmann::json page_data{};
    std::unique_ptr<RunWriter> record{};
    std::unique_ptr<Stream> stream{};

    bool told_failure = false;

    /// One step, recorded if asked for: a recording holds all runs, one after the other.
    void advance_live() {
        Simulation& s = *simulation;
        StepInputs inputs = next_inputs(s);
        if (stream) stream->command(s, inputs);
        advance(s, inputs);
        pace.simulated += s.world.solver.dt;
        if (stream) stream->tell(s);
        if (record) record->record(inputs, s);
        if (record && !record->failure().empty() && !told_failure) {
            told_failure = true;
            std::fprintf(stderr, "%s; the recording ends there\n", record->failure().c_str());
        }
    }

    std::string silent{};
    /// Tells the page whose trackers are silent, so that their thimbles are led to rest, when that changes.
    void tell_silence() {
        std::string now;
        const Simulation& s = *simulation;
        for (std::size_t t = 0; t < s.loops.size(); ++t)
            if (s.world.device_links[t].retreat > 0)
                now +=
                    (now.empty() ? "" : ", ") + s.scene.spec.fingers[std::size_t(s.scene.spec.thimbles[t].finger)].name;
        if (now != silent) server.tell_all({{"silent", now}});
        silent = now;
    }

    DoubtTeller doubts{};
    /// Says what is likely wrong with the hands that come, once each.
    void tell_doubts() {
        if (!hands) return;
        for (const std::string& text : doubts.news(hands->mailbox))
            std::fprintf(stderr, "warning: live hand: %s\n", text.c_str());
    }

    std::string preset_now() const {
        const Simulation& s = *simulation;
        return preset_names()[std::size_t(s.governor ? s.governor->preset : s.scene.preset)];
    }
    /// Tells the page which preset runs, and how fast.
    void tell_pace() {
        if (paused) pace.begin();
        if (!pace.look()) return;
        server.tell_all({{"preset", preset_now()}, {"pace", pace.factor}, {"holds_time", bool(simulation->governor)}});
    }

    /// Tells the page which thimbles are in fault, when that changes.
    std::string faults{};
    void tell_faults() {
        if (!arguments.arm) return;
        std::string now;
        for (std::size_t t = 0; t < simulation->loops.size(); ++t)
            if (!simulation->hardware || newest_report(*simulation->hardware, int(t)).status.mode == ThimbleMode::fault)
                now += (now.empty() ? "" : ", ") +
                       simulation->scene.spec.fingers[std::size_t(simulation->scene.spec.thimbles[t].finger)].name;
        if (now != faults) server.tell_all({{"faults", now}});
        faults = now;
    }

    /// Takes overrides over if the scene still loads with them, and says what is wrong if not.
    void set(const nlohmann::json& keys) {
        const std::vector<std::string> before = overrides;
        for (const auto& key : keys) {
            if (!key.is_string()) continue;
            const std::string wanted = key.get<std::string>(), name = wanted.substr(0, wanted.find('=') + 1);
            std::erase_if(overrides, [&](const std::string& o) { return !name.empty() && o.starts_with(name); });
            overrides.push_back(wanted);
            // Who sets the solver's settings means these, not a cheaper preset's.
            if (name.starts_with("solver.")) std::erase(overrides, holds_time);
        }
        try {
            start(true);
            server.tell({{"error", ""}});
        } catch (const InputError& error) {
            overrides = before;
            tell_error(error);
        }
    }
    /// Nobody moves a thimble from afar unless that was asked for: what arms or re-arms comes from this machine.
    bool may_obey(const ViewCommand& command) {
        const auto& what = command.what;
        const bool arms = arguments.arm && (what.contains("rearm") || what.contains("restart") || what.contains("set"));
        if (!arms || command.local || arguments.remote_arm) return true;
        server.tell({{"error", "thimbles are armed: that takes someone at their machine, or view --remote-arm"}});
        return false;
    }
    void obey(const nlohmann::json& command) {
        if (command.contains("pause") && command["pause"].is_boolean()) paused = command["pause"];
        if (command.contains("step")) ++single_steps;
        if (command.contains("restart")) start();
        if (command.contains("rearm")) rearm();
        if (command.contains("speed") && command["speed"].is_number())
            speed = std::clamp(command["speed"].get<double>(), 0.01, 10.0);
        if (command.contains("set") && command["set"].is_array()) set(command["set"]);
    }
};

int view_scene(const ViewArguments& a, const std::atomic<bool>& stop) {
    refuse_to_replace("--record", a.record, Output::recording);
    refuse_to_hold_unarmed(a.hold, a.arm);
    using Clock = std::chrono::steady_clock;
    if (a.stream.target == "-")
        throw InputError(
            "--stream -: view prints its address on standard output; expected udp:HOST:PORT or websocket:PORT");
    ViewServer server(a.port, a.any_address);
    LiveRun live{a, server};
    if (!a.stream.target.empty()) {
        StreamSettings settings = a.stream;
        settings.any_address = a.any_address, settings.takes_settings = !a.arm;
        live.stream = std::make_unique<Stream>(settings);
        tell_address(*live.stream);
    }
    live.start();
    const std::string preset = live.preset_now();
    if (live.simulation->governor)
        std::printf("preset %s, and a cheaper one while its steps take longer than real time\n", preset.c_str());
    else
        std::printf("preset %s\n", preset.c_str());
    if (live.hands) std::printf("hands are expected from %s\n", live.hands->source->about().c_str());
    std::printf("open %s   (Ctrl-C ends)\n", server.url().c_str());
    if (a.any_address)
        std::printf(
            "from other machines, put this one's address in place of 127.0.0.1; the token lets in whoever has it\n");
    std::fflush(stdout);
    std::vector<std::uint8_t> frame;
    SinceFrame since;
    auto due = Clock::now(), next_frame = due;
    while (!stop) {
        for (const ViewCommand& command : server.take_commands())
            if (live.may_obey(command)) live.obey(command.what);
        if (live.stream)
            if (const auto settings = live.stream->take_settings(); !settings.empty()) live.set(settings);
        Simulation& s = *live.simulation;
        live.look_at_dead_man();
        const bool single = live.single_steps > 0;
        if (!(live.paused || (live.stream && live.stream->paused())) || single) {
            if (!live.hands && s.world.time >= s.scene.duration - 0.5 * s.world.solver.dt) live.start();
            live.advance_live();
            note_step(since, *live.simulation);
            live.single_steps = single ? live.single_steps - 1 : 0;
        }
        const auto now = Clock::now();
        if (now >= next_frame || single) {
            frame.clear();
            append_frame(frame, *live.simulation, live.rendered_pads->ask(*live.simulation), *live.drawn_hands, since);
            live.tell_faults();
            live.tell_silence();
            live.tell_doubts();
            live.tell_pace();
            server.publish(frame);
            since = {};
            next_frame = now + std::chrono::milliseconds(33);
        }
        due += std::chrono::duration_cast<Clock::duration>(
            std::chrono::duration<double>(live.simulation->world.solver.dt / live.speed));
        if (due < now - std::chrono::milliseconds(200)) due = now;  // too slow for real time: do not race to catch up
        std::this_thread::sleep_until(std::min(due, now + std::chrono::milliseconds(50)));
        if (live.paused) due = Clock::now() + std::chrono::milliseconds(10);
    }
    if (live.record) live.record->finish();
    bool at_rest = true;
    if (live.simulation->hardware) {
        disarm(*live.simulation);
        std::printf("%s%s", hardware_report(*live.simulation).c_str(), rest_report(*live.simulation, at_rest).c_str());
        if (live.dead_man) std::printf("%s", hold_report(*live.dead_man).c_str());
    }
    if (live.hands) std::printf("%s\n", to_text(live.hands->mailbox.counts()).c_str());
    return live.told_failure ? 1 : 0;
}

}  // namespace

Action add_view_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("view", "run a scene in real time and watch it in a browser");
    auto a = std::make_shared<ViewArguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.option("--port", a->port, "port of the page (default: 8420; 0 = any free one)").range(0, 65535);
    c.option("--tracker", a->tracker,
             "fingers that follow a hand follow a live one: udp:PORT, websocket:PORT, openxr, ultraleap[:HOST:PORT]");
    add_stream_options(c, a->stream);
    c.option("--record", a->record,
             "record inputs and outcome of every step of every run; `palpate replay` runs them again");
    c.flag("--arm", a->arm, "drive real thimbles; without it nothing moves");
    c.option("--hold", a->hold,
             "with --arm: thimbles move only while this is held: key, joystick:/dev/input/js0[:BUTTON], "
             "heartbeat:PORT (UDP datagrams \"1\" to this machine, ten a second; \"0\", another or none lets go)");
    c.flag("--no-watchdog", a->no_watchdog, "drive controllers that would hold their force if palpate were killed");
    c.flag("--any-address", a->any_address,
           "let other machines that know the token watch, steer and send hands, too (default: this one only)");
    c.flag("--remote-arm", a->remote_arm, "let other machines re-arm thimbles, too (default: this one only)");
    return [a, &stop] { return view_scene(*a, stop); };
}

}  // namespace palpate
