// Controllers that one builds oneself: the text protocol, and its driver against the reference sketch, which runs here
// unchanged, on a clock that the tests move.

#include <pty.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

#include "devices/drivers/text_link.h"
#include "devices/drivers/text_protocol.h"
#include "tests/emulator/sketch_board.h"
#include "tests/real_time.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::RealTime;
using testing::SketchBoard;

std::span<const std::uint8_t> bytes_of(const std::string& s) {
    return {reinterpret_cast<const std::uint8_t*>(s.data()), s.size()};
}

TEST(TextProtocol, LinesAreWhole) {
    EXPECT_EQ(text::checksum("123456789"), 0x29B1) << "the published check of CRC-16/CCITT-FALSE";
    EXPECT_EQ(text::line_of(7, "hello").substr(0, 8), "7 hello*");
    const ChannelTarget targets[] = {{0, 1500}, {11, 900}};
    char out[text::longest_line];
    const std::size_t size = text::encode_targets(60000, "set", targets, out);
    EXPECT_EQ(std::string(out, size), text::line_of(60000, "set 0=1500 11=900"));
    EXPECT_EQ(text::encode_targets(1, "set", targets, std::span(out, 15)), 0u);
    EXPECT_EQ(sketch::crc_of("123456789", 9), 0x29B1);
}

TEST(TextProtocol, DamagedRepliesAreDropped) {
    const std::string good = text::line_of(12, "ok state=armed 3=1498");
    for (std::size_t i = 0; i + 1 < good.size(); ++i)
        for (int bit = 0; bit < 8; ++bit) {
            std::string bad = good;
            bad[i] = char(bad[i] ^ 1 << bit);
            text::ReplyReader reader;
            reader.add(bytes_of(bad));
            EXPECT_FALSE(reader.next()) << bad;
        }
    std::mt19937 random(5);
    for (int run = 0; run < 500; ++run) {
        text::ReplyReader reader;
        std::string noise;
        for (unsigned n = random() % 600; n > 0; --n) noise += char(random());
        const std::string line = noise + "\n" + good;
        int found = 0;
        for (std::size_t at = 0; at < line.size();) {
            const std::size_t piece = std::min<std::size_t>(1 + random() % 300, line.size() - at);
            reader.add(bytes_of(line.substr(at, piece)));
            at += piece;
            while (const auto r = reader.next()) {
                EXPECT_EQ(r->number, 12u);
                EXPECT_TRUE(r->ok);
                EXPECT_EQ(r->word("state"), "armed");
                EXPECT_EQ(r->value("3"), 1498);
                EXPECT_FALSE(r->value("state"));
                EXPECT_FALSE(r->value("4"));
                ++found;
            }
        }
        EXPECT_EQ(found, 1);
    }
}

/// A call that has to go well, but for answers that a busy machine gives too late.
template <class Call>
void must(Call call) {
    LinkProblem problem;
    for (int k = 0; k < 100; ++k)
        if (problem = call(); !problem || problem.kind != FaultKind::silent) break;
    EXPECT_FALSE(problem) << problem.text;
}

struct TextBench {
    SketchBoard board;
    std::unique_ptr<BoardLink> link;
    std::array<WireValue, max_channels> positions{};
    explicit TextBench(double speed_us_per_s = 600) {
        link = make_text_link({board.port, {0, 1, 2}, speed_us_per_s, true, 30});
        EXPECT_EQ(link->open(positions), "");
    }
    void arm() {
        must([&] { return link->activate(); });
        must([&] { return link->limit_speed(1); });
    }
    void set(int channel, int us) {
        const ChannelTarget target[] = {{channel, WireValue(us)}};
        Transfer transfers[1];
        must([&] { return link->write(target, transfers); });
        EXPECT_GT(transfers[0].arrived, 0);
    }
};

TEST(TextBoard, ServosFollowWithinTheBoardsOwnLimit) {
    TextBench bench;
    EXPECT_EQ(bench.positions[0], no_pulse) << "a servo without pulses is anywhere";
    EXPECT_EQ(bench.board.pulse(3), 0) << "nothing moves before it is armed";
    bench.arm();
    bench.set(0, 1500);
    bench.board.pass(10);
    EXPECT_EQ(bench.board.pulse(3), 1500);
    bench.set(0, 1800);
    bench.board.pass(100);
    EXPECT_NEAR(bench.board.pulse(3), 1560, 8);
    for (int k = 0; k < 6; ++k) {
        must([&] { return bench.link->feed(); });
        bench.board.pass(100);
    }
    EXPECT_EQ(bench.board.pulse(3), 1800);
    EXPECT_EQ(bench.board.pulse(5), 0);
    bench.board.expect_bounded(600);
    // Whoever opens it next learns where its servos are.
    bench.link->close();
    EXPECT_EQ(bench.link->open(bench.positions), "");
    EXPECT_EQ(bench.positions[0], 1800);
}

