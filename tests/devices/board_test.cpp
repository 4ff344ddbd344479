// Boards whose links are of our own: what is sent, what latches, what is written down.

#include <fstream>
#include <thread>

#include "devices/drivers/board.h"
#include "devices/loop/device_thread.h"
#include "tests/devices/fake_link.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::FakeLink;
using testing::FakeState;

TEST(Board, SendsOnlyWhatChanged) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    for (int k = 0; k < 5; ++k) {
        board.limit(2, wire_limits({}, 4, 6));
        board.limit(3, wire_limits({}, 4, 6));
        board.set(2, 6000);
        board.set(3, 6100);
        board.set(4, 6200);  // without limits
        board.wake();
        board.drain();
    }
    EXPECT_EQ(state.seen.size(), 2u);  // both unknown: sent as they are
    EXPECT_EQ(board.position(0), 5000);
    EXPECT_EQ(board.position(2), 6000);
}

TEST(Board, OneFailureIsTriedAgainManyAreALoss) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, wire_limits({}, 4, 6));
    state.refuse = true;
    board.set(1, 6000);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.status().failures > 0; }));
    state.refuse = false;
    ASSERT_TRUE(eventually([&] { return board.position(1) == 6000; }));
    EXPECT_EQ(board.state(), BoardState::active);
    state.refuse = true;
    board.set(1, 6400);
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::faulted; }));
    EXPECT_EQ(board.status().problem, "refused");
    EXPECT_EQ(board.status().fault, FaultKind::refused);
    EXPECT_EQ(state.lets_go, 1);
}

/// A process that was stopped while the controller told how it is knows nothing of what came after: it asks again
/// before it tells a servo anything.
TEST(Board, AnAnswerThatCameLateIsAskedForAgain) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, wire_limits({}, 4, 6));
    for (int k = 1; k <= 5; ++k) {
        state.feed_delay_ms = 150;
        ASSERT_TRUE(eventually([&] { return state.feed_delay_ms == 0; }));
        board.set(1, WireValue(6000 + 20 * k));  // waits already when the answer comes
        board.wake();
        ASSERT_TRUE(eventually([&] { return board.arrived(1) == 6000 + 20 * k; }));
    }
    const std::lock_guard lock(state.mutex);
    EXPECT_NE(state.calls.find("Ff"), std::string::npos) << state.calls;
    EXPECT_EQ(state.calls.find("Fw"), std::string::npos) << state.calls;
}

TEST(Board, AServoThatRefusesLatchesWhileOthersMove) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    for (int c : {1, 2, 3}) board.limit(c, {4000, 8000, 1e5});
    state.deaf = 2;
    const double began = device_clock();
    for (int k = 0; k < 1000 && board.state() == BoardState::active; ++k) {
        for (int c : {1, 2, 3}) board.set(c, WireValue(6000 + k % 100));
        board.wake();
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EXPECT_EQ(board.state(), BoardState::faulted) << "good writes elsewhere hid it";
    EXPECT_GE(device_clock() - began, AnswerWatch::answer_time);
    const BoardStatus status = board.status();
    EXPECT_GE(status.write_failures[2], 2);
    EXPECT_EQ(status.write_failures[1], 0);
    EXPECT_GT(status.values, 0);
}

TEST(Board, AnErrorThatStaysLatchesWhileTheHandMoves) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, {4000, 8000, 1e5});
    state.complain = true;
    for (int k = 0; k < 1000 && board.state() == BoardState::active; ++k) {
        board.set(1, WireValue(6000 + k % 100));
        board.wake();
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EXPECT_EQ(board.status().fault, FaultKind::reported) << "good writes hid it";
    const std::lock_guard lock(state.mutex);
    EXPECT_EQ(state.calls.find("xw"), std::string::npos) << "told without knowing how it is: " << state.calls;
}

