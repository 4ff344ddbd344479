#include "scenes/run/hardware.h"

#include <algorithm>
#include <cstdio>
#include <thread>

#include "devices/drivers/maestro.h"
#include "devices/drivers/serial_bus.h"
#include "devices/drivers/text_link.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

/// Speed that a servo's own controller is told to keep [units/s].
double speed_limit(const Scene& scene, const ServoCalibration& servo) {
    return std::abs(servo.units_per_rad) * scene.loop.limits.velocity;
}

double acceleration_limit(const Scene& scene, const ServoCalibration& servo) {
    return std::abs(servo.units_per_rad) * scene.loop.limits.acceleration;
}

std::unique_ptr<BoardLink> make_board_link(const Scene& scene, const std::string& controller,
                                           const ArmSettings& settings) {
    maestro::LinkSettings usb;
    usb.need_watchdog = settings.need_watchdog;
    SerialBusSettings serial;
    serial.need_watchdog = settings.need_watchdog;
    std::string driver;
    for (std::size_t t = 0; t < scene.drivers.size(); ++t) {
        const DriverSpec& d = scene.drivers[t];
        if (controller_of(d) != controller) continue;
        driver = d.driver;
        if (scene.spec.thimbles[t].force_mode)
            serial.force_channels.insert(serial.force_channels.end(), d.channels.begin(), d.channels.end());
        usb.serial = d.serial;
        serial.port = d.port;
        for (std::size_t i = 0; i < d.channels.size(); ++i) {
            usb.limits[d.channels[i]] = {speed_limit(scene, d.servos[i]), acceleration_limit(scene, d.servos[i])};
            serial.channels.push_back(d.channels[i]);
            serial.speed_units_per_s = std::max(serial.speed_units_per_s, speed_limit(scene, d.servos[i]));
            serial.acceleration_units_per_s2 =
                std::max(serial.acceleration_units_per_s2, acceleration_limit(scene, d.servos[i]));
        }
    }
    if (driver == "maestro") return maestro::make_link(usb);
    if (driver == "maestro-dry")
        return maestro::make_dry_link(
            usb, settings.folder / ("maestro_" + (usb.serial.empty() ? "any" : usb.serial) + ".csv"));
    if (driver == "text")
        return make_text_link({serial.port, serial.channels, serial.speed_units_per_s, settings.need_watchdog});
    serial.protocol = driver == "dynamixel" ? SerialProtocol::dynamixel
                      : driver == "feetech" ? SerialProtocol::feetech
                                            : SerialProtocol::maestro_compact;
    return make_serial_bus(serial);
}

/// A name for files: "maestro_00123456", "dynamixel_ttyUSB0".
std::string file_name_of(const DriverSpec& d) {
    const std::string which = d.port.empty() ? d.serial : std::filesystem::path(d.port).filename().string();
    return d.driver + (which.empty() ? "" : "_" + which);
}

std::string finger_of(const Scene& scene, std::size_t thimble) {
    return scene.spec.fingers[std::size_t(scene.spec.thimbles[thimble].finger)].name;
}

constexpr double time_to_drain = 4;  ///< for what limits hold back, as from out of range [s]

/// Rows of armed thimbles tell how old their commands were at the wire.
void add_age_columns(Simulation& s) {
    for (const Matching& m : s.world.matchings)
        for (std::size_t i = 0; i < s.fingers.size(); ++i)
            if (Series& series = s.finger_series[i]; s.fingers[i] == m.finger && series.values.empty())
                series.columns.emplace_back("command_age_ms");
}

/// What nobody calibrated may turn the wrong way.
void refuse_uncalibrated(const Scene& scene) {
    std::vector<std::string> problems;
    for (std::size_t t = 0; t < scene.drivers.size(); ++t) {
        const DriverSpec& d = scene.drivers[t];
        if (controller_of(d).empty() || d.driver == "maestro-dry" || d.calibrated) continue;
        problems.push_back(scene.file.string() + ": finger." + finger_of(scene, t) +
                           ".device.calibration: real servos are armed with a calibration only, found none; "
                           "`palpate calibrate-thimble` makes one");
    }
    if (!problems.empty()) throw InputError(problems);
}

}  // namespace

std::string controller_of(const DriverSpec& d) {
    if (d.driver == "simulated") return "";
    return d.driver + (d.port.empty() ? d.serial.empty() ? "" : " " + d.serial : " " + d.port);
}

bool drives_hardware(const Scene& scene) {
    return std::any_of(scene.drivers.begin(), scene.drivers.end(),
                       [](const DriverSpec& d) { return !controller_of(d).empty(); });
}

std::map<std::string, std::shared_ptr<Board>> open_boards(const Scene& scene, const ArmSettings& settings) {
    std::map<std::string, std::shared_ptr<Board>> boards;
    std::vector<std::string> problems;
    for (const DriverSpec& d : scene.drivers) {
        const std::string controller = controller_of(d);
        if (controller.empty() || boards.count(controller)) continue;
        try {
            boards[controller] = std::make_shared<Board>(make_board_link(scene, controller, settings),
                                                         settings.folder / ("audit_" + file_name_of(d)));
        } catch (const std::runtime_error& error) {
            boards[controller] = nullptr;
            problems.push_back(scene.file.string() + ": " + controller + ": " + error.what());
        }
    }
    if (!problems.empty()) throw InputError(problems);
    return boards;
}

