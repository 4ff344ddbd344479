// `palpate boards`, `palpate doctor`, `palpate home`: what controllers there are, what is wrong with them, and the way
// back to the rest pose.

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "devices/drivers/maestro.h"
#include "devices/drivers/serial_line.h"
#include "meshes/input_error.h"
#include "scenes/load/key.h"
#include "scenes/load/load_devices.h"
#include "scenes/program/commands.h"
#include "scenes/run/hardware.h"

namespace palpate {

namespace {

/// Fingers of a scene that a board drives.
std::vector<std::string> users_of(const Scene& scene, const maestro::BoardInfo& board, std::size_t boards) {
    std::vector<std::string> fingers;
    for (std::size_t t = 0; t < scene.drivers.size(); ++t) {
        const DriverSpec& d = scene.drivers[t];
        if (d.driver == "maestro" && (d.serial == board.serial || (d.serial.empty() && boards == 1)))
            fingers.push_back(scene.spec.fingers[std::size_t(scene.spec.thimbles[t].finger)].name);
    }
    return fingers;
}

int list_devices(const std::string& file, bool json) {
    const auto boards = maestro::find_boards();
    std::optional<Scene> scene;
    if (!file.empty()) scene = load_scene(file);
    nlohmann::json out = nlohmann::json::array();
    for (const auto& b : boards) {
        const auto users = scene ? users_of(*scene, b, boards.size()) : std::vector<std::string>{};
        out.push_back({{"kind", "maestro"},
                       {"product", b.product},
                       {"serial", b.serial},
                       {"firmware", b.firmware},
                       {"channels", b.channels},
                       {"bus", b.bus},
                       {"address", b.address},
                       {"bootloader", b.channels == 0},
                       {"problem", b.problem},
                       {"watchdog_ms", b.watchdog_ms},
                       {"errors", b.errors},
                       {"fingers", users}});
        if (json) continue;
        std::printf("%s  serial %s  firmware %s  bus %d address %d\n", b.product.c_str(),
                    b.serial.empty() ? "?" : b.serial.c_str(), b.firmware.c_str(), b.bus, b.address);
        if (!b.problem.empty())
            std::printf("  %s (see `palpate doctor`)\n", b.problem.c_str());
        else if (b.channels > 0)
            std::printf("  %d channels, watchdog %s%s%s\n", b.channels,
                        b.watchdog_ms ? (std::to_string(b.watchdog_ms) + " ms").c_str() : "off",
                        b.errors.empty() ? "" : ", errors: ", b.errors.c_str());
        if (!users.empty()) std::printf("  drives %s\n", joined(users).c_str());
    }
    if (json)
        std::printf("%s\n", out.dump(2).c_str());
    else if (boards.empty())
        std::printf("no servo controller on USB\n");
    return 0;
}

/// One finding: what is wrong, and how to mend it.
void say(int& wrong, const std::string& what, const std::string& remedy) {
    std::printf("%d. %s\n   %s\n", ++wrong, what.c_str(), remedy.c_str());
}

/// `used`: channels that the scene drives.
void examine_board(const maestro::BoardInfo& b, const std::vector<int>& used, bool mend, int& wrong) {
    const std::string name = b.product + (b.serial.empty() ? "" : " " + b.serial);
    if (b.denied)
        return say(wrong, name + ": no permission to open it",
                   "echo 'SUBSYSTEM==\"usb\", ATTR{idVendor}==\"1ffb\", MODE=\"0666\"' | sudo tee "
                   "/etc/udev/rules.d/60-maestro.rules && sudo udevadm control --reload && sudo udevadm trigger");
    if (!b.problem.empty()) return say(wrong, name + ": " + b.problem, "unplug it, and plug it in again");
    if (b.channels == 0)
        return say(wrong,
                   name + " at bus " + std::to_string(b.bus) + " address " + std::to_string(b.address) +
                       ": it is never driven in this mode",
                   "unplug it, and plug it in again; if it stays so, load its firmware with Pololu's Control Center");
    if (!b.errors.empty()) say(wrong, name + ": errors: " + b.errors, "arming clears them; see that they stay away");
    std::map<int, int> homes;
    for (std::size_t c = 0; c < b.servos.size(); ++c)
        if (std::find(used.begin(), used.end(), int(c)) != used.end()) homes[int(c)] = b.servos[c].home;
    const std::string problem = maestro::watchdog_problem(b.watchdog_ms, homes);
    if (problem.empty()) return;
    const std::string failed = mend ? maestro::set_watchdog(b.serial, maestro::usual_watchdog_ms) : "";
    if (!mend)
        say(wrong, name + ": " + problem + " if palpate were killed",
            "palpate doctor --mend   (sets it to 200 ms, and homes that are \"ignore\" to \"off\")");
    else if (failed.empty())
        std::printf("mended: %s: watchdog set to %d ms\n", name.c_str(), maestro::usual_watchdog_ms);
    else
        say(wrong, name + ": its watchdog could not be set: " + failed, "set it in Pololu's Control Center");
}

/// What the scene asks of a board that the board does not allow.
void examine_use(const Scene& scene, const std::vector<maestro::BoardInfo>& boards, int& wrong) {
    for (std::size_t t = 0; t < scene.drivers.size(); ++t) {
        const DriverSpec& d = scene.drivers[t];
        if (d.driver != "maestro") continue;
        const std::string finger = scene.spec.fingers[std::size_t(scene.spec.thimbles[t].finger)].name;
        const maestro::BoardInfo* board = nullptr;
        int fitting = 0;
        for (const auto& b : boards)
            if (b.channels > 0 && (d.serial.empty() || b.serial == d.serial)) board = &b, ++fitting;
        if (fitting == 0) {
            say(wrong, finger + ": its board" + (d.serial.empty() ? "" : " " + d.serial) + " is not on USB",
                "plug it in; `palpate boards` lists what is there");
            continue;
        }
        if (fitting > 1) {
            say(wrong, finger + ": " + std::to_string(fitting) + " boards are on USB, and the scene does not say which",
                "device = { serial = \"...\", ... }; `palpate boards` lists the serial numbers");
            continue;
        }
        for (std::size_t j = 0; j < d.channels.size(); ++j) {
            const int c = d.channels[j];
            const std::string servo = finger + ": channel " + std::to_string(c);
            if (c >= board->channels) {
                say(wrong, servo + " is not on a board of " + std::to_string(board->channels), "change channels");
                continue;
            }
            if (std::size_t(c) >= board->servos.size()) continue;
            const auto& limits = board->servos[std::size_t(c)];
            const DeviceModel& m = scene.spec.thimbles[t].model;
            const auto at = [&](double q) { return d.servos[j].zero + d.servos[j].units_per_rad * q; };
            const double ends[] = {at(m.joint_min[std::ptrdiff_t(j)]), at(m.joint_max[std::ptrdiff_t(j)])};
            char text[200];
            const double low = std::min(ends[0], ends[1]), high = std::max(ends[0], ends[1]);
            if (low < limits.min_us || high > limits.max_us) {
                std::snprintf(text, sizeof text, "%s: the joint needs %.0f to %.0f us, the board allows %.0f to %.0f",
                              servo.c_str(), low, high, limits.min_us, limits.max_us);
                say(wrong, text, "widen the channel's range in Pololu's Control Center, or narrow the joint's limits");
            }
        }
    }
}

/// What a scene asks of controllers on serial ports, as far as can be seen without a word to them.
std::size_t examine_ports(const Scene& scene, int& wrong) {
    std::map<std::string, std::string> ports;  // and who speaks there
    for (const DriverSpec& d : scene.drivers)
        if (!d.port.empty()) ports[d.port] = d.driver;
    for (const auto& [port, driver] : ports) {
        try {
            SerialLine line;
            line.claim(port);
        } catch (const std::exception& problem) {
            const bool denied = ::access(port.c_str(), R_OK | W_OK) != 0 && errno == EACCES;
            say(wrong, problem.what(),
                denied
                    ? "sudo usermod -aG dialout $USER, then log in again"
                    : "plug its controller in, say its port (ls /dev/serial/by-id), or end the program that uses it");
            continue;
        }
        std::printf(
            "%s: a serial port, and free. Not asked, for only arming asks it: who is there (%s is expected), "
            "its watchdog, its own range, and where its servos stand\n",
            port.c_str(), driver.c_str());
    }
    return ports.size();
}

void examine_calibrations(const Scene& scene, int& wrong) {
    for (std::size_t t = 0; t < scene.drivers.size(); ++t) {
        const DriverSpec& d = scene.drivers[t];
        if (controller_of(d).empty()) continue;
        const std::string finger = scene.spec.fingers[std::size_t(scene.spec.thimbles[t].finger)].name;
        if (d.driver != "maestro-dry" && !d.calibrated)
            say(wrong, finger + ": its servos are not calibrated, and will not be armed",
                "palpate calibrate-thimble " + scene.file.string() + " --finger " + finger + " --out " + finger +
                    ".toml, and calibration = \"" + finger + ".toml\" in its device");
        for (std::size_t j = 0; j < d.servos.size(); ++j)
            if (const std::string lost = lost_range(d, j, scene.spec.thimbles[t].model); !lost.empty())
                say(wrong, finger + ": " + lost, "calibrate it anew, or narrow the joint's limits");
    }
}

int examine(const std::string& file, bool mend) {
    std::optional<Scene> scene;
    if (!file.empty()) scene = load_scene(file);
    const auto boards = maestro::find_boards();
    int wrong = 0;
    for (const auto& b : boards) {
        std::vector<int> used;
        for (std::size_t t = 0; scene && t < scene->drivers.size(); ++t)
            if (const DriverSpec& d = scene->drivers[t];
                d.driver == "maestro" && (d.serial.empty() || d.serial == b.serial))
                used.insert(used.end(), d.channels.begin(), d.channels.end());
        examine_board(b, used, mend, wrong);
    }
    std::size_t usable = 0, unasked = 0;
    for (const auto& b : boards) usable += b.channels > 0;
    if (scene) {
        examine_use(*scene, boards, wrong);
        usable += unasked = examine_ports(*scene, wrong);
        examine_calibrations(*scene, wrong);
        if (!drives_hardware(*scene)) std::printf("the scene's thimbles are simulated: it needs no controller\n");
    }
    if (boards.empty() && wrong == 0 && !scene)
        say(wrong, "no servo controller on USB", "plug one in, with its own supply");
    if (wrong == 0)
        std::printf("%zu controller%s: nothing wrong%s\n", usable, usable == 1 ? "" : "s",
                    unasked ? ", as far as was asked" : "");
    return wrong ? 1 : 0;
}

/// How well this machine keeps a thimble's schedule, without any controller.
int time_schedule(double seconds) {
    ThimbleLoop loop;
    const DeviceModel model = find_kind("chinello-3rrs")->defaults();
    initialise(loop, model, {}, make_simulated_driver({}, model.kind->joints(model, model.rest).q));
    DeviceThread thread({&loop});
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
    thread.stop();
    const LatencyHistogram& late = thread.lateness();
    std::printf("%lld updates in %.0f s, %lld missed; %.2f %% within 2 ms of their time\n",
                (long long)loop.status.ticks, seconds, (long long)loop.status.misses, 100 * late.share_within(0.002));
    std::int64_t before = 0;
    for (double ms : {0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 1e4}) {
        const auto within = std::int64_t(std::llround(late.share_within(1e-3 * ms) * double(late.count())));
        std::printf(
            "  %s %7.2f ms late  %6lld  %s\n", ms < 1e3 ? "up to" : "later", ms < 1e3 ? ms : 10.0,
            (long long)(within - before),
            std::string(std::size_t(60.0 * double(within - before) / double(std::max<std::int64_t>(1, late.count()))),
                        '#')
                .c_str());
        before = within;
    }
    return 0;
}

int go_home(const std::string& file, const std::vector<std::string>& overrides, bool no_watchdog) {
    Simulation s = make_simulation(load_scene(file, overrides), 1);
    if (!drives_hardware(s.scene)) throw InputError(file + ": no finger has a thimble with a driver");
    arm(s, {!no_watchdog, "."});
    disarm(s);
    std::printf("%s", hardware_report(s).c_str());
    bool all = true;
    const std::string rest = rest_report(s, all);
    std::fprintf(all ? stdout : stderr, "%s", rest.c_str());
    return all ? 0 : 1;
}

}  // namespace

Action add_boards_command(const Command& program) {
    const Command c = program.subcommand("boards", "list servo controllers on USB").formerly("devices");
    auto scene = std::make_shared<std::string>();
    auto json = std::make_shared<bool>(false);
    c.scene("scene", *scene, "say which of this scene's fingers they drive");
    auto timing = std::make_shared<double>(0);
    c.flag("--json", *json, "print JSON");
    c.option("--timing", *timing, "instead: for so many seconds, how well this machine keeps a thimble's schedule")
        .range(0.1, 3600.0);
    return [scene, json, timing] { return *timing > 0 ? time_schedule(*timing) : list_devices(*scene, *json); };
}

Action add_doctor_command(const Command& program) {
    const Command c = program.subcommand("doctor", "say what is wrong with controllers, and how to mend it");
    auto scene = std::make_shared<std::string>();
    auto mend = std::make_shared<bool>(false);
    c.scene("scene", *scene, "check against this scene, too");
    c.flag("--mend", *mend, "set watchdogs that are off to 200 ms");
    return [scene, mend] { return examine(*scene, *mend); };
}

Action add_home_command(const Command& program) {
    const Command c = program.subcommand("home", "bring a scene's thimbles to their rest pose");
    struct Arguments {
        std::string scene;
        std::vector<std::string> overrides;
        bool no_watchdog = false;
    };
    auto a = std::make_shared<Arguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.flag("--no-watchdog", a->no_watchdog, "also with controllers whose watchdog is off");
    return [a] { return go_home(a->scene, a->overrides, a->no_watchdog); };
}

}  // namespace palpate
