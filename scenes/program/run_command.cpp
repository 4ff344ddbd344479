#include "scenes/program/commands.h"
#include "scenes/program/run_arguments.h"
#include "scenes/program/stream_options.h"

namespace palpate {

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
