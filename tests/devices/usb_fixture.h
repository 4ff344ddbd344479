#pragma once
// The unmodified program and emulated Maestro boards on USB: what tests of both share.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "devices/drivers/servo.h"
#include "tests/emulator/wire_log.h"
#include "tests/real_time.h"
#include "tests/support.h"

namespace palpate {

using testing::Outcome;
using testing::shell;
using Target = testing::WireEvent;

#define EXPECT_SAYS(outcome, part) EXPECT_NE((outcome).out.find(part), std::string::npos) << "found: " << (outcome).out

class Usb : public ::testing::Test {
  protected:
    void SetUp() override {
        testing::ask_to_be_served_first();
#ifndef PALPATE_MAESTRO_EMULATOR
        GTEST_SKIP() << "umockdev (libumockdev-dev) was not there when the tests were configured";
#endif
    }
#ifndef PALPATE_MAESTRO_EMULATOR
    const std::string emulator, probe;
#else
    const std::string emulator = PALPATE_MAESTRO_EMULATOR, probe = PALPATE_BOARD_PROBE;
#endif
    const std::string program = testing::program_path();
    testing::ScratchFolder scratch;

    static constexpr const char* calibrated = "serial = \"00123456\", calibration = \"cal.toml\"";

    /// `fingers` fingers that press on a table, three channels each; `turn_s`: to and fro, so often.
    std::string scene(int fingers, double seconds, const std::string& device = calibrated, double turn_s = 0) {
        std::ofstream calibration(scratch.path / "cal.toml");
        for (int k = 0; k < 3; ++k)
            calibration << "[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 992\nmax_us = 2000\n";
        const auto path = scratch.path / "scene.toml";
        std::ofstream out(path);
        out << "duration_s = " << seconds << "\ndt_ms = 2\n[solver]\npreset = \"real-time\"\nprecision = \"float\"\n"
            << "[[object]]\nname = \"table\"\nkind = \"plane\"\n";
        for (int i = 0; i < fingers; ++i) {
            out << "[[finger]]\nname = \"f" << i << "\"\nelements = 100\ndevice = { kind = \"chinello-3rrs\", driver = "
                << "\"maestro\", " << device << ", channels = [" << 3 * i << ", " << 3 * i + 1 << ", " << 3 * i + 2
                << "] }\ntrack = [ { t_s = 0, position_mm = [" << 30 * i << ", 0, 9] }, { t_s = " << seconds / 2
                << ", position_mm = [" << 30 * i << ", 0, 6.5], rotation_deg = [10, 0, 0] }";
            for (int k = 1; turn_s > 0 && seconds / 2 + k * turn_s < seconds; ++k)
                out << ", { t_s = " << seconds / 2 + k * turn_s << ", position_mm = [" << 30 * i
                    << ", 0, 6.5], rotation_deg = [" << (k % 2 ? -10 : 10) << ", 0, 0] }";
            out << " ]\n";
        }
        return path.string();
    }
    std::string run_command(const std::string& file) const {
        return program + " run " + file + " --arm --no-picture --out " + (scratch.path / "results").string();
    }
    /// A run that umockdev itself ended (it aborts where a board is unplugged between a request and its answer, or as
    /// the program ends) says nothing of the program, and is repeated. `keys`: a command that types them.
    Outcome emulate(const std::string& options, const std::string& command, const std::string& keys = "") const {
        const std::string typed = keys.empty() ? "" : keys + " | ";
        Outcome o;
        for (int attempt = 0; attempt < 3; ++attempt) {
            // There, so that what it writes beside its results is thrown away.
            o = shell("cd " + scratch.path.string() + " && " + typed + emulator + " " + options + " -- " + command);
            const bool mocked = o.out.find("ERROR: libumockdev-preload:") != std::string::npos ||
                                o.out.find("uevent_sender sendmsg") != std::string::npos;
            if (o.code == 0 || o.code == 2 || !mocked) break;
        }
        return o;
    }
    std::vector<Target> events() const { return testing::read_wire_log((scratch.path / "log").string()); }
    std::vector<Target> log() const {
        std::vector<Target> out;
        for (const Target& t : events())
            if (t.channel >= 0) out.push_back(t);
        return out;
    }
    std::string logged() const { return " --log " + (scratch.path / "log").string(); }
    bool happened(int event) const {
        const auto all = events();
        return std::any_of(all.begin(), all.end(), [&](const Target& t) { return t.channel == event; });
    }
    /// What reached servos, whatever happened.
    static void expect_safe(const std::vector<Target>& all) { ASSERT_EQ(testing::unsafe(all), ""); }
    /// Nobody has re-armed: nothing is told to a board that was unplugged, or whose watchdog has bitten `grace` ago,
    /// but for `underway` transfers that a stopped program had begun.
    static void expect_latched(const std::vector<Target>& all, double grace, int underway = 0) {
        ASSERT_EQ(testing::told_after_a_latch(all, grace, false, underway), "");
    }
    /// What the program says of the rest pose is what the boards saw.
    void expect_true_words(const Outcome& o, int channels) const {
        const bool claims = o.out.find("thimbles are in their rest pose") != std::string::npos;
        if (claims) {
            expect_at_rest(log(), channels);
            EXPECT_FALSE(happened(testing::unplugged)) << "a board that was unplugged cannot be known to be at rest\n"
                                                       << o.out;
        } else if (o.code != 2) {
            EXPECT_SAYS(o, "is not known to be in its rest pose");
        }
    }
    /// The program in the background of a shell, and what is done to it once servos move.
    std::string meanwhile(const std::string& command, const std::string& what) const {
        const std::string file = (scratch.path / "log").string();
        return "sh -c '" + command + " & p=$!; n=0; while [ $(wc -l < " + file +
               ") -lt 20 ] && [ $n -lt 1200 ]; do sleep 0.05; n=$((n+1)); done; sleep 0.3; " + what + "; wait $p'";
    }
    static WireValue rest_pulse(int joint) {
        const DeviceModel m = find_kind("chinello-3rrs")->defaults();
        return wire_value({}, 4, m.kind->joints(m, m.rest).q[joint]);
    }
    static void expect_at_rest(const std::vector<Target>& targets, int channels) {
        const auto last = testing::newest_targets(targets);
        ASSERT_EQ(int(last.size()), channels);
        for (const auto& [channel, value] : last) EXPECT_EQ(value, rest_pulse(channel % 3)) << "channel " << channel;
    }
};

}  // namespace palpate
