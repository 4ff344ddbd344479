#include "scenes/program/live_view.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/load/presets.h"
#include "scenes/program/interruption.h"
#include "scenes/program/view_settings.h"
#include "scenes/run/carry_over.h"
#include "scenes/run/hardware.h"

namespace palpate {

void LiveView::start(bool go_on) {
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
    const std::string scene_text = read_file(scene.file);
    const nlohmann::json settings = settings_of(scene);
    // Rows are for results, which a live run has none of: without end, they would fill the memory.
    auto fresh = std::make_unique<Simulation>(make_simulation(std::move(scene), arguments.threads, false));
    loading.reset();
    // A recorded run has one scene file.
    const bool goes_on = go_on && simulation && !(record && scene_text != text) && carry_over(*simulation, *fresh);
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
    text = scene_text;
    if (!goes_on) open_outside();
    if (goes_on && record) record->change_settings(*simulation, overrides);
    const nlohmann::json page = page_model(*simulation);
    std::string now = page.dump();
    if (now == model) return;  // sliders know their own place
    model = std::move(now);
    server.set_page(live_page(text, settings, page));
}

void LiveView::open_outside() {
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

void LiveView::arm() {
    palpate::arm(*simulation, {!arguments.no_watchdog, "."});
    if (!arguments.hold.empty() && !dead_man) dead_man = make_dead_man(arguments.hold);
    look_at_dead_man();
}

void LiveView::look_at_dead_man() {
    if (!dead_man || !simulation->hardware) return;
    obey_dead_man(*dead_man, *simulation);
    if (const std::string news = take_news(*dead_man); !news.empty()) std::fprintf(stderr, "%s\n", news.c_str());
}

void LiveView::rearm() {
    if (arguments.arm && !simulation->hardware) {
        try {
            arm();
        } catch (const InputError& error) { tell_error(error); }
    }
    for (auto& loop : simulation->loops) loop->rearm_asked = true;
}

void LiveView::tell_error(const InputError& error) {
    std::string all;
    for (const auto& message : error.messages) all += message + "\n";
    server.tell(message_of("error", all));
}

void LiveView::advance_live() {
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

void LiveView::tell_silence() {
    std::string now;
    const Simulation& s = *simulation;
    for (std::size_t t = 0; t < s.loops.size(); ++t)
        if (s.world.device_links[t].retreat > 0)
            now += (now.empty() ? "" : ", ") + s.scene.spec.fingers[std::size_t(s.scene.spec.thimbles[t].finger)].name;
    if (now != silent) server.tell_all(message_of("silent", now));
    silent = now;
}

void LiveView::tell_doubts() {
    if (!hands) return;
    for (const std::string& text : doubts.news(hands->mailbox))
        std::fprintf(stderr, "warning: live hand: %s\n", text.c_str());
}

std::string LiveView::preset_now() const {
    const Simulation& s = *simulation;
    return preset_names()[std::size_t(s.governor ? s.governor->preset : s.scene.preset)];
}

void LiveView::tell_pace() {
    if (paused) pace.begin();
    if (!pace.look()) return;
    server.tell_all({{"preset", preset_now()}, {"pace", pace.factor}, {"holds_time", bool(simulation->governor)}});
}

void LiveView::tell_faults() {
    if (!arguments.arm) return;
    std::string now;
    for (std::size_t t = 0; t < simulation->loops.size(); ++t)
        if (!simulation->hardware || newest_report(*simulation->hardware, int(t)).status.mode == ThimbleMode::fault)
            now += (now.empty() ? "" : ", ") +
                   simulation->scene.spec.fingers[std::size_t(simulation->scene.spec.thimbles[t].finger)].name;
    if (now != faults) server.tell_all(message_of("faults", now));
    faults = now;
}

void LiveView::set(const std::vector<std::string>& all_wanted) {
    const std::vector<std::string> before = overrides;
    for (const std::string& wanted : all_wanted) {
        const std::string name = wanted.substr(0, wanted.find('=') + 1);
        std::erase_if(overrides, [&](const std::string& o) { return !name.empty() && o.starts_with(name); });
        overrides.push_back(wanted);
        // Who sets the solver's settings means these, not a cheaper preset's.
        if (name.starts_with("solver.")) std::erase(overrides, holds_time);
    }
    try {
        start(true);
        server.tell(message_of("error", ""));
    } catch (const InputError& error) {
        overrides = before;
        tell_error(error);
    }
}

bool LiveView::may_obey(const ViewCommand& command) {
    const auto& what = command.what;
    const bool arms = arguments.arm && (what.contains("rearm") || what.contains("restart") || what.contains("set"));
    if (!arms || command.local || arguments.remote_arm) return true;
    server.tell(message_of("error", "thimbles are armed: that takes someone at their machine, or view --remote-arm"));
    return false;
}

void LiveView::obey(const nlohmann::json& command) {
    if (command.contains("pause") && command["pause"].is_boolean()) paused = command["pause"];
    if (command.contains("step")) ++single_steps;
    if (command.contains("restart")) start();
    if (command.contains("rearm")) rearm();
    if (command.contains("speed") && command["speed"].is_number())
        speed = std::clamp(command["speed"].get<double>(), 0.01, 10.0);
    if (command.contains("set") && command["set"].is_array()) {
        std::vector<std::string> wanted;
        for (const auto& key : command["set"])
            if (key.is_string()) wanted.push_back(key.get<std::string>());
        set(wanted);
    }
}

}  // namespace palpate
