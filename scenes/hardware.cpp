#include "scenes/hardware.h"

#include <algorithm>
#include <cstdio>
#include <thread>

#include "devices/drivers/maestro.h"
#include "devices/drivers/serial_bus.h"
#include "meshes/input_error.h"

namespace palpate {

namespace {

/// Speed that a servo's own controller is told to keep [units/s].
double speed_limit(const Scene& scene, const ServoCalibration& servo) {
    return std::abs(servo.units_per_rad) * scene.loop.limits.velocity;
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
            usb.speed_us_per_s[d.channels[i]] = speed_limit(scene, d.servos[i]);
            serial.channels.push_back(d.channels[i]);
            serial.speed_units_per_s = std::max(serial.speed_units_per_s, speed_limit(scene, d.servos[i]));
        }
    }
    if (driver == "maestro") return maestro::make_link(usb);
    if (driver == "maestro-dry")
        return maestro::make_dry_link(
            usb, settings.dry_folder / ("maestro_" + (usb.serial.empty() ? "any" : usb.serial) + ".csv"));
    serial.protocol = driver == "dynamixel" ? SerialProtocol::dynamixel
                      : driver == "feetech" ? SerialProtocol::feetech
                                            : SerialProtocol::maestro_compact;
    return make_serial_bus(serial);
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
            boards[controller] = std::make_shared<Board>(make_board_link(scene, controller, settings));
        } catch (const std::runtime_error& error) {
            boards[controller] = nullptr;
            problems.push_back(scene.file.string() + ": " + controller + ": " + error.what());
        }
    }
    if (!problems.empty()) throw InputError(problems);
    return boards;
}

void arm(Simulation& s, const ArmSettings& settings) {
    auto hardware = std::make_unique<Hardware>();
    hardware->boards = open_boards(s.scene, settings);
    for (std::size_t t = 0; t < s.loops.size(); ++t) {
        ThimbleLoop& loop = *s.loops[t];
        const DriverSpec& d = s.scene.drivers[t];
        if (const auto board = hardware->boards.find(controller_of(d)); board != hardware->boards.end())
            loop.driver = make_board_driver(board->second, d.channels, d.servos, loop.settings.limits.velocity);
        if (s.scene.spec.thimbles[t].force_mode && !use_force_mode(loop))
            throw InputError(s.scene.file.string() + ": the driver " + d.driver +
                             " cannot limit the force of its servos");
        hardware->loops.push_back(&loop);
        hardware->seen.push_back({loop.q, loop.q, {}});
    }
    s.pace.emplace().due = device_clock();
    hardware->thread = std::make_unique<DeviceThread>(hardware->loops);
    s.hardware = std::move(hardware);
}

void disarm(Simulation& s) {
    if (!s.hardware || !s.hardware->thread) return;
    for (auto& loop : s.loops) park(*loop);
    s.hardware->thread->stop();
    for (const auto& [name, board] : s.hardware->boards) board->drain();
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

std::string hardware_report(const Simulation& s) {
    std::string text;
    char line[256];
    for (const auto& [name, board] : s.hardware->boards) {
        const BoardStatus b = board->status();
        std::snprintf(
            line, sizeof line,
            "%s: %lld targets in %lld writes, p99 %.2f ms, longest %.2f ms; %lld failures, opened %lld times\n",
            name.c_str(), (long long)b.values, (long long)b.writes, b.write_p99_ms, b.write_worst_ms,
            (long long)b.failures, (long long)b.opened);
        text += line;
        if (!b.problem.empty()) text += "  last problem: " + b.problem + "\n";
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
    std::snprintf(
        line, sizeof line,
        "thimbles: %lld updates, %lld missed, %lld faults; tracked pose to driver %.2f ms median, %.2f ms p99\n",
        (long long)ticks, (long long)misses, (long long)faults, 1e3 * median, 1e3 * p99);
    text += line;
    {
        const LatencyHistogram& late = s.hardware->thread->lateness();
        std::snprintf(line, sizeof line, "schedule: %.3f %% within 2 ms, p99 %.2f ms, worst %.2f ms late\n",
                      100 * late.share_within(0.002), 1e3 * late.quantile(0.99), 1e3 * late.worst());
        text += line;
    }
    if (s.pace->late_steps)
        text += "the simulation fell behind real time " + std::to_string(s.pace->late_steps) + " times\n";
    return text;
}

}  // namespace palpate
