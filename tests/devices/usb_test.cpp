// The unmodified program and emulated Maestro boards on USB.

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "devices/drivers/servo.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::Outcome;
using testing::shell;

#define EXPECT_SAYS(outcome, part) EXPECT_NE((outcome).out.find(part), std::string::npos) << "found: " << (outcome).out

class Usb : public ::testing::Test {
  protected:
    void SetUp() override {
#ifndef PALPATE_MAESTRO_EMULATOR
        GTEST_SKIP() << "umockdev (libumockdev-dev) was not there when the tests were configured";
#endif
    }
#ifndef PALPATE_MAESTRO_EMULATOR
    const std::string emulator;
#else
    const std::string emulator = PALPATE_MAESTRO_EMULATOR;
#endif
    const std::string program = PALPATE_PROGRAM;
    testing::ScratchFolder scratch;

    /// `fingers` fingers that press on a table, three channels each.
    std::string scene(int fingers, double seconds, const std::string& device = "serial = \"00123456\"") {
        const auto path = scratch.path / "scene.toml";
        std::ofstream out(path);
        out << "duration_s = " << seconds << "\ndt_ms = 2\n[solver]\npreset = \"real-time\"\nprecision = \"float\"\n"
            << "[[object]]\nname = \"table\"\nkind = \"plane\"\n";
        for (int i = 0; i < fingers; ++i)
            out << "[[finger]]\nname = \"f" << i << "\"\nelements = 100\ndevice = { kind = \"chinello-3rrs\", driver = "
                << "\"maestro\", " << device << ", channels = [" << 3 * i << ", " << 3 * i + 1 << ", " << 3 * i + 2
                << "] }\ntrack = [ { t_s = 0, position_mm = [" << 30 * i << ", 0, 9] }, { t_s = " << seconds / 2
                << ", position_mm = [" << 30 * i << ", 0, 6.5], rotation_deg = [10, 0, 0] } ]\n";
        return path.string();
    }
    std::string run_command(const std::string& file) const {
        return program + " run " + file + " --arm --out " + (scratch.path / "results").string();
    }
    /// A run that umockdev's own preloaded library ended (it aborts where a board is unplugged between a request and
    /// its answer) says nothing of the program, and is repeated.
    Outcome emulate(const std::string& options, const std::string& command) const {
        Outcome o;
        for (int attempt = 0; attempt < 3; ++attempt) {
            o = shell(emulator + " " + options + " -- " + command);
            if (o.code == 0 || o.code == 2 || o.out.find("ERROR: libumockdev-preload:") == std::string::npos) break;
        }
        return o;
    }
    struct Target {
        double time;
        int board, channel, value;
    };
    std::vector<Target> log() const {
        std::ifstream in(scratch.path / "log");
        std::vector<Target> out;
        for (Target t; in >> t.time >> t.board >> t.channel >> t.value;) out.push_back(t);
        return out;
    }
    std::string logged() const { return " --log " + (scratch.path / "log").string(); }
    /// What reached servos, whatever happened: in range, and never faster than the limit.
    static void expect_safe(const std::vector<Target>& targets) {
        std::map<int, Target> last;
        for (const Target& t : targets) {
            ASSERT_GE(t.value, 4 * 992);
            ASSERT_LE(t.value, 4 * 2000);
            const auto before = last.find(t.channel);
            if (before != last.end()) {
                // Times are those of arrival, which a busy bus delays.
                const double elapsed = std::min(0.1, t.time - before->second.time + 0.06);
                ASSERT_LE(std::abs(t.value - before->second.value), 4 * 636.62 * 6 * 1.05 * elapsed + 1)
                    << "channel " << t.channel << " at " << t.time;
            }
            last[t.channel] = t;
        }
    }
    static WireValue rest_pulse(int joint) {
        const DeviceModel m = find_kind("chinello-3rrs")->defaults();
        return wire_value({}, 4, m.kind->joints(m, m.rest).q[joint]);
    }
    static void expect_at_rest(const std::vector<Target>& targets, int channels) {
        std::map<int, int> last;
        for (const Target& t : targets) last[t.channel] = t.value;
        ASSERT_EQ(int(last.size()), channels);
        for (const auto& [channel, value] : last) EXPECT_EQ(value, rest_pulse(channel % 3)) << "channel " << channel;
    }
};

