// Several boards under the unmodified program: what happens to one is nothing to the others.

#include "tests/devices/usb_fixture.h"
#include "tests/emulator/servo_bus.h"
#include "tests/emulator/sketch_board.h"

namespace palpate {
namespace {

constexpr const char* first = "00123456";
constexpr const char* second = "00123457";

/// Who drives a finger.
struct Seat {
    std::string driver, where;  ///< a key and its value, of a device
    bool turns = true;          ///< to and fro; otherwise the finger touches nothing
};
Seat maestro(const std::string& serial, bool turns = true) { return {"maestro", "serial = \"" + serial + "\"", turns}; }

class Boards : public Usb {
  protected:
    /// A finger per seat, each pressed on the same table, turned to and fro.
    std::string seated(const std::vector<Seat>& seats, double seconds) {
        std::ofstream us(scratch.path / "us.toml"), ticks(scratch.path / "ticks.toml");
        ticks << "unit = \"ticks\"\n";
        for (int k = 0; k < 3; ++k) {
            us << "[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 1000\nmax_us = 2000\n";
            ticks << "[[servo]]\nzero_ticks = 2048\nticks_per_rad = 651.9\nmin_ticks = 1536\nmax_ticks = 2560\n";
        }
        const auto path = scratch.path / "boards.toml";
        std::ofstream out(path);
        out << "duration_s = " << seconds << "\ndt_ms = 2\n[solver]\npreset = \"real-time\"\nprecision = \"float\"\n"
            << "[[object]]\nname = \"table\"\nkind = \"plane\"\n";
        for (std::size_t i = 0; i < seats.size(); ++i) {
            const Seat& s = seats[i];
            const bool bus = s.driver == "dynamixel";
            out << "[[finger]]\nname = \"f" << i
                << "\"\nelements = 100\ndevice = { kind = \"chinello-3rrs\", driver = \"" << s.driver << "\", "
                << s.where << ", calibration = \"" << (bus ? "ticks" : "us")
                << ".toml\", channels = " << (bus ? "[1, 2, 3]" : "[0, 1, 2]") << " }\ntrack = [ { t_s = 0, "
                << "position_mm = [" << 30 * i << ", 0, 9] }";
            for (int k = 1; s.turns && 0.4 * k < seconds; ++k)
                out << ", { t_s = " << 0.4 * k << ", position_mm = [" << 30 * i << ", 0, 6.5], rotation_deg = ["
                    << (k % 2 ? 10 : -10) << ", 0, 0] }";
            out << " ]\n";
        }
        return path.string();
    }
    /// What one board heard.
    std::vector<Target> of_board(int board) const {
        std::vector<Target> out;
        for (const Target& t : events())
            if (t.board == board) out.push_back(t);
        return out;
    }
    static int first_board(const std::vector<Target>& all, int event) {
        const auto e = std::find_if(all.begin(), all.end(), [&](const Target& t) { return t.channel == event; });
        return e == all.end() ? -1 : e->board;
    }
    static double first_time(const std::vector<Target>& all, int event) {
        const auto e = std::find_if(all.begin(), all.end(), [&](const Target& t) { return t.channel == event; });
        return e == all.end() ? HUGE_VAL : e->time;
    }
    static int told_after(const std::vector<Target>& all, double time) {
        return int(
            std::count_if(all.begin(), all.end(), [&](const Target& t) { return t.channel >= 0 && t.time > time; }));
    }
};

TEST_F(Boards, WhereOneIsUnpluggedTheOthersGoOn) {
    const Outcome o = emulate("--boards 2 --fault unplug@200 --replug-ms 0" + logged(),
                              run_command(seated({maestro(first), maestro(second)}, 3)));
    EXPECT_EQ(o.code, 1) << o.out;
    const int lost = first_board(events(), testing::unplugged);
    ASSERT_GE(lost, 0) << o.out;
    const double when = first_time(events(), testing::unplugged);
    const auto well = of_board(1 - lost), gone = of_board(lost);
    expect_safe(well);
    expect_safe(gone);
    EXPECT_EQ(told_after(gone, when), 0);
    EXPECT_GT(told_after(well, when), 50) << o.out;
    expect_at_rest(well, 3);
    const std::string name = "f" + std::to_string(lost), other = "f" + std::to_string(1 - lost);
    EXPECT_SAYS(o, name + " is not known to be in its rest pose");
    EXPECT_EQ(o.out.find(other + " is not known"), std::string::npos) << o.out;
}

/// USB never gives back what was sent to it.
TEST_F(Boards, WhereOneHangsTheOthersGoOn) {
    const Outcome o =
        emulate("--boards 2 --fault hang@200" + logged(), run_command(seated({maestro(first), maestro(second)}, 3)));
    EXPECT_EQ(o.code, 1) << o.out;
    EXPECT_SAYS(o, " 1 faults");
    for (const int board : {0, 1}) {
        expect_safe(of_board(board));
        const std::string name = "f" + std::to_string(board);
        if (o.out.find(name + " is not known") == std::string::npos) expect_at_rest(of_board(board), 3);
    }
    EXPECT_NE(o.out.find("f0 is not known") == std::string::npos, o.out.find("f1 is not known") == std::string::npos)
        << o.out;
}

/// A person unplugs both, and takes the wrong socket for each: a finger's thimble is the one with its serial number.
TEST_F(Boards, WhoeverIsPluggedInElsewhereIsKnownByItsSerialNumber) {
    std::ofstream(scratch.path / "go.sh")
        << "cd " << scratch.path.string() << "; mkfifo keys; exec 3<> keys\n"
        << "script -qec '" << run_command(seated({maestro(first), maestro(second, false)}, 6))
        << "' /dev/null < keys &\np=$!\n"
        << "for n in 1 2 3 4 5 6 7 8 9 10 11 12; do sleep 0.5; printf '\\n' >&3; done; wait $p\n";
    const Outcome o = emulate("--boards 2 --swap 1 --fault unplug@200 --fault unplug@201 --replug-ms 300" + logged(),
                              "sh " + (scratch.path / "go.sh").string());
    // f0 turns, f1 does not: before, board 0 is told more, and after, board 1.
    std::array<int, 2> after{};
    for (const int board : {0, 1}) {
        const auto all = of_board(board);
        const double gone = first_time(all, testing::unplugged);
        ASSERT_LT(gone, HUGE_VAL) << o.out;
        expect_safe(all);
        after[std::size_t(board)] = told_after(all, gone);
        EXPECT_GT(after[std::size_t(board)], 0) << "nobody re-armed it\n" << o.out;
    }
    EXPECT_GT(after[1], 2 * after[0]) << o.out;
}

TEST_F(Boards, TwoWithOneSerialNumberAreRefused) {
    const Outcome o = emulate("--boards 2 --same 1" + logged(), run_command(seated({maestro(first)}, 1)));
    EXPECT_EQ(o.code, 2) << o.out;
    EXPECT_TRUE(log().empty());
    EXPECT_SAYS(o, "have the serial number 00123456");
}

TEST_F(Boards, AllNoticeThatTheProgramWasStopped) {
    const Outcome o = emulate("--boards 2 --bites 1" + logged(),
                              meanwhile(run_command(seated({maestro(first), maestro(second)}, 2.5)),
                                        "kill -STOP $p; sleep 0.6; kill -CONT $p"));
    for (const int board : {0, 1}) {
        const auto all = of_board(board);
        ASSERT_LT(first_time(all, testing::watchdog_bit), HUGE_VAL) << o.out;
        expect_safe(all);
        expect_latched(all, 0, 1);
    }
    EXPECT_EQ(o.out.find("thimbles are in their rest pose"), std::string::npos) << o.out;
}

/// Neither what is recorded nor the audit of the fault can be written: that changes nothing for the other board.
TEST_F(Boards, OneFaultsOnAFullDiskAndTheOtherGoesOn) {
    int went_on = 0;
    for (const std::string blocks : {"0", "1", "8"}) {  // of 512 bytes
        const Outcome o = emulate("--boards 2 --fault unplug@120 --replug-ms 0" + logged(),
                                  "sh -c 'ulimit -f " + blocks + "; exec " +
                                      run_command(seated({maestro(first), maestro(second)}, 1.5)) + "'");
        const auto all = events();
        if (!happened(testing::unplugged)) continue;
        ++went_on;
        EXPECT_EQ(o.code, 1) << blocks << o.out;
        EXPECT_SAYS(o, "cannot be written");
        const int lost = first_board(all, testing::unplugged);
        expect_safe(of_board(0));
        expect_safe(of_board(1));
        EXPECT_EQ(told_after(of_board(lost), first_time(all, testing::unplugged)), 0) << o.out;
        EXPECT_GT(told_after(of_board(1 - lost), first_time(all, testing::unplugged)), 10) << o.out;
        expect_at_rest(of_board(1 - lost), 3);
        EXPECT_SAYS(o, "f" + std::to_string(lost) + " is not known to be in its rest pose");
    }
    EXPECT_GE(went_on, 2);
}

/// Two on USB, a bus of servos and a board of one's own, each on a port. Where the computer stands still ports are
/// silent, which is a fault, rightly, of theirs alone.
TEST_F(Boards, OfEveryKindAtOnce) {
    int lost = -1;
    for (int attempt = 0; attempt < 5 && lost < 0; ++attempt) {  // again where a port was silent as it was opened
        testing::ServoBusEmulator bus(SerialProtocol::dynamixel, {1, 2, 3});
        testing::SketchBoard text;
        const testing::RealTime clock;
        const std::string scene = seated({maestro(first),
                                          maestro(second),
                                          {"dynamixel", "port = \"" + bus.port + "\""},
                                          {"text", "port = \"" + text.port + "\""}},
                                         2.5);
        const Outcome o = emulate("--boards 2 --fault unplug@250 --replug-ms 0" + logged(), run_command(scene));
        lost = first_board(events(), testing::unplugged);
        if (o.code == 2 || lost < 0) continue;
        expect_safe(of_board(0));
        expect_safe(of_board(1));
        EXPECT_EQ(told_after(of_board(lost), first_time(events(), testing::unplugged)), 0) << o.out;
        expect_at_rest(of_board(1 - lost), 3);
        text.expect_bounded(6 * 636.62, 20);
        for (const auto& [id, goal] : bus.goals()) EXPECT_TRUE(goal >= 1536 && goal <= 2560) << id << ": " << goal;
        for (int i = 0; i < 4; ++i) {
            const std::string unknown = "f" + std::to_string(i) + " is not known to be in its rest pose: ";
            const auto said = o.out.find(unknown);
            if (i < 2) {
                EXPECT_EQ(said != std::string::npos, i == lost) << o.out;
            } else if (said != std::string::npos) {
                const std::string why = o.out.substr(said, o.out.find('\n', said) - said);
                EXPECT_TRUE(why.find("silent: ") != std::string::npos || why.find("watchdog") != std::string::npos ||
                            why.find("servo: ") != std::string::npos)
                    << why;
            }
        }
    }
    if (lost < 0) GTEST_SKIP() << "the computer stood still whenever ports were opened";
}

}  // namespace
}  // namespace palpate
