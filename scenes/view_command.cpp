// `palpate view`: runs a scene in real time and shows it in a browser.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <thread>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/carry_over.h"
#include "scenes/commands.h"
#include "scenes/hardware.h"
#include "scenes/recording/run_file.h"
#include "scenes/viewer/report.h"
#include "scenes/viewer/server.h"

namespace palpate {

namespace {

struct ViewArguments {
    std::string scene;
    std::vector<std::string> overrides;
    int threads = 0, port = 8420;
    std::string tracker, record;
    bool any_address = false, arm = false, no_watchdog = false;
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

/// A scene that runs again and again, at some speed, until it is told otherwise.
struct LiveRun {
    const ViewArguments& arguments;
    ViewServer& server;
    std::shared_ptr<LiveHands> hands{};  ///< null: fingers follow the scene's recording
    std::vector<std::string> overrides = arguments.overrides;
    std::unique_ptr<Simulation> simulation{};
    std::unique_ptr<FeltThread> felt{};
    bool paused = false;
    int single_steps = 0;
    double speed = 1;

    /// Loads the scene, and begins it anew; or, where it can, goes on where the run is.
    void start(bool go_on = false) {
        Scene scene = load_scene(arguments.scene, overrides);
        nlohmann::json data{{"live", true},
                            {"about", "live"},
                            {"summary", ""},
                            {"scene", read_file(scene.file)},
                            {"settings", settings_of(scene)}};
        auto fresh = std::make_unique<Simulation>(make_simulation(std::move(scene), arguments.threads));
        // A recorded run has one set of settings.
        const bool goes_on = go_on && simulation && !record && carry_over(*simulation, *fresh);
        if (!goes_on && simulation) disarm(*simulation);
        simulation = std::move(fresh);  // the old one's controllers are free again
        felt = std::make_unique<FeltThread>(*simulation);
        if (!goes_on) open_outside();
        data["stage"] = stage_of(*simulation);
        if (!page_data.is_null() && page_data["stage"] == data["stage"]) return;  // sliders know their own place
        page_data = std::move(data);
        server.set_page(page_with(page_data));
    }
    /// Hands, the recording and controllers of a run that begins.
    void open_outside() {
        const std::string source = arguments.tracker.empty() ? simulation->scene.tracker : arguments.tracker;
        if (!source.empty()) {
            if (!hands) hands = std::make_shared<LiveHands>(source, arguments.any_address);
            follow_live(*simulation, hands);
        }
        if (!arguments.record.empty()) {
            record.reset();
            record = std::make_unique<RunWriter>(arguments.record, *simulation, overrides);
        }
        if (arguments.arm) palpate::arm(*simulation, {!arguments.no_watchdog, "."});
    }
    nlohmann::json page_data{};
    std::unique_ptr<RunWriter> record{};

    /// One step, recorded if asked for: a recording holds the run from its last start.
    void advance_live() {
        Simulation& s = *simulation;
        const StepInputs inputs = next_inputs(s);
        advance(s, inputs);
        if (record) record->record(inputs, s);
        // Rows are for results, which a live run has none of: without end, they would fill the memory.
        for (Series& series : s.finger_series) series.values.clear();
        s.step_series.values.clear();
    }

