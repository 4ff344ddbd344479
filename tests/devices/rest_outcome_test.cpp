// What is said of the rest pose; and a computer that sleeps between two words to a controller.

#include "devices/loop/rest_outcome.h"

#include "tests/asleep.h"
#include "tests/devices/fake_link.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::FakeLink;
using testing::FakeState;

/// A thimble in its rest pose, as far as its loop is concerned.
struct Rested {
    const std::vector<int> channels{0, 1, 2};
    const std::vector<ServoCalibration> servos;
    std::shared_ptr<Board> board;
    ThimbleLoop loop;
    explicit Rested(FakeState& state, const ServoCalibration& servo = {})
        : servos(3, servo), board(std::make_shared<Board>(std::make_unique<FakeLink>(state))) {
        initialise(loop, find_kind("chinello-3rrs")->defaults(), {},
                   make_board_driver(board, channels, servos, {6, 0, 0, {}}));
    }
    WireValue pulse(int joint) const { return wire_value(servos[0], 4, loop.rest_q[joint]); }
    bool told() {
        loop.driver->send(loop.rest_q, 0);
        loop.driver->flush();
        return board->drain(10);
    }
    RestOutcome outcome() const { return rest_outcome(loop, *board, "the board", channels, servos); }
};

TEST(RestOutcomes, OnlyWhatWasConfirmedIsSaid) {
    FakeState state;
    Rested r(state);
    EXPECT_FALSE(r.outcome().confirmed) << "nothing was told yet";
    EXPECT_EQ(r.outcome().how, "the board did not confirm it");
    ASSERT_TRUE(r.told());
    EXPECT_TRUE(r.outcome().confirmed) << r.outcome().how;
    r.loop.q[1] += 0.01;
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_EQ(r.outcome().how, "the time was too short");
    r.loop.q = r.loop.rest_q;
    r.loop.status.mode = ThimbleMode::fault;
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_EQ(r.outcome().how, "the board was lost, and is not re-armed");
    r.loop.status.mode = ThimbleMode::resting;
    state.vanish = true;
    ASSERT_TRUE(eventually([&] { return r.board->state() != BoardState::active; }));
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_NE(r.outcome().how.find("unplugged: gone"), std::string::npos) << r.outcome().how;
}

TEST(RestOutcomes, ARestPoseThatTheRangeCutsOffIsNotReached) {
    FakeState state;
    Rested r(state, {1500, 636.62, 992, 1600});
    ASSERT_TRUE(r.told());
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_EQ(r.outcome().how, "it lies outside of the range of servo 0");
}

/// What arrived last may have been followed by a bite of which nobody has been told yet.
TEST(RestOutcomes, ABoardIsAskedOnceMoreAfterTheLastWord) {
    FakeState state;
    Rested r(state);
    state.bites_when_told = true;
    r.told();
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_NE(r.outcome().how.find("watchdog: its watchdog has bitten"), std::string::npos) << r.outcome().how;
}

TEST(RestOutcomes, AMeasuredShaftThatIsElsewhereIsNotAtRest) {
    FakeState state;
    state.shaft = 5000;
    Rested r(state);
    for (int k = 0; k < 3; ++k) r.board->limit(k, {4000, 8000, 1e5});  // nor is a servo that does not follow in fault
    ASSERT_TRUE(r.told());
    EXPECT_FALSE(r.outcome().confirmed);
    EXPECT_EQ(r.outcome().how, "its servos are elsewhere, as measured");
}

/// While a computer sleeps, the board's watchdog does not: whoever wakes up asks first.
TEST(Board, AComputerThatSleptAsksBeforeItTells) {
    FakeState state;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(1, {4000, 8000, 1e6});
    for (int k = 1; k <= 10; ++k) {
        board.set(1, WireValue(6000 + k));
        board.wake();
        ASSERT_TRUE(board.drain(10));
        {
            const std::lock_guard lock(state.mutex);
            state.calls.clear();
        }
        ++testing::slept_s;
        board.set(1, WireValue(6500 + k));
        board.wake();
        ASSERT_TRUE(board.drain(10));
        const std::lock_guard lock(state.mutex);
        ASSERT_EQ(state.calls.substr(0, 1), "f") << state.calls;
    }
}

}  // namespace
}  // namespace palpate