TEST_F(Usb, BoardsAreListed) {
    Outcome o = emulate("--boards 10 --channels 24", program + " devices --json");
    EXPECT_EQ(o.code, 0);
    const auto boards = nlohmann::json::parse(o.out);
    ASSERT_EQ(boards.size(), 10u);
    EXPECT_EQ(boards[0]["channels"], 24);
    EXPECT_EQ(boards[0]["watchdog_ms"], 200);
    o = emulate("--boards 1 --channels 6", program + " devices " + scene(2, 1));
    EXPECT_SAYS(o, "Maestro 6  serial 00123456");
    EXPECT_SAYS(o, "drives f0, f1");
    o = emulate("--channels 0", program + " devices");
    EXPECT_SAYS(o, "bootloader");
}

TEST_F(Usb, TheDoctorFindsAndMends) {
    Outcome o = emulate("", program + " doctor " + scene(5, 1));
    EXPECT_SAYS(o, "nothing wrong");
    EXPECT_EQ(o.code, 0);
    o = emulate("--watchdog 0", program + " doctor");
    EXPECT_EQ(o.code, 1);
    EXPECT_SAYS(o, "watchdog is off");
    o = emulate("--watchdog 0", "sh -c '" + program + " doctor --mend && " + program + " doctor'");
    EXPECT_SAYS(o, "mended");
    EXPECT_SAYS(o, "nothing wrong");
    o = emulate("--boards 2", program + " doctor " + scene(1, 1, "serial = \"\""));
    EXPECT_SAYS(o, "does not say which");
    o = emulate("--channels 6", program + " doctor " + scene(3, 1));
    EXPECT_SAYS(o, "channel 6 is not on a board of 6");
    o = emulate("", program + " doctor " + scene(1, 1, "serial = \"99\""));
    EXPECT_SAYS(o, "is not on USB");
    o = emulate("--channels 0", program + " doctor");
    EXPECT_SAYS(o, "bootloader");
}

TEST_F(Usb, NothingMovesWithoutArming) {
    const Outcome o = emulate(logged(), program + " run " + scene(1, 0.1) + " --out " + (scratch.path / "r").string());
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_SAYS(o, "thimbles are simulated; --arm moves the real ones");
    EXPECT_TRUE(log().empty());
}

TEST_F(Usb, WhatCannotBeArmedIsRefused) {
    Outcome o = emulate("--watchdog 0" + logged(), run_command(scene(1, 0.2)));
    EXPECT_EQ(o.code, 2);
    EXPECT_SAYS(o, "watchdog off");
    EXPECT_TRUE(log().empty());
    o = emulate("--watchdog 0" + logged(), run_command(scene(1, 0.2)) + " --no-watchdog");
    EXPECT_EQ(o.code, 0) << o.out;
    o = emulate("--boards 2", run_command(scene(1, 0.2, "serial = \"\"")));
    EXPECT_EQ(o.code, 2);
    EXPECT_SAYS(o, "several Maestros");
    o = emulate("", run_command(scene(1, 0.2, "serial = \"77\"")));
    EXPECT_EQ(o.code, 2);
    EXPECT_SAYS(o, "was not found; on USB: 00123456");
    o = emulate("--channels 6", run_command(scene(3, 0.2)));
    EXPECT_EQ(o.code, 2);
    EXPECT_SAYS(o, "is not one of the 6");
    o = emulate("--channels 0", run_command(scene(1, 0.2)));
    EXPECT_EQ(o.code, 2);
}

TEST_F(Usb, FiveFingersOnOneBoardMoveSafelyAndEndAtRest) {
    const Outcome o = emulate(logged(), run_command(scene(5, 1.5)));
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_SAYS(o, "0 failures, opened 1 times");
    EXPECT_SAYS(o, " 0 faults");
    const auto targets = log();
    EXPECT_GT(targets.size(), 300u);
    expect_safe(targets);
    expect_at_rest(targets, 15);
}

TEST_F(Usb, HomeBringsTheRestPose) {
    const Outcome o = emulate(logged(), program + " home " + scene(2, 1));
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_SAYS(o, "thimbles are in their rest pose");
    expect_at_rest(log(), 6);
}