TEST(Board, TheFirstMoveIsSlowWhereverServosAre) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    const WireLimits limits{4000, 8000, 12000};
    board.limit(0, limits);  // found at 5000
    board.limit(1, limits);  // nobody knows where it is
    const double began = device_clock();
    board.set(0, 6500), board.set(1, 6500);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.position(0) == 6500; }));
    EXPECT_GT(device_clock() - began, 0.7 * 1500 / (12000 * first_move_share));
    {
        const std::lock_guard lock(state.mutex);
        EXPECT_TRUE(state.speed_shares.empty()) << "the controller's own limit stays low meanwhile";
    }
    ASSERT_TRUE(eventually([&] {
        const std::lock_guard lock(state.mutex);
        return !state.speed_shares.empty();
    }));
    EXPECT_EQ(state.speed_shares.back(), 1);
    EXPECT_GT(device_clock() - began, 1.5) << "long enough for a servo that came from anywhere";
}

TEST(Board, AServoThatStandsOutOfRangeComesBackSlowly) {
    for (const int found : {11000, 1000}) {
        FakeState state;
        state.found = found;
        Board board(std::make_unique<FakeLink>(state));
        board.limit(0, {4000, 8000, 12000});
        const double began = device_clock(), speed = 12000 * first_move_share;
        const int wanted = found > 8000 ? 7500 : 4500, way = std::abs(found - wanted);
        board.set(0, WireValue(wanted));
        board.wake();
        ASSERT_TRUE(eventually([&] { return board.position(0) == wanted; }));
        EXPECT_GT(device_clock() - began, 0.9 * way / speed);
        ASSERT_TRUE(eventually([&] {
            const std::lock_guard lock(state.mutex);
            return !state.speed_shares.empty();
        }));
        EXPECT_GT(device_clock() - began, 1.1 * way / speed) << "its controller's own limit stays low meanwhile";
        const std::lock_guard lock(state.mutex);
        int last = found;
        for (const ChannelTarget& t : state.seen) {
            EXPECT_LE(std::abs(t.value - last), speed * 0.03 + 1) << last << " to " << t.value;
            EXPECT_LE(std::abs(t.value - wanted), std::abs(last - wanted));
            last = t.value;
        }
    }
}

/// Who follows a hand that never stands still has caught up where it meets it.
TEST(Board, AHandThatNeverStandsStillEndsTheFirstMoveWhereItIsMet) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(0, {4000, 8000, 12000});
    const double began = device_clock();
    ASSERT_TRUE(eventually([&] {
        board.set(0, WireValue(6000 + 1500 * std::sin(8 * (device_clock() - began))));
        board.wake();
        const std::lock_guard lock(state.mutex);
        return !state.speed_shares.empty();
    }));
}

TEST(Board, AgesAreThoseOfPosesAtTheWire) {
    FakeState state;
    state.delay_ms = 20;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, {4000, 8000, 1e6});
    for (int k = 0; k < 5; ++k) {
        board.set(1, WireValue(6000 + k), device_clock() - 0.005);
        board.wake();
        board.drain(5);
    }
    EXPECT_EQ(board.age(1).count(), 5);
    EXPECT_GE(board.age(1).quantile(0.01), 0.025) << "5 ms before it was sent, 20 ms on the way";
    board.set(1, 7000);
    board.wake();
    board.drain(5);
    EXPECT_EQ(board.age(1).count(), 5) << "no pose is behind it";
}

TEST(Board, AgesAreThoseOfEachTransfer) {
    FakeState state;
    state.apart_ms = 50;  // the second arrives later than the first
    Board board(std::make_unique<FakeLink>(state));
    for (int c : {1, 2}) board.limit(c, {4000, 8000, 1e6});
    const double pose_at = device_clock();
    for (int c : {1, 2}) board.set(c, 6000, pose_at);
    board.wake();
    ASSERT_TRUE(board.drain(5));
    EXPECT_NEAR(board.newest_age(2) - board.newest_age(1), 0.05, 1e-3);
}

