// The unmodified program and emulated Maestro boards on USB: whatever goes wrong, nothing unsafe is sent, nobody but a
// person re-arms, and what is said is true.

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "tests/devices/usb_fixture.h"

namespace palpate {
namespace {

TEST_F(Usb, AWatchdogThatHasBittenLatches) {
    const Outcome o = emulate("--bites 1" + logged(),
                              meanwhile(run_command(scene(2, 2.5)), "kill -STOP $p; sleep 0.6; kill -CONT $p"));
    ASSERT_TRUE(happened(testing::watchdog_bit)) << o.out;
    expect_safe(events());
    // The emulation takes several messages for what is one call of a kernel: it can be stopped inside.
    expect_latched(events(), 0, 1);
    EXPECT_SAYS(o, "watchdog has bitten");
    EXPECT_SAYS(o, " 2 faults");
    expect_true_words(o, 6);
}

TEST_F(Usb, AReplugNeedsAPersonAndThenGoesOn) {
    const std::string keys =
        "(sleep 2; printf +; for n in 1 2 3 4 5 6 7 8; do sleep 0.5; printf r; done; printf '+++'; sleep 0.5; printf "
        "q)";
    const Outcome o = emulate("--fault unplug@60 --replug-ms 100" + logged(), program + " jog " + scene(1, 1), keys);
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_SAYS(o, "active to faulted: unplugged");
    EXPECT_SAYS(o, "inactive to active: armed");
    const auto all = events();
    expect_safe(all);
    ASSERT_TRUE(happened(testing::plugged_in)) << o.out;
    double back = 0, first = HUGE_VAL;
    for (const Target& t : all) {
        if (t.channel == testing::unplugged) back = t.time;
        if (t.channel >= 0 && back > 0) first = std::min(first, t.time);
    }
    EXPECT_LT(first, HUGE_VAL) << "nothing was told after it was re-armed";
    EXPECT_GT(first, back + 0.1);
}

/// A scene need not say which board, where there is one: but the calibration is of that one.
TEST_F(Usb, AnotherBoardIsNotTakenForTheOneThatWasLost) {
    const std::string keys =
        "(sleep 2; printf +; for n in 1 2 3 4 5 6; do sleep 0.5; printf r; done; printf '+++'; sleep 0.5; printf q)";
    const Outcome o = emulate("--another 1 --fault unplug@60 --replug-ms 100" + logged(),
                              program + " jog " + scene(1, 1, "calibration = \"cal.toml\""), keys);
    ASSERT_TRUE(happened(testing::plugged_in)) << o.out;
    EXPECT_SAYS(o, "the Maestro 00123456 was not found; on USB: 00123556");
    expect_latched(events(), 0);
}

TEST_F(Usb, WhateverSignalEndsItServosGoToRest) {
    int number = 0;
    for (const std::string signal : {"HUP", "QUIT", "SEGV", "ABRT", "FPE", "USR1"}) {
        if (!testing::is_tried(number++, 2)) continue;
        const Outcome o = emulate(logged(), meanwhile(run_command(scene(2, 20)), "kill -" + signal + " $p"));
        ASSERT_FALSE(log().empty()) << signal << o.out;
        expect_safe(events());
        expect_at_rest(log(), 6);
        if (HasFailure()) FAIL() << signal << o.out;
    }
    // Nobody reads what it says any more.
    emulate(logged(), "sh -c '" + run_command(scene(2, 1)) + " | true'");
    expect_at_rest(log(), 6);
}

TEST_F(Usb, AStormOfSignalsMakesNoServoFaster) {
    const Outcome o = emulate("--at 6000" + logged(),
                              meanwhile(run_command(scene(2, 20)),
                                        "for i in $(seq 60); do for s in USR1 HUP INT TERM WINCH CHLD PIPE QUIT; do "
                                        "kill -$s $p; done; done 2> /dev/null"));
    ASSERT_FALSE(log().empty()) << o.out;
    // Whoever is dying waits for no answer: the emulator may have been late with the value before. A fifth more.
    testing::WireRules rules;
    rules.jitter *= 1.2;
    ASSERT_EQ(testing::unsafe(events(), rules), "");
    expect_at_rest(log(), 6);
}

/// Ways to hold a dead-man's switch, as a person does: with a heartbeat, a foot switch, a key.
struct Switch {
    std::string name, option, before, runs, hold, end;
};

TEST_F(Usb, ThimblesFollowOnlyWhileTheSwitchIsHeld) {
    const std::string here = scratch.path.string(), port = std::to_string(20000 + ::getpid() % 30000);
    const std::string end = "kill -INT $p";
    for (const Switch& s : {
             Switch{"heartbeat", "heartbeat:" + port, "", "RUN &",
                    "bash -c 'for i in $(seq 16); do printf 1 > /dev/udp/127.0.0.1/" + port + "; sleep 0.05; done'",
                    end},
             Switch{"joystick", "joystick:" + here + "/js", "mkfifo js", "RUN &",
                    "(printf '\\0\\0\\0\\0\\1\\0\\1\\0'; sleep 0.8; printf '\\0\\0\\0\\0\\0\\0\\1\\0') > js", end},
             Switch{"key", "key", "mkfifo keys; exec 3<> keys", "script -qec 'RUN' /dev/null < keys &",
                    "for i in $(seq 20); do printf x >&3; sleep 0.04; done", "printf '\\003' >&3"},
         }) {
        std::string runs = s.runs;
        runs.replace(runs.find("RUN"), 3, run_command(scene(1, 0.6)) + " --duration 30 --hold " + s.option);
        std::ofstream(scratch.path / "go.sh")
            << "cd " << here << "; rm -f log_*\n"
            << s.before << "\n"
            << runs << "\np=$!\n"
            << "n=0; while [ $(wc -l < log) -lt 7 ] && [ $n -lt 400 ]; do sleep 0.05; n=$((n+1)); done; sleep 1\n"
            << "cp log log_before\n"
            << s.hold << "\ncp log log_held\nsleep 1.3\ncp log log_after\n"
            << s.end << "\nwait $p\n";
        const Outcome o = emulate("--at 7100" + logged(), "sh " + here + "/go.sh");
        auto told = [&](const char* when) {
            return testing::newest_targets(testing::read_wire_log(here + "/" + when));
        };
        auto rests = [&](const char* when) {
            const auto all = told(when);
            return std::all_of(all.begin(), all.end(), [](auto t) { return t.second == rest_pulse(t.first % 3); });
        };
        EXPECT_EQ(told("log_held").size(), 3u) << s.name << o.out;
        EXPECT_TRUE(rests("log_before")) << s.name << ": moved before it was held\n" << o.out;
        EXPECT_FALSE(rests("log_held")) << s.name << ": did not follow\n" << o.out;
        EXPECT_TRUE(rests("log_after")) << s.name << ": follows although it was let go\n" << o.out;
        expect_safe(events());
        std::filesystem::remove(scratch.path / "js"), std::filesystem::remove(scratch.path / "keys");
    }
}

/// A live hand that presses a ball, and then its tracker dies.
class TrackedUsb : public Usb {
  protected:
    void expect_rest_when_the_hand_is_gone(bool resends);
};

/// A tracker presses a thimble's finger on a ball for a second and a half; then it sends no more, or the last hand
/// again and again, as relays do whose own source has stalled.
void TrackedUsb::expect_rest_when_the_hand_is_gone(bool resends) {
    const std::string here = scratch.path.string(), port = std::to_string(20000 + (::getpid() + 13) % 30000);
    const std::string file = scene(1, 30);  // for its calibration
    std::ofstream(file)
        << "duration_s = 30\ndt_ms = 5\n[tracker]\ntracker_timeout_s = 0.5\nsource = \"udp:" << port
        << "\"\n[[object]]\nname = \"ball\"\nkind = \"sphere\"\nradius_mm = 12\nposition_mm = [0, 0, "
        << "100]\n[[finger]]\nname = \"index\"\nelements = 100\nshape = { finger = \"index\" }\nfollow = "
        << "\"index\"\ntrack = [ { t_s = 0, position_mm = [0, 60, 100] } ]\ndevice = { kind = "
        << "\"chinello-3rrs\", driver = \"maestro\", " << calibrated << ", channels = [0, 1, 2] }\n";
    std::ifstream recording(testing::source_dir() + "/scenes/pinch.jsonl");
    std::string last;
    for (std::string line; std::getline(recording, line);) last = line;
    nlohmann::json frame = nlohmann::json::parse(last);
    frame["units"] = "m", frame["up"] = "z";
    constexpr int frames = 75;
    for (int k = 1; k <= frames; ++k) {
        frame["t"] = 0.02 * k;
        std::ofstream(scratch.path / ("frame_" + std::to_string(k))) << frame;
    }
    const std::string send = " > /dev/udp/127.0.0.1/" + port + "; sleep 0.02; done'\n", n = std::to_string(frames);
    std::ofstream(scratch.path / "go.sh")
        << "cd " << here << "; rm -f log_*\n"
        << run_command(file) << " &\np=$!\n"
        << "n=0; while [ $(wc -l < log) -lt 7 ] && [ $n -lt 400 ]; do sleep 0.05; n=$((n+1)); done\n"
        << "bash -c 'for i in $(seq " << n << "); do cat frame_$i" << send << "cp log log_pressed\n"
        << (resends ? "bash -c 'for i in $(seq 160); do cat frame_" + n + send : "sleep 3.2\n")
        << "cp log log_silent\nkill -INT $p\nwait $p\n";
    const Outcome o = emulate("--at 6000" + logged(), "sh " + here + "/go.sh");
    auto rests = [&](const char* when) {
        const auto all = testing::newest_targets(testing::read_wire_log(here + "/" + when));
        return std::all_of(all.begin(), all.end(), [](auto t) { return t.second == rest_pulse(t.first % 3); });
    };
    EXPECT_FALSE(rests("log_pressed")) << "never pressed\n" << o.out;
    EXPECT_TRUE(rests("log_silent")) << o.out;
    EXPECT_SAYS(o, "its tracker was silent");
    if (resends) { EXPECT_SAYS(o, "time stands still"); }
    expect_safe(events());
}

TEST_F(TrackedUsb, WhereTheTrackerFallsSilentThimblesGoToRest) { expect_rest_when_the_hand_is_gone(false); }

TEST_F(TrackedUsb, WhereTheTrackersTimeStandsStillThimblesGoToRest) { expect_rest_when_the_hand_is_gone(true); }

TEST_F(Usb, AViewedSceneThatBeginsAgainDoesNotReArm) {
    const std::string port = std::to_string(20000 + (::getpid() + 7) % 30000);
    const Outcome o = emulate("--fault unplug@150 --replug-ms 100" + logged(),
                              "timeout -s INT 4 " + program + " view " + scene(1, 0.5) + " --arm --port " + port);
    ASSERT_TRUE(happened(testing::unplugged)) << o.out;
    ASSERT_TRUE(happened(testing::plugged_in)) << o.out;
    expect_latched(events(), 0);
    expect_safe(events());
}

/// An address of this machine that is not its loopback, or "".
std::string other_address() {
    ifaddrs* all = nullptr;
    std::string found;
    if (::getifaddrs(&all)) return "";
    for (const ifaddrs* a = all; a && found.empty(); a = a->ifa_next) {
        if (!a->ifa_addr || a->ifa_addr->sa_family != AF_INET || a->ifa_flags & IFF_LOOPBACK ||
            !(a->ifa_flags & IFF_UP))
            continue;
        char name[INET_ADDRSTRLEN] = "";
        ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(a->ifa_addr)->sin_addr, name, sizeof name);
        found = name;
    }
    ::freeifaddrs(all);
    return found;
}

TEST_F(Usb, FromAnotherAddressNobodyReArmsUnlessThatWasAskedFor) {
    const std::string away = other_address();
    if (away.empty()) GTEST_SKIP() << "this machine has no address but its loopback";
    struct Case {
        std::string address, option;
        bool may;
    };
    for (const Case& c : {Case{away, "--any-address", false}, Case{away, "--any-address --remote-arm", true},
                          Case{"127.0.0.1", "--any-address", true}}) {
        const std::string said = (scratch.path / "said").string();
        std::ofstream(said).close();
        const Outcome o =
            emulate("--fault unplug@150 --replug-ms 100" + logged(),
                    "sh -c '" + program + " view " + scene(1, 60) + " --arm --port 0 " + c.option + " > " + said +
                        " & p=$!; python3 " + testing::source_dir() + "/tests/devices/rearm_from.py " + c.address +
                        " " + said + "; kill -INT $p; wait $p'");
        SCOPED_TRACE(c.address + " " + c.option + "\n" + o.out);
        EXPECT_EQ(o.out.find("let in:"), std::string::npos);
        EXPECT_SAYS(o, "a page with the token is let in");
        EXPECT_SAYS(o, "told to newcomers: f0");
        ASSERT_TRUE(happened(testing::plugged_in));
        expect_safe(events());
        EXPECT_EQ(o.out.find("armed again") != std::string::npos, c.may);
        if (c.may) continue;
        EXPECT_SAYS(o, "answer: thimbles are armed: that takes someone at their machine, or view --remote-arm");
        expect_latched(events(), 0);
    }
}

/// A slow way to rest, which an orderly end would wait for, and then write its results.
TEST_F(Usb, ASecondCtrlCEndsAtOnceAfterTheRestPose) {
    for (const bool twice : {false, true}) {
        const Outcome o =
            emulate(logged(), meanwhile(run_command(scene(2, 30)) + " --set thimbles.velocity_rad_per_s=0.5",
                                        twice ? "kill -INT $p; sleep 0.1; kill -INT $p" : "kill -INT $p $p"));
        EXPECT_EQ(o.code, 130) << o.out;
        EXPECT_EQ(o.out.find("stopped early") == std::string::npos, twice) << o.out;
        EXPECT_EQ(std::filesystem::exists(scratch.path / "results" / "summary.json"), !twice);
        std::filesystem::remove_all(scratch.path / "results");
        expect_safe(events());
        expect_at_rest(log(), 6);
    }
}

TEST_F(Usb, HoweverTheProgramDiesThimblesAreAtRest) {
    // A stack that overflows, std::terminate, memory that is used up, SIGVTALRM, SIGPOLL.
    for (const std::string signal : {"-1", "-2", "-3", "26", "29"}) {
        Outcome o;
        for (int attempt = 0; attempt < 3; ++attempt) {  // the emulator's clock is judged: it must not stand still
            o = emulate("--at 6000" + logged(), probe + " --seconds 2 --die " + signal);
            if (testing::unsafe(events()).empty()) break;
        }
        EXPECT_GE(o.code, 128) << signal << o.out;
        expect_safe(events());
        expect_at_rest(log(), 15);
        if (HasFailure()) FAIL() << signal << o.out;
    }
}

TEST_F(Usb, WhatIsKnownOfTheRestPoseIsSaidAlthoughTheDiskIsFull) {
    const Outcome o = emulate(logged(), "sh -c 'ulimit -f 1; exec " + run_command(scene(1, 1)) + "'");
    EXPECT_EQ(o.code, 1) << o.out;
    EXPECT_SAYS(o, "cannot be written");
    EXPECT_SAYS(o, "thimbles are in their rest pose");
    expect_at_rest(log(), 3);
}

TEST_F(Usb, FaultsLatchAndAreReported) {
    for (const std::string fault : {"unplug@150", "hang@150",
                                    "stall@150 --fault stall@151 --fault stall@152 --fault "
                                    "stall@153 --fault stall@154 --fault stall@155"}) {
        const Outcome o = emulate("--fault " + fault + logged(), run_command(scene(5, 1.2)));
        // What hangs or is unplugged is nowhere that anybody knows; what stalls may be spoken to again.
        const bool lost = o.out.find("is not known to be in its rest pose") != std::string::npos;
        EXPECT_EQ(o.code, lost ? 1 : 0) << fault << o.out;
        EXPECT_TRUE(lost || fault[0] == 's') << fault << o.out;
        expect_safe(events());
        if (fault[0] != 's') {
            EXPECT_SAYS(o, " 5 faults");
            EXPECT_SAYS(o, "last problem");
        }
    }
    int number = 0;
    for (const std::string fault : {"sticky@150", "deaf@150", "bite@150", "unread@150", "race@150"}) {
        if (!testing::is_tried(number++, 3)) continue;
        const Outcome o = emulate("--fault " + fault + logged(), run_command(scene(5, 1.5)));
        EXPECT_EQ(o.code, 1) << fault << o.out;
        expect_safe(events());
        EXPECT_SAYS(o, " 5 faults");
        EXPECT_SAYS(o, "is not known to be in its rest pose");
        EXPECT_TRUE(std::filesystem::exists(scratch.path / "results" / "audit_maestro_00123456_1.csv"));
    }
    // One transfer that times out, and a reply too short or too long, are tried again.
    for (const std::string kind : {"timeout", "partial", "short", "long", "errors"}) {
        if (!testing::is_tried(number++, 3)) continue;
        const Outcome o = emulate("--fault " + kind + "@150" + logged(), run_command(scene(5, 1)));
        EXPECT_EQ(o.code, 0) << kind << o.out;
        EXPECT_SAYS(o, " 0 faults");
        expect_safe(events());
        expect_at_rest(log(), 15);
    }
}

TEST_F(Usb, AnySequenceOfFaultsStaysSafe) {
    const int runs = std::getenv("PALPATE_FAULT_RUNS") ? std::atoi(std::getenv("PALPATE_FAULT_RUNS")) : 20;
    const std::string file = scene(5, 0.35);
    for (int seed = 1; seed <= runs; ++seed) {
        const Outcome o =
            emulate("--random-faults " + std::to_string(seed) + " --replug-ms 100" + logged(), run_command(file));
        const bool lost = o.out.find("is not known to be in its rest pose") != std::string::npos;
        EXPECT_TRUE(o.code == 2 || o.code == (lost ? 1 : 0)) << "seed " << seed << ": " << o.code << "\n" << o.out;
        expect_safe(events());
        expect_latched(events(), 1);
        expect_true_words(o, 15);
        if (HasFailure()) FAIL() << "seed " << seed << "\n" << o.out;
    }
}

TEST_F(Usb, AnySequenceOfFaultsStaysSafeWhereAPersonReArmsAtOnce) {
    const int runs = std::getenv("PALPATE_FAULT_RUNS") ? std::atoi(std::getenv("PALPATE_FAULT_RUNS")) : 10;
    for (int seed = 1; seed <= runs; ++seed) {
        const Outcome o = emulate("--random-faults " + std::to_string(seed) + " --replug-ms 60" + logged(),
                                  probe + " --seconds 0.9 --rearm 1");
        EXPECT_LE(o.code, 2) << "seed " << seed << "\n" << o.out;
        expect_safe(events());
        if (o.out.find("thimbles are in their rest pose") != std::string::npos) expect_at_rest(log(), 15);
        if (HasFailure()) FAIL() << "seed " << seed << "\n" << o.out;
    }
}

TEST_F(Usb, UnpluggingLeavesNoMemoryBehindThatIsUsed) {
    if (shell("command -v valgrind").code != 0) GTEST_SKIP() << "valgrind is not installed";
    const Outcome o =
        emulate("--fault unplug@150 --replug-ms 100" + logged(),
                "valgrind -q --undef-value-errors=no --error-exitcode=99 " + probe + " --seconds 3 --rearm 1");
    EXPECT_LE(o.code, 2) << o.out;
    // Where the machine stands still, the first that valgrind's program sees of it may be transfers that do not end.
    EXPECT_TRUE(happened(testing::unplugged)) << o.out;
    EXPECT_SAYS(o, "active to faulted: ");
    EXPECT_EQ(o.out.find("Invalid"), std::string::npos) << o.out;
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
