// Random sequences of faults, unplugging included, against all of devices/: fault-sequences EMULATOR PROBE RUNS
// [FIRST]. Each is one process of board_probe.cpp under the emulator, every second one with a person who re-arms at
// once. Judged are its end, what came over the wire, and what it says of the rest pose. Exits 1 where any failed.

#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <thread>

#include "devices/device.h"
#include "devices/drivers/servo.h"
#include "tests/emulator/wire_log.h"

namespace {

using namespace palpate;
using namespace palpate::testing;

constexpr double acceleration = 12;  ///< low, so that a log shows whether it is kept [rad/s^2]
constexpr int channels = 15;

struct Outcome {
    int code = 0;
    std::string out;
};
Outcome shell(const std::string& command) {
    Outcome o;
    FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
    char chunk[4096];
    while (const std::size_t n = std::fread(chunk, 1, sizeof chunk, pipe)) o.out.append(chunk, n);
    const int status = ::pclose(pipe);
    o.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return o;
}

bool says(const Outcome& o, const char* words) { return o.out.find(words) != std::string::npos; }

/// The words about the rest pose against what the boards were told.
std::string untrue(const Outcome& o, const std::vector<WireEvent>& events, bool rearms) {
    if (o.code == 2) return "";  // refused before anything moved
    if (!says(o, "thimbles are in their rest pose"))
        return says(o, "is not known to be in its rest pose") ? "" : "nothing is said of the rest pose; ";
    const DeviceModel m = find_kind("chinello-3rrs")->defaults();
    const Coordinates rest = m.kind->joints(m, m.rest).q;
    std::string wrong;
    const auto last = newest_targets(events);
    if (int(last.size()) != channels) wrong += "not every servo was told anything; ";
    for (const auto& [channel, value] : last)
        if (value != wire_value({}, 4, rest[channel % 3]))
            wrong += "channel " + std::to_string(channel) + " is not at rest; ";
    double lost = 0, told = 0;
    for (const WireEvent& e : events) {
        if (e.channel == unplugged || e.channel == watchdog_bit) lost = e.time;
        if (e.channel >= 0) told = e.time;
    }
    if (lost > 0 && (!rearms || lost > told)) wrong += "a board that was lost cannot be known to be at rest; ";
    return wrong;
}

std::string run(const std::string& emulator, const std::string& probe, int seed, const std::string& file, long& told) {
    const bool rearms = seed % 2 == 0;
    const std::string command = emulator + " --at 6000 --random-faults " + std::to_string(seed) +
                                " --replug-ms 60 --log " + file + " -- " + probe + " --seconds 1.2 --acceleration " +
                                std::to_string(acceleration) + (rearms ? " --rearm 1" : "");
    Outcome o;
    for (int attempt = 0; attempt < 3; ++attempt) {
        o = shell(command);
        // umockdev ends a program where a board is unplugged between a request and its answer: that says nothing of it.
        if (!says(o, "ERROR: libumockdev-preload:") && !says(o, "uevent_sender sendmsg")) break;
    }
    WireRules rules;
    rules.acceleration = acceleration;
    const auto events = read_wire_log(file);
    std::string wrong;
    if (o.code > 2) wrong += "ended with " + std::to_string(o.code) + "; ";
    if (says(o, "AddressSanitizer") || says(o, "runtime error:")) wrong += "found by the sanitizers; ";
    wrong += unsafe(events, rules) + told_after_a_latch(events, 0.4, rearms) + untrue(o, events, rearms);
    for (const WireEvent& e : events) told += e.channel >= 0;
    return wrong.empty() ? "" : wrong + "\n  " + command + "\n" + o.out;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 4) return std::fprintf(stderr, "usage: fault-sequences EMULATOR PROBE RUNS [FIRST]\n"), 2;
    const int runs = std::atoi(argv[3]), first = argc > 4 ? std::atoi(argv[4]) : 1;
    const auto folder = std::filesystem::temp_directory_path() / ("palpate-faults-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    std::atomic<int> next{first}, failed{0};
    std::atomic<long> targets{0};
    std::mutex printing;
    auto work = [&](int worker) {
        const std::string file = (folder / std::to_string(worker)).string();
        for (int seed; (seed = next++) < first + runs;) {
            long told = 0;
            const std::string wrong = run(argv[1], argv[2], seed, file, told);
            targets += told;
            if (wrong.empty()) continue;
            ++failed;
            const std::lock_guard lock(printing);
            std::printf("sequence %d: %s\n", seed, wrong.c_str());
            std::fflush(stdout);
        }
    };
    std::vector<std::thread> workers;
    for (unsigned k = 0; k < std::max(2u, std::thread::hardware_concurrency()); ++k) workers.emplace_back(work, int(k));
    for (std::thread& w : workers) w.join();
    std::filesystem::remove_all(folder);
    std::printf("%d sequences of faults, %ld targets: %d failed\n", runs, targets.load(), failed.load());
    return failed ? 1 : 0;
}