/// Five thimbles of one controller, as five fingers of a hand: it is woken once a tick, and told once.
TEST(DeviceThreads, ThimblesThatShareAControllerAreToldInOneWrite) {
    FakeState state;
    state.delay_ms = 4;  // one write after the other would be noticed
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    std::vector<std::unique_ptr<ThimbleLoop>> loops;
    std::vector<ThimbleLoop*> all;
    for (int t = 0; t < 5; ++t) {
        loops.push_back(std::make_unique<ThimbleLoop>());
        initialise(*loops.back(), find_kind("chinello-3rrs")->defaults(), {},
                   make_board_driver(board, {3 * t, 3 * t + 1, 3 * t + 2}, std::vector<ServoCalibration>(3), {}));
        all.push_back(loops.back().get());
    }
    std::int64_t ticks = 0, wakes = 0, writes = 0;
    {
        DeviceThread thread(all);
        for (int k = 0; k < 120; ++k) {
            const double sampled_at = device_clock();
            for (ThimbleLoop* loop : all) {
                loop->pose_stamps.add(sampled_at, sampled_at), loop->pose_stamps.done(device_clock());
                const double angle = 0.1 * std::sin(0.3 * k);
                loop->mailbox.publish({0, Eigen::Vector3d(angle, -angle, angle), true, sampled_at});
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
        ticks = all[0]->status.ticks, wakes = board->status().wakes, writes = board->status().writes;
    }
    EXPECT_GE(ticks, 100);
    EXPECT_LE(wakes, ticks + 10) << "five thimbles, one wake a tick";
    EXPECT_GE(wakes, ticks / 2);
    std::size_t whole = 0, parts = 0;
    const std::lock_guard lock(state.mutex);
    for (std::size_t k = state.counts.size() / 2; k < std::min(std::size_t(writes), state.counts.size()); ++k)
        (state.counts[k] == 15 ? whole : parts) += 1;
    EXPECT_GT(whole, 2 * parts) << "servos that move together are told together";
}

TEST(Board, FaultsAreWrittenDownWithWhatWasSentBefore) {
    testing::ScratchFolder scratch;
    FakeState state;
    Board board(std::make_unique<FakeLink>(state), scratch.path / "not" / "there" / "audit_fake");
    board.limit(1, {4000, 8000, 1e6});
    board.set(1, 6000, device_clock() - 0.005);
    board.wake();
    board.drain(5);
    state.there = false;
    state.vanish = true;
    ASSERT_TRUE(eventually([&] { return std::filesystem::exists(scratch.path / "not/there/audit_fake_1.csv"); }));
    std::string all;
    ASSERT_TRUE(eventually([&] {
        std::ifstream in(scratch.path / "not/there/audit_fake_1.csv");
        all.assign(std::istreambuf_iterator<char>(in), {});
        return all.find(",1,target,6000,1,") != std::string::npos;
    }));
    EXPECT_NE(all.find("inactive to active: armed"), std::string::npos) << all;
    EXPECT_NE(all.find("active to faulted: unplugged: gone"), std::string::npos) << all;
    state.vanish = false;
    state.there = true;
    ASSERT_TRUE(eventually([&] { return board.rearm(); }));
    const auto transitions = board.status().transitions;
    std::string way;
    for (const auto& t : transitions) way += std::string(name(t.to)) + " ";
    EXPECT_EQ(way, "inactive active faulted inactive active ");
    for (std::size_t k = 1; k < transitions.size(); ++k) {
        EXPECT_GE(transitions[k].at, transitions[k - 1].at);
        EXPECT_EQ(transitions[k].from, transitions[k - 1].to);
        EXPECT_FALSE(transitions[k].reason.empty());
    }
}

TEST(Board, AnAuditThatCannotBeWrittenIsSaidAndLeavesNoPart) {
    testing::ScratchFolder scratch;
    FakeState state;
    std::ofstream(scratch.path / "file") << "";
    Board board(std::make_unique<FakeLink>(state), scratch.path / "file" / "audit");
    Board full(std::make_unique<FakeLink>(state), scratch.path / "audit");
    std::filesystem::create_symlink("/dev/full", scratch.path / "audit_1.csv.part");
    state.there = false;
    state.vanish = true;
    for (Board* b : {&board, &full}) EXPECT_TRUE(eventually([&] { return !b->status().lost_audits.empty(); }));
    EXPECT_NE(board.status().lost_audits.find("audit_1.csv"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(std::filesystem::symlink_status(scratch.path / "audit_1.csv.part")));
    EXPECT_FALSE(std::filesystem::exists(scratch.path / "audit_1.csv"));
}

TEST(Board, WhatWasWantedBeforeALossIsNotSentAfterIt) {
    FakeState state;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    DeviceModel model = find_kind("chinello-3rrs")->defaults();
    ThimbleLoop loop;
    initialise(loop, model, {}, make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), {}));
    double t = 0;
    tick(loop, t += 0.02);
    board->drain();
    state.there = false;
    state.vanish = true;
    ASSERT_TRUE(eventually([&] { return board->state() == BoardState::faulted; }));
    tick(loop, t += 0.02);
    EXPECT_EQ(loop.status.mode, ThimbleMode::fault);
    {
        const std::lock_guard lock(state.mutex);
        state.seen.clear();
    }
    EXPECT_FALSE(rearm(loop, t));
    state.vanish = false;
    state.there = true;
    ASSERT_TRUE(eventually([&] { return board->status().opened == 2; }));
    tick(loop, t += 0.02);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    EXPECT_EQ(loop.status.mode, ThimbleMode::fault);
    EXPECT_TRUE(state.seen.empty());  // latched, although it is back
    EXPECT_TRUE(eventually([&] { return rearm(loop, t); }));
    tick(loop, t += 0.02);
    board->drain();
    EXPECT_FALSE(state.seen.empty());
    EXPECT_EQ(loop.status.mode, ThimbleMode::resting);
}

TEST(Board, ASlowControllerDelaysNoTick) {
    FakeState state;
    state.delay_ms = 150;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    auto driver = make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), {});
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < 200; ++k) driver->send(Eigen::Vector3d(0.001 * k, 0, 0), 0.02 * k);
    // Two hundred sends would take half a minute if they waited; this bound is far from both.
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

