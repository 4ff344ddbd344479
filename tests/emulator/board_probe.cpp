// Drives five thimbles on a Maestro as the program does (loops, device thread, board, link),
// without a scene: what faults do to the driver is seen in a fraction of a second, under a sanitizer or valgrind too.
//
//   board-probe [--seconds S] [--rearm 1] [--die SIGNAL] [--audit FILE] [--acceleration RAD_PER_S2]
//
// SIGNAL -1: of a stack that overflows; -2: by std::terminate; -3: of memory that is used up.
// Joints swing to and fro, fast. With --rearm 1 faults are cleared whenever their cause is gone, as by a person who
// never tires. Prints how the board fared; exits 0 where it ended well, 1 where it ended in a fault, 2 where it was
// refused.

#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "devices/drivers/last_resort.h"
#include "devices/drivers/maestro.h"
#include "devices/loop/device_thread.h"
#include "devices/loop/rest_outcome.h"

namespace {

using namespace palpate;

struct Options {
    double seconds = 0.5;
    bool rearm = false;
    int signal = 0;
    std::string audit;
    double acceleration = SlewLimits{}.acceleration;
};

Options parse(int argc, char** argv) {
    Options o;
    for (int i = 1; i + 1 < argc; i += 2) {
        const std::string key = argv[i];
        if (key == "--seconds") o.seconds = std::atof(argv[i + 1]);
        if (key == "--rearm") o.rearm = std::atoi(argv[i + 1]) != 0;
        if (key == "--die") o.signal = std::atoi(argv[i + 1]);
        if (key == "--acceleration") o.acceleration = std::atof(argv[i + 1]);
        if (key == "--audit") o.audit = argv[i + 1];
    }
    return o;
}

[[gnu::noinline]] int overflow(volatile char* below) {
    volatile char room[4096];
    room[0] = *below;
    return room[0] == 1 ? 0 : overflow(room) + room[0];  // never 1
}

[[noreturn]] void use_up_memory() noexcept {
    const rlimit little{1 << 20, 1 << 20};
    setrlimit(RLIMIT_AS, &little);
    for (std::vector<std::string> all;;) all.emplace_back(1 << 16, 'x');
}

void die(int signal) {
    volatile char here = 0;
    if (signal == -1) std::printf("%d", overflow(&here));
    if (signal == -2) std::terminate();
    if (signal == -3) use_up_memory();
    std::raise(signal);
}

int probe(const Options& o) {
    constexpr int thimbles = 5;
    ThimbleLoopSettings settings;
    settings.limits.acceleration = o.acceleration;
    maestro::LinkSettings link;
    for (int c = 0; c < 3 * thimbles; ++c)
        link.limits[c] = {ServoCalibration{}.units_per_rad * settings.limits.velocity,
                          ServoCalibration{}.units_per_rad * settings.limits.acceleration};
    auto board = std::make_shared<Board>(maestro::make_link(link), o.audit);
    RestOnDeath on_death(board);
    const DeviceModel model = find_kind("chinello-3rrs")->defaults();
    std::vector<std::unique_ptr<ThimbleLoop>> loops;
    std::vector<ThimbleLoop*> all;
    for (int t = 0; t < thimbles; ++t) {
        loops.push_back(std::make_unique<ThimbleLoop>());
        const Coordinates rest = model.kind->joints(model, model.rest).q;
        initialise(*loops.back(), model, settings,
                   make_board_driver(board, {3 * t, 3 * t + 1, 3 * t + 2}, std::vector<ServoCalibration>(3),
                                     {settings.limits.velocity, settings.limits.acceleration, 0, rest}));
        all.push_back(loops.back().get());
    }
    DeviceThread thread(all);
    for (const double began = device_clock(); device_clock() - began < o.seconds;) {
        const double t = device_clock() - began;
        for (ThimbleLoop* loop : all) {
            // Still at first, until servos have caught up and may be fast.
            auto swing = [&](double hertz) {
                return t < 0.5 ? 0 : std::clamp(3 * std::sin(6.28 * hertz * (t - 0.5)), -1.0, 1.0);
            };
            const Coordinates w = Eigen::Vector3d(0.3 * swing(1.4), 0.2 * swing(1.1), 0.024);
            loop->mailbox.publish({t, model.kind->joints(model, w).q, true});
            if (o.rearm && loop->status.mode == ThimbleMode::fault) loop->rearm_asked = true;
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
        if (o.signal && t > 0.6 * o.seconds) die(o.signal);
    }
    thread.stop();
    board->drain(2);
    const BoardStatus s = board->status();
    for (const auto& t : s.transitions) std::printf("%s to %s: %s\n", name(t.from), name(t.to), t.reason.c_str());
    bool everywhere = true;
    for (int t = 0; t < thimbles; ++t) {
        const RestOutcome r = rest_outcome(*loops[std::size_t(t)], *board, "the Maestro", {3 * t, 3 * t + 1, 3 * t + 2},
                                           std::vector<ServoCalibration>(3));
        if (!r.confirmed) std::printf("thimble %d is not known to be in its rest pose: %s\n", t, r.how.c_str());
        everywhere &= r.confirmed;
    }
    std::printf("%lld values, %lld failures, %lld faults; %s\n", (long long)s.values, (long long)s.failures,
                (long long)s.faults, everywhere ? "thimbles are in their rest pose" : "not known to be at rest");
    return s.state == BoardState::active ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return probe(parse(argc, argv));
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 2;
    }
}