    /// Tells the page which thimbles are in fault, when that changes.
    std::string faults{};
    void tell_faults() {
        if (!simulation->hardware) return;
        std::string now;
        for (std::size_t t = 0; t < simulation->loops.size(); ++t)
            if (newest_report(*simulation->hardware, int(t)).status.mode == ThimbleMode::fault)
                now += (now.empty() ? "" : ", ") +
                       simulation->scene.spec.fingers[std::size_t(simulation->scene.spec.thimbles[t].finger)].name;
        if (now != faults) server.tell({{"faults", now}});
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
        }
        try {
            start(true);
            server.tell({{"error", ""}});
        } catch (const InputError& error) {
            overrides = before;
            std::string all;
            for (const auto& message : error.messages) all += message + "\n";
            server.tell({{"error", all}});
        }
    }
    void obey(const nlohmann::json& command) {
        if (command.contains("pause") && command["pause"].is_boolean()) paused = command["pause"];
        if (command.contains("step")) ++single_steps;
        if (command.contains("restart")) start();
        if (command.contains("rearm"))
            for (auto& loop : simulation->loops) loop->rearm_asked = true;
        if (command.contains("speed") && command["speed"].is_number())
            speed = std::clamp(command["speed"].get<double>(), 0.01, 10.0);
        if (command.contains("set") && command["set"].is_array()) set(command["set"]);
    }
};

int view_scene(const ViewArguments& a, const std::atomic<bool>& stop) {
    using Clock = std::chrono::steady_clock;
    ViewServer server(a.port, a.any_address);
    LiveRun live{a, server};
    live.start();
    if (live.hands) std::printf("hands are expected from %s\n", live.hands->source->about().c_str());
    std::printf("open http://127.0.0.1:%d/   (Ctrl-C ends)\n", server.port());
    std::fflush(stdout);
    std::vector<std::uint8_t> frame;
    double longest_us = 0;
    auto due = Clock::now(), next_frame = due;
    while (!stop) {
        for (const auto& command : server.take_commands()) live.obey(command);
        Simulation& s = *live.simulation;
        const bool single = live.single_steps > 0;
        if (!live.paused || single) {
            if (!live.hands && s.world.time >= s.scene.duration - 0.5 * s.world.solver.dt) live.start();
            live.advance_live();
            longest_us = std::max(longest_us, 1e6 * live.simulation->world.profile.total());
            live.single_steps = single ? live.single_steps - 1 : 0;
        }
        const auto now = Clock::now();
        if (now >= next_frame || single) {
            frame.clear();
            append_frame(frame, *live.simulation, live.felt->ask(*live.simulation), longest_us);
            live.tell_faults();
            server.publish(frame);
            longest_us = 0;
            next_frame = now + std::chrono::milliseconds(33);
        }
        due += std::chrono::duration_cast<Clock::duration>(
            std::chrono::duration<double>(live.simulation->world.solver.dt / live.speed));
        if (due < now - std::chrono::milliseconds(200)) due = now;  // too slow for real time: do not race to catch up
        std::this_thread::sleep_until(std::min(due, now + std::chrono::milliseconds(50)));
        if (live.paused) due = Clock::now() + std::chrono::milliseconds(10);
    }
    if (a.arm) {
        disarm(*live.simulation);
        std::printf("%s", hardware_report(*live.simulation).c_str());
    }
    if (live.hands) std::printf("%s\n", to_text(live.hands->mailbox.counts()).c_str());
    return 0;
}

}  // namespace

Action add_view_command(CLI::App& program, const std::atomic<bool>& stop) {
    auto* c = program.add_subcommand("view", "run a scene in real time and watch it in a browser");
    auto a = std::make_shared<ViewArguments>();
    c->add_option("scene", a->scene, "scene file (.toml)")->required();
    c->add_option("--set", a->overrides, "override a value of the scene")->take_all()->allow_extra_args(false);
    c->add_option("--threads", a->threads, "threads (default: all cores)")->check(CLI::Range(1, 1024));
    c->add_option("--port", a->port, "port of the page (default: 8420; 0 = any free one)")->check(CLI::Range(0, 65535));
    c->add_option("--tracker", a->tracker,
                  "fingers that follow a hand follow a live one: udp:PORT, websocket:PORT, ultraleap[:HOST:PORT]");
    c->add_option("--record", a->record,
                  "record inputs and outcome of every step since the last start; `palpate replay` runs it again");
    c->add_flag("--arm", a->arm, "drive real thimbles; without it nothing moves");
    c->add_flag("--no-watchdog", a->no_watchdog,
                "drive controllers that would hold their force if palpate were killed");
    c->add_flag("--any-address", a->any_address,
                "let other machines watch, steer and send hands, too (default: this one only)");
    return [a, &stop] { return view_scene(*a, stop); };
}

}  // namespace palpate