TEST(DeviceThreads, StartWhereServosAreAndEndInTheRestPose) {
    FakeState state;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    ThimbleLoop loop;
    initialise(loop, find_kind("chinello-3rrs")->defaults(), {},
               make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), {}));
    {
        DeviceThread thread({&loop});
        EXPECT_TRUE(eventually([&] {  // slowly at first
            loop.mailbox.publish({0, Eigen::Vector3d(0.2, -0.2, 0.1), true});
            return std::abs(angle_of({}, 4, board->position(0)) - 0.2) < 0.126 / 636;
        }));
    }
    EXPECT_TRUE(board->drain(5));
    EXPECT_TRUE(at_rest(loop));
    for (int j = 0; j < 3; ++j)
        EXPECT_NEAR(angle_of({}, 4, board->position(j)), loop.rest_q[j], 0.126 / 636) << "joint " << j;
    // Never faster than the limit: the board takes at most one target a channel and tick.
    WireValue last = 5000;
    const std::lock_guard lock(state.mutex);
    for (const ChannelTarget& t : state.seen) {
        if (t.channel != 0) continue;
        EXPECT_LE(std::abs(t.value - last), 4 * 636.62 * 6 * 1.05 * 0.1);
        last = t.value;
    }
}

/// A controller that fails at random in every way that a link can, and judges what it is told.
struct Judge {
    std::mutex mutex;
    std::mt19937 random;
    WireLimits limits;
    bool open = false, active = false;
    bool recalls = false;  ///< it tells what servos hold: nothing is told while that is not known
    struct Servo {
        double low = 0, high = 0, at = 0;  ///< where it may be; 0: anywhere
        WireValue held = 0;                ///< where it is
    };
    std::array<Servo, 4> servos;
    std::string verdict;
    int faults = 0, writes = 0;
    bool chance(int one_in) { return random() % unsigned(one_in) == 0; }
};
class HostileLink final : public BoardLink {
  public:
    explicit HostileLink(Judge& judge) : judge_(judge) { recalls = judge.recalls; }
    std::string open(std::span<WireValue> positions) override {
        const std::lock_guard lock(judge_.mutex);
        if (judge_.open) close_now();
        if (judge_.faults > 0 && judge_.chance(3)) return "not there";
        for (std::size_t c = 0; c < judge_.servos.size(); ++c) {
            const WireValue at =
                WireValue(3500 + judge_.random() % 5000);  // somebody may have turned it, out of range, too
            positions[c] = at;
            judge_.servos[c] = {double(at), double(at), device_clock(), at};
        }
        judge_.open = true;
        return "";
    }
    void close() override {
        const std::lock_guard lock(judge_.mutex);
        close_now();
    }
    LinkProblem activate() override {
        const std::lock_guard lock(judge_.mutex);
        if (!judge_.open) judge_.verdict += "activated while closed; ";
        if (judge_.faults > 0 && judge_.chance(6)) return fail({"no", true, FaultKind::refused});
        judge_.active = true;
        return {};
    }
    void deactivate() override {
        const std::lock_guard lock(judge_.mutex);
        judge_.active = false;
    }
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        const std::lock_guard lock(judge_.mutex);
        ++judge_.writes;
        if (!judge_.open || !judge_.active) judge_.verdict += "told after a latch; ";
        const bool all_lost = judge_.chance(12);
        LinkProblem problem;
        for (std::size_t i = 0; i < targets.size(); ++i) {
            const bool lost = all_lost || judge_.chance(15);
            judge(targets[i], lost);
            transfers[i] = {device_clock(), lost ? 0 : device_clock()};
            if (lost) problem = {"lost", false, FaultKind::silent};
        }
        if (judge_.chance(60)) return fail({"gone", true, FaultKind::unplugged});
        return problem;
    }
    LinkProblem recall(std::span<const int> channels, std::span<WireValue> held) override {
        const std::lock_guard lock(judge_.mutex);
        if (judge_.chance(4)) return {"lost", false, FaultKind::silent};
        for (const int c : channels) {
            Judge::Servo& s = judge_.servos[std::size_t(c)];
            held[std::size_t(c)] = s.held;
            s.low = s.high = s.held;
        }
        return {};
    }
    LinkProblem feed() override {
        const std::lock_guard lock(judge_.mutex);
        if (judge_.chance(20)) return fail({"bitten", true, FaultKind::watchdog});
        return judge_.chance(3) ? LinkProblem{"errors", false, FaultKind::reported} : LinkProblem{};
    }

  private:
    void close_now() { judge_.open = judge_.active = false; }
    LinkProblem fail(LinkProblem p) {
        ++judge_.faults;
        return p;
    }
    /// In range, or no farther out than the servo may be; and from wherever the servo may be no farther than speed
    /// allows, or than half of what is unknown.
    void judge(const ChannelTarget& t, bool lost) {
        Judge::Servo& s = judge_.servos[std::size_t(t.channel)];
        const WireLimits& l = judge_.limits;
        if (t.value < std::min<double>(l.min, s.low) || t.value > std::max<double>(l.max, s.high))
            judge_.verdict += "out of range; ";
        const double now = device_clock(), time = now - s.at, v = t.value;
        const double most = std::max(l.speed * time, 0.5 * (s.high - s.low)) + 1.5;
        if (std::max(v - s.low, s.high - v) > most)
            judge_.verdict += "channel " + std::to_string(t.channel) + " by " +
                              std::to_string(std::max(v - s.low, s.high - v)) + " in " + std::to_string(time) + " s; ";
        if (judge_.recalls && s.low != s.high) judge_.verdict += "told while nobody knew what it holds; ";
        const WireValue held = lost && judge_.chance(2) ? s.held : t.value;
        s = lost ? Judge::Servo{std::min(s.low, v), std::max(s.high, v), now, held} : Judge::Servo{v, v, now, held};
    }
    Judge& judge_;
};