TEST_F(Usb, JogMovesWithinTheWorkspace) {
    // Ten degrees of theta are too many at once for the slew limit, and the keys come as fast as they are read.
    const std::string keys = "(sleep 0.3; printf '1+++++'; sleep 0.4; printf 'hq')";
    const Outcome o = shell(keys + " | " + emulator + logged() + " -- " + program + " jog " + scene(1, 1));
    EXPECT_EQ(o.code, 0) << o.out;
    const auto targets = log();
    ASSERT_FALSE(targets.empty());
    expect_safe(targets);
    int highest = 0;
    for (const Target& t : targets)
        if (t.channel == 0) highest = std::max(highest, t.value);
    EXPECT_NEAR(highest, rest_pulse(0) + 4 * 636.62 * 5 * 0.0174533, 2);
    expect_at_rest(targets, 3);
}

TEST_F(Usb, CalibrationIsFoundAndUsed) {
    // Each servo: zero two degrees up, then 30 degrees further down than up would be: it turns the other way.
    const auto file = scratch.path / "index.toml";
    std::string keys = "(sleep 0.3; ";
    for (int servo = 0; servo < 3; ++servo)
        keys += "printf '++\\n'; printf '<<<\\n'; printf '<\\n'; printf '>>>>>>\\n'; ";
    keys += "sleep 0.2)";
    Outcome o = shell(keys + " | " + emulator + logged() + " -- " + program + " calibrate-thimble " + scene(1, 1) +
                      " --out " + file.string());
    EXPECT_EQ(o.code, 0) << o.out;
    expect_safe(log());
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    EXPECT_NE(text.str().find("us_per_rad = -636.62"), std::string::npos) << text.str();
    o = emulate(logged(), run_command(scene(1, 0.3, "calibration = \"index.toml\"")));
    EXPECT_EQ(o.code, 0) << o.out;
    expect_safe(log());
}

TEST_F(Usb, FaultsLatchAndAreReported) {
    for (const std::string fault : {"unplug@150", "hang@150",
                                    "stall@150 --fault stall@151 --fault stall@152 --fault "
                                    "stall@153 --fault stall@154 --fault stall@155"}) {
        const Outcome o = emulate("--fault " + fault + logged(), run_command(scene(5, 1.2)));
        EXPECT_EQ(o.code, 0) << fault << o.out;
        expect_safe(log());
        if (fault[0] != 's') {
            EXPECT_SAYS(o, " 5 faults");
            EXPECT_SAYS(o, "last problem");
        }
    }
    // One transfer that times out, and a reply too short or too long, are tried again.
    for (const std::string kind : {"timeout", "partial", "short", "long", "errors"}) {
        const Outcome o = emulate("--fault " + kind + "@150" + logged(), run_command(scene(5, 1)));
        EXPECT_EQ(o.code, 0) << kind << o.out;
        EXPECT_SAYS(o, " 0 faults");
        expect_safe(log());
        expect_at_rest(log(), 15);
    }
}

TEST_F(Usb, AnySequenceOfFaultsStaysSafe) {
    const int runs = std::getenv("PALPATE_FAULT_RUNS") ? std::atoi(std::getenv("PALPATE_FAULT_RUNS")) : 100;
    const std::string file = scene(5, 0.35);
    for (int seed = 1; seed <= runs; ++seed) {
        const Outcome o =
            emulate("--random-faults " + std::to_string(seed) + " --replug-ms 100" + logged(), run_command(file));
        EXPECT_TRUE(o.code == 0 || o.code == 2) << "seed " << seed << ": " << o.code << "\n" << o.out;
        expect_safe(log());
        if (HasFatalFailure()) FAIL() << "seed " << seed;
    }
}

TEST_F(Usb, HoweverItEndsServosStayInRange) {
    const int runs = std::getenv("PALPATE_KILL_RUNS") ? std::atoi(std::getenv("PALPATE_KILL_RUNS")) : 9;
    std::mt19937 random(4);
    const std::string file = scene(2, 5);
    for (int k = 0; k < runs; ++k) {
        const std::string signal = k % 3 == 0 ? "KILL" : k % 3 == 1 ? "TERM" : "INT";
        const std::string after = "0." + std::to_string(300 + random() % 600);
        const Outcome o = emulate(logged(), "timeout -s " + signal + " " + after + " " + run_command(file));
        const auto targets = log();
        expect_safe(targets);
        if (signal == "KILL" || targets.empty()) continue;
        EXPECT_SAYS(o, "thimbles are in their rest pose");
        expect_at_rest(targets, 6);
    }
}

}  // namespace
}  // namespace palpate