TEST(TextBoard, SilenceSendsServosHomeAndIsSeen) {
    TextBench bench;
    bench.arm();
    bench.set(1, 1500);
    bench.board.pass(190);
    EXPECT_EQ(bench.board.pulse(5), 1500);
    bench.board.pass(20);
    EXPECT_EQ(bench.board.pulse(5), 0) << "its home is to let go";
    EXPECT_EQ(sketch::board.state, sketch::board_home);
    LinkProblem problem;
    EXPECT_TRUE(eventually([&] { return (problem = bench.link->feed()).kind == FaultKind::watchdog; })) << problem.text;
    EXPECT_TRUE(problem.lost);
    const ChannelTarget target[] = {{1, 1600}};
    Transfer transfers[1];
    EXPECT_TRUE(eventually([&] { return bench.link->write(target, transfers).kind == FaultKind::watchdog; }));
    EXPECT_EQ(transfers[0].arrived, 0);
    bench.board.pass(20);
    EXPECT_EQ(bench.board.pulse(5), 0) << "nothing moves until it is armed anew";
    must([&] { return bench.link->activate(); });
    bench.set(1, 1600);
    bench.board.pass(10);
    EXPECT_EQ(bench.board.pulse(5), 1600);
    bench.link->deactivate();
    bench.board.pass(10);
    EXPECT_EQ(bench.board.pulse(5), 0);
}

TEST(TextBoard, HomeIsReachedSlowly) {
    const sketch::ServoConfig config[] = {{9, 900, 2100, 1500}};
    arduino::pulses.clear();
    for (auto& servo : sketch::outputs) servo = {};
    sketch::ServoBoard b;
    begin_board(b, config, 1, 0);
    auto say = [&](const std::string& words, unsigned long now) {
        for (const char c : text::line_of(1, words)) receive_byte(b, c, std::uint32_t(now));
    };
    say("speed 0=5000", 0), say("arm", 0), say("set 0=2100", 0);
    EXPECT_EQ(b.channel[0].at >> 8, 1500u) << "it starts where it was parked";
    for (unsigned long t = 0; t <= 200; t += 2) tick_board(b, std::uint32_t(t));
    EXPECT_EQ(b.channel[0].at >> 8, 2100u);
    tick_board(b, 202);  // the watchdog bites
    for (unsigned long t = 204; t <= 1204; t += 2) tick_board(b, std::uint32_t(t));
    EXPECT_NEAR(double(b.channel[0].at >> 8), 2100 - sketch::slow_us_per_s, 4);
    for (unsigned long t = 1204; t <= 2000; t += 2) tick_board(b, std::uint32_t(t));
    EXPECT_EQ(b.channel[0].at >> 8, 1500u);
}

/// Lines of commands with anything in them, damaged lines, and noise: nothing leaves range and speed, nothing moves
/// that was not armed, and the board goes on answering.
TEST(TextBoard, NoiseAndHostileLinesAreHarmless) {
    arduino::pulses.clear();
    arduino::clock_ms = 0;
    for (auto& servo : sketch::outputs) servo = {};
    sketch::setup();
    std::mt19937 random(8);
    const char* verbs[] = {"set", "set", "set", "speed", "watchdog", "about", "hello", "feed", "rest", "nonsense", ""};
    auto say = [&](std::string line) {
        for (const char c : line) receive_byte(sketch::board, c, std::uint32_t(arduino::clock_ms));
    };
    auto number = [&] { return std::to_string(random() % 5 ? random() % 2500 : random()); };
    for (int run = 0; run < 100'000; ++run) {
        if (run == 20'000) {
            const std::lock_guard lock(arduino::pulses_mutex);
            EXPECT_TRUE(arduino::pulses.empty()) << "nothing moves before it is armed";
        }
        std::string words = run >= 20'000 && random() % 10 == 0 ? "arm" : verbs[random() % std::size(verbs)];
        for (unsigned k = random() % 4; k > 0; --k)
            words.append(" ").append(std::to_string(random() % 8)).append(random() % 20 ? "=" : " ").append(number());
        std::string line = text::line_of(unsigned(random() % 60001), words);
        if (random() % 3 == 0) line[random() % line.size()] = char(random());
        if (random() % 50 == 0) line = std::string(random() % 400, char(random()));
        say(line);
        arduino::clock_ms += random() % 7;
        tick_board(sketch::board, std::uint32_t(arduino::clock_ms));
    }
    SketchBoard::expect_bounded(20000);
    EXPECT_GT(arduino::pulses.size(), 1000u);
    say("\n");
    say(text::line_of(1, "watchdog 200") + text::line_of(2, "arm") + text::line_of(3, "set 0=1500"));
    for (int k = 0; k < 100; ++k) {
        arduino::clock_ms += 2;
        tick_board(sketch::board, std::uint32_t(arduino::clock_ms));
    }
    EXPECT_EQ(sketch::board.state, sketch::board_armed);
}