void arm(Simulation& s, const ArmSettings& settings) {
    if (settings.need_calibration) refuse_uncalibrated(s.scene);
    auto hardware = std::make_unique<Hardware>();
    hardware->boards = open_boards(s.scene, settings);
    for (const auto& [name, board] : hardware->boards)
        hardware->on_death.push_back(std::make_unique<RestOnDeath>(board));
    for (std::size_t t = 0; t < s.loops.size(); ++t) {
        ThimbleLoop& loop = *s.loops[t];
        const DriverSpec& d = s.scene.drivers[t];
        const bool force = s.scene.spec.thimbles[t].force_mode;
        BoardDriverLimits limits{loop.settings.limits.velocity, loop.settings.limits.acceleration, 0.15, loop.rest_q};
        if (force) limits.following = 0;  // it aims beyond what it reaches
        if (const auto board = hardware->boards.find(controller_of(d)); board != hardware->boards.end())
            loop.driver = make_board_driver(board->second, d.channels, d.servos, limits);
        if (force && !use_force_mode(loop))
            throw InputError(s.scene.file.string() + ": the driver " + d.driver +
                             " cannot limit the force of its servos");
        hardware->loops.push_back(&loop);
        hardware->seen.push_back({loop.q, loop.q, {}});
    }
    add_age_columns(s);
    s.pace.emplace().due = device_clock();
    hardware->thread = std::make_unique<DeviceThread>(hardware->loops);
    s.hardware = std::move(hardware);
}

void disarm(Simulation& s) {
    if (!s.hardware || !s.hardware->thread) return;
    for (auto& loop : s.loops) park(*loop);
    s.hardware->thread->stop();
    for (const auto& [name, board] : s.hardware->boards) board->drain(time_to_drain);
    s.hardware->rest.clear();
    for (std::size_t t = 0; t < s.loops.size(); ++t) {
        const DriverSpec& d = s.scene.drivers[t];
        const auto board = s.hardware->boards.find(controller_of(d));
        s.hardware->rest.push_back(board == s.hardware->boards.end()
                                       ? RestOutcome{at_rest(*s.loops[t]), "simulated"}
                                       : rest_outcome(*s.loops[t], *board->second, board->first, d.channels, d.servos));
    }
}

bool same_device(const DeviceModel& a, const DeviceModel& b) {
    // Of chains, scenes say how many joints there are.
    const auto same = [](const Coordinates& x, const Coordinates& y) { return x.size() == y.size() && x == y; };
    return a.kind->name == b.kind->name && same(a.joint_min, b.joint_min) && same(a.joint_max, b.joint_max) &&
           a.geometry == b.geometry;
}

bool same_thimbles(const Simulation& a, const Simulation& b) {
    return a.scene.drivers == b.scene.drivers && a.scene.loop == b.scene.loop && a.scene.servo == b.scene.servo &&
           std::equal(a.loops.begin(), a.loops.end(), b.loops.begin(), b.loops.end(), [](const auto& x, const auto& y) {
               return same_device(x->model, y->model) && x->model.max_force == y->model.max_force &&
                      x->rest_q == y->rest_q && x->torque.size() == y->torque.size();
           });
}

bool keep_armed(Simulation& from, Simulation& to) {
    if (!from.hardware || !same_thimbles(from, to)) return false;
    for (std::size_t t = 0; t < from.loops.size(); ++t) to.world.device_links[t].mailbox = &from.loops[t]->mailbox;
    to.loops = std::move(from.loops);
    to.hardware = std::move(from.hardware);
    if (!to.pace) to.pace = from.pace;
    return true;
}

std::string rest_report(const Simulation& s, bool& all) {
    all = true;
    std::map<std::string, std::string> fingers;  // by how
    std::string text;
    for (std::size_t t = 0; s.hardware && t < s.hardware->rest.size(); ++t) {
        const RestOutcome& r = s.hardware->rest[t];
        all &= r.confirmed;
        std::string& list = fingers[r.how];
        if (r.confirmed) list += (list.empty() ? "" : ", ") + finger_of(s.scene, t);
        if (!r.confirmed) text += finger_of(s.scene, t) + " is not known to be in its rest pose: " + r.how + "\n";
    }
    for (const auto& [how, names] : fingers)
        if (!names.empty())
            text += (all ? "thimbles are in their rest pose (" : names + ": in the rest pose (") + how + ")\n";
    return text;
}

Coordinates sent_angles(const Simulation& s, std::size_t thimble) {
    if (!s.hardware) return s.loops[thimble]->q;
    const DriverSpec& d = s.scene.drivers[thimble];
    const auto board = s.hardware->boards.find(controller_of(d));
    if (board == s.hardware->boards.end()) return s.hardware->seen[thimble].sent;
    Coordinates q(std::ptrdiff_t(d.channels.size()));
    for (std::size_t j = 0; j < d.channels.size(); ++j) {
        const WireValue value = board->second->arrived(d.channels[j]);
        q[std::ptrdiff_t(j)] = value == no_pulse ? NAN : angle_of(d.servos[j], board->second->steps_per_unit(), value);
    }
    return q;
}

