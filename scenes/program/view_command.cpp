// `palpate view`: runs a scene in real time and shows it in a browser.

#include <chrono>
#include <cstdio>
#include <thread>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/live_view.h"
#include "scenes/recording/outputs.h"
#include "scenes/run/hardware.h"

namespace palpate {

namespace {

int view_scene(const ViewArguments& a, const std::atomic<bool>& stop) {
    refuse_to_replace("--record", a.record, Output::recording);
    refuse_to_hold_unarmed(a.hold, a.arm);
    using Clock = std::chrono::steady_clock;
    if (a.stream.target == "-")
        throw InputError(
            "--stream -: view prints its address on standard output; expected udp:HOST:PORT or websocket:PORT");
    ViewServer server(a.port, a.any_address);
    LiveView live{a, server};
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