TEST(TextBoard, TheProgramDrivesIt) {
    SketchBoard board;
    const testing::ScratchFolder scratch;
    const auto scene = scratch.path / "scene.toml", results = scratch.path / "results";
    std::ofstream(scratch.path / "cal.toml")
        << "[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 1000\nmax_us = 2000\n"
        << "[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 1000\nmax_us = 2000\n"
        << "[[servo]]\nzero_us = 1500\nus_per_rad = 636.62\nmin_us = 1000\nmax_us = 2000\n";
    std::ofstream(scene) << "duration_s = 2\ndt_ms = 2\n[solver]\npreset = \"real-time\"\n"
                         << "[[object]]\nname = \"table\"\nkind = \"plane\"\n"
                         << "[[finger]]\nname = \"index\"\nelements = 100\n"
                         << "device = { kind = \"chinello-3rrs\", driver = \"text\", port = \"" << board.port
                         << "\", calibration = \"cal.toml\", channels = [0, 1, 2] }\n"
                         << "track = [ { t_s = 0, position_mm = [0, 0, 9] }, { t_s = 1, position_mm = [0, 0, 6.5], "
                         << "rotation_deg = [10, 0, 0] } ]\n";
    const RealTime clock;
    const std::string run =
        testing::program_path() + " run " + scene.string() + " --arm --no-picture --out " + results.string() + " 2>&1";
    testing::Outcome o;
    for (int attempt = 0; attempt < 4; ++attempt) {  // a computer that stands still for 0.1 s is a fault, rightly
        o = testing::shell(run);
        if (o.out.find(" 0 faults") != std::string::npos && o.out.find("are in their rest") != std::string::npos) break;
    }
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_NE(o.out.find("thimbles are in their rest pose"), std::string::npos) << o.out;
    EXPECT_NE(o.out.find(" 0 faults"), std::string::npos) << o.out;
    board.expect_bounded(6 * 636.62, 20);
    {
        const std::lock_guard lock(arduino::pulses_mutex);
        EXPECT_GT(arduino::pulses.size(), 30u);
    }
    // What is said to have been sent are whole microseconds, as on the wire.
    std::ifstream rows(results / "index.csv");
    std::string names, row, cell;
    for (std::string next; std::getline(rows, names.empty() ? names : next);)
        if (!next.empty()) row = next;
    std::istringstream columns(names), cells(row);
    for (std::string column; std::getline(columns, column, ',') && std::getline(cells, cell, ',');) {
        if (!column.starts_with("sent")) continue;
        const double us = 1500 + 636.62 * std::atof(cell.c_str()) * degree;
        EXPECT_NEAR(us, std::round(us), 1e-3) << column;
    }
    // Killed, it leaves the rest to the board: silence sends its servos home, which is to let go.
    const testing::Outcome killed = testing::shell("sh -c '" + run + " & p=$!; sleep 1.2; kill -KILL $p; wait $p'");
    EXPECT_EQ(killed.code, 128 + 9) << killed.out;
    EXPECT_TRUE(eventually([&] { return board.pulse(3) == 0 && board.pulse(5) == 0 && board.pulse(6) == 0; }));
}

TEST(TextBoard, WhatIsNoSuchBoardIsRefused) {
    std::array<WireValue, max_channels> positions{};
    SketchBoard board;
    auto open = [&](const TextLinkSettings& settings) { return make_text_link(settings)->open(positions); };
    EXPECT_NE(open({board.port, {0, 6}, 600, true, 30}).find("channels 0 to 5, not 6"), std::string::npos);
    EXPECT_NE(open({"/dev/no-such-port", {0}, 600, true, 30}).find("cannot be opened"), std::string::npos);
    EXPECT_NE(open({"/dev/null", {0}, 600, true, 30}).find("not a serial port"), std::string::npos);
    board.hang();
    const std::string silent = open({board.port, {0}, 600, true, 0.2});
    EXPECT_NE(silent.find("no answer"), std::string::npos) << silent;
}