const ThimbleReport& newest_report(Hardware& h, int thimble) {
    h.loops[std::size_t(thimble)]->reports.take(h.seen[std::size_t(thimble)]);
    return h.seen[std::size_t(thimble)];
}

void wait_for_real_time(RealTimePace& pace, double dt) {
    pace.due += dt;
    const double wait = pace.due - device_clock();
    if (wait > 0) return std::this_thread::sleep_for(std::chrono::duration<double>(wait));
    if (wait < -0.2) {  // too slow for real time: do not race to catch up
        pace.due = device_clock();
        ++pace.late_steps;
    }
}

namespace {

/// Which servos did not take values, or did not answer.
std::string servo_failures(const BoardStatus& b) {
    std::string text;
    for (std::size_t c = 0; c < max_channels; ++c)
        if (b.write_failures[c] || b.read_failures[c])
            text += "  servo " + std::to_string(c) + ": " + std::to_string(b.write_failures[c]) + " writes and " +
                    std::to_string(b.read_failures[c]) + " reads failed\n";
    return text;
}

/// From a tracked pose's arrival to the end of the transfer that it led to.
std::string age_report(const Simulation& s) {
    std::string text;
    char line[256];
    for (std::size_t t = 0; t < s.loops.size(); ++t) {
        const CommandAge a = command_age(s, t);
        if (a.count == 0) continue;
        plain_snprintf(line, sizeof line,
                       "  %s: age of %lld commands at the wire: %.2f ms median, %.2f ms p99, %.2f ms at most%s\n",
                       finger_of(s.scene, t).c_str(), (long long)a.count, a.median_ms, a.p99_ms, a.worst_ms,
                       1e-3 * a.p99_ms > longest_command_age ? "; warning: it will be felt as lag" : "");
        text += line;
    }
    return text;
}

}  // namespace

CommandAge command_age(const Simulation& s, std::size_t thimble) {
    CommandAge a;
    const DriverSpec& d = s.scene.drivers[thimble];
    const auto board = s.hardware ? s.hardware->boards.find(controller_of(d)) : decltype(s.hardware->boards.end()){};
    if (!s.hardware || board == s.hardware->boards.end()) return a;
    for (int c : d.channels) {
        const LatencyHistogram& h = board->second->age(c);
        a.count = std::max(a.count, h.count());
        a.median_ms = std::max(a.median_ms, 1e3 * h.quantile(0.5));
        a.p99_ms = std::max(a.p99_ms, 1e3 * h.quantile(0.99));
        a.worst_ms = std::max(a.worst_ms, 1e3 * h.worst());
    }
    return a;
}

std::string hardware_report(const Simulation& s) {
    std::string text;
    char line[256];
    for (const auto& [name, board] : s.hardware->boards) {
        const BoardStatus b = board->status();
        plain_snprintf(
            line, sizeof line,
            "%s: %lld targets in %lld writes, p99 %.2f ms, longest %.2f ms; %lld failures, opened %lld times\n",
            name.c_str(), (long long)b.values, (long long)b.writes, b.write_p99_ms, b.write_worst_ms,
            (long long)b.failures, (long long)b.opened);
        text += line;
        if (!b.problem.empty()) text += "  last problem: " + b.problem + "\n";
        if (!b.lost_audits.empty()) text += "  cannot be written: " + b.lost_audits + "\n";
        text += servo_failures(b);
        for (const BoardTransition& t : b.transitions)
            if (b.faults > 0) {
                plain_snprintf(line, sizeof line, "  %.3f s: %s to %s: ", t.at - b.transitions.front().at,
                               palpate::name(t.from), palpate::name(t.to));
                text += line + t.reason + "\n";
            }
    }
    std::int64_t ticks = 0, misses = 0, faults = 0;
    double median = 0, p99 = 0;
    for (const auto& loop : s.loops) {
        ticks += loop->status.ticks;
        misses += loop->status.misses;
        faults += loop->status.faults;
        median = std::max(median, loop->latency.quantile(0.5));
        p99 = std::max(p99, loop->latency.quantile(0.99));
    }
    plain_snprintf(
        line, sizeof line,
        "thimbles: %lld updates, %lld missed, %lld faults; tracked pose to driver %.2f ms median, %.2f ms p99\n",
        (long long)ticks, (long long)misses, (long long)faults, 1e3 * median, 1e3 * p99);
    text += line + age_report(s);
    {
        const LatencyHistogram& late = s.hardware->thread->lateness();
        plain_snprintf(line, sizeof line, "schedule: %.3f %% within 2 ms, p99 %.2f ms, worst %.2f ms late\n",
                       100 * late.share_within(0.002), 1e3 * late.quantile(0.99), 1e3 * late.worst());
        text += line;
    }
    if (s.pace->late_steps)
        text += "the simulation fell behind real time " + std::to_string(s.pace->late_steps) + " times\n";
    return text;
}

}  // namespace palpate