TEST(Board, AnySequenceOfFaultsStaysSafe) {
    const int runs = std::getenv("PALPATE_FAULT_RUNS") ? std::atoi(std::getenv("PALPATE_FAULT_RUNS")) : 60;
    std::int64_t faults = 0, rearmed = 0;
    for (int seed = 1; seed <= runs; ++seed) {
        Judge judge;
        judge.random.seed(unsigned(seed));
        judge.limits = {4000, 8000, 15000, 700000};
        judge.recalls = seed % 2 == 0;
        {
            Board board(std::make_unique<HostileLink>(judge));
            for (int c = 0; c < 4; ++c) board.limit(c, judge.limits);
            std::mt19937 hand(static_cast<unsigned>(seed + 1000));
            for (int k = 0; k < 60; ++k) {
                for (int c = 0; c < 4; ++c) board.set(c, WireValue(hand() % 12000));
                board.wake();
                std::this_thread::sleep_for(std::chrono::milliseconds(3));
                if (k % 10 == 9 && board.state() != BoardState::active) rearmed += board.rearm();
            }
            faults += board.status().faults;
        }
        ASSERT_EQ(judge.verdict, "") << "seed " << seed;
        ASSERT_GT(judge.writes, 0);
    }
    EXPECT_GT(faults, runs / 4);
}

}  // namespace
}  // namespace palpate