/// A board that somebody else programmed: it answers what the test wants.
class ScriptedBoard {
  public:
    std::string port;
    std::atomic<bool> told{false};  ///< it was armed, or told a target
    explicit ScriptedBoard(std::map<std::string, std::string> answers) : answers_(std::move(answers)) {
        char name[256];
        if (openpty(&master_, &slave_, name, nullptr, nullptr) != 0) throw std::runtime_error("no pty");
        port = name;
        thread_ = std::thread([this] {
            for (std::string in; !stop_;) {
                char c = 0;
                timeval wait{0, 5000};
                fd_set set;
                FD_ZERO(&set);
                FD_SET(master_, &set);
                if (::select(master_ + 1, &set, nullptr, nullptr, &wait) <= 0 || ::read(master_, &c, 1) != 1) continue;
                if (c != '\n') {
                    in += c;
                    continue;
                }
                const unsigned number = unsigned(std::atoi(in.c_str()));
                const std::string words = in.substr(in.find(' ') + 1, in.rfind('*') - in.find(' ') - 1);
                const std::string verb = words.substr(0, words.find(' '));
                told = told || verb == "arm" || verb == "set";
                const auto answer = answers_.find(verb);
                const std::string line = text::line_of(number, answer == answers_.end() ? "ok" : answer->second);
                [[maybe_unused]] const auto n = ::write(master_, line.data(), line.size());
                in.clear();
            }
        });
    }
    ~ScriptedBoard() {
        stop_ = true;
        thread_.join();
        ::close(master_);
        ::close(slave_);
    }

  private:
    std::map<std::string, std::string> answers_;
    int master_ = -1, slave_ = -1;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

TEST(TextBoard, SettingsThatSafetyRestsOnAreReadBack) {
    const std::string hello = "ok palpate=1 channels=6 watchdog=", about = "ok min=900 max=2100 home=0 at=0 speed=";
    struct Case {
        std::map<std::string, std::string> answers;
        const char* says;  ///< "": it is taken
        bool without_watchdog;
    };
    for (const Case& c : std::vector<Case>{
             {{{"hello", hello + "200 state=idle"}, {"about", about + "100 measured=0"}}, "", true},
             {{{"hello", hello + "1000 state=idle"}, {"about", about + "100"}}, "reads back as 1000 ms", true},
             {{{"hello", hello + "0 state=idle"}, {"about", about + "100"}}, "reads back as 0 ms", true},
             {{{"hello", hello + "never state=idle"}, {"about", about + "100"}}, "reads back as nothing", true},
             {{{"hello", "ok palpate=1 channels=6 state=idle"}, {"about", about + "100"}},
              "reads back as nothing",
              true},
             {{{"hello", hello + "200"}, {"watchdog", "err range"}, {"about", about + "100"}}, "refuses: range", true},
             {{{"hello", hello + "200"}, {"about", about + "20000"}}, "speed limit of channel 0", false},
             {{{"hello", hello + "200"}, {"about", "ok min=900 max=2100"}}, "speed limit of channel 0", false},
             {{{"hello", hello + "200"}, {"about", "ok min=900 max=2100 at=2600 speed=100"}},
              "channel 0 stands at 2600 us, and the board allows 900 to 2100 us",
              false},
             {{{"hello", hello + "200"}, {"about", "ok min=900 max=2100 at=1500 measured=800 speed=100"}},
              "channel 0 stands at 800 us",
              false},
         }) {
        ScriptedBoard board(c.answers);
        for (const bool need : {true, false}) {
            std::array<WireValue, max_channels> positions{};
            std::string found = "no answer";
            for (int k = 0; k < 20 && found.find("no answer") != std::string::npos; ++k)
                found = make_text_link({board.port, {0, 1}, 600, need, 30})->open(positions);
            const bool taken = *c.says == '\0' || (!need && c.without_watchdog);
            EXPECT_EQ(found.empty(), taken) << c.says << ", found: " << found;
            if (!taken) {
                EXPECT_NE(found.find(c.says), std::string::npos) << found;
                EXPECT_EQ(found.find("--no-watchdog") != std::string::npos, c.without_watchdog) << found;
            }
        }
        EXPECT_FALSE(board.told) << "nothing is armed by opening it";
    }
}

}  // namespace
}  // namespace palpate
