// Boards whose answers are lost: what servos hold is asked for, and never guessed.

#include <algorithm>
#include <thread>

#include "devices/drivers/board.h"
#include "tests/devices/fake_link.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::FakeLink;
using testing::FakeState;

/// Nobody knows whether a transfer arrived that nobody acknowledged. The board does: it is asked before a servo is told
/// the next, which goes on from there.
TEST(Board, WhatWasLostIsAskedFor) {
    for (const bool arrives : {false, true}) {
        FakeState state;
        state.recalls = true;
        Board board(std::make_unique<FakeLink>(state));
        board.limit(0, {4000, 8000, 6000, 12000});
        (arrives ? state.lost_arrive : state.lost_vanish) = 1;
        board.set(0, 5100);
        board.wake();
        ASSERT_TRUE(eventually([&] { return board.arrived(0) == 5100; }));
        const std::lock_guard lock(state.mutex);
        // Asked for, with whether its watchdog has bitten, before it is told the next.
        const auto lost = state.calls.find('w') + 1, next = state.calls.find('w', lost);
        EXPECT_TRUE(state.calls.substr(lost, next - lost).ends_with("rf")) << state.calls;
        EXPECT_EQ(std::count(state.calls.begin(), state.calls.end(), 'r'), 1) << state.calls;
        EXPECT_EQ(state.held[0], 5100);
        EXPECT_EQ(board.state(), BoardState::active);
    }
}

/// A board that takes every target and says so of none holds them: nothing is told twice, and nothing is a fault.
TEST(Board, AServoWhoseAnswersAreLostOnceInAWhileIsNoFault) {
    FakeState state;
    state.recalls = true;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(0, {4000, 8000, 1e5});
    for (int k = 1; k <= 8; ++k) {
        state.lost_arrive = 1;
        board.set(0, WireValue(5000 + k));
        board.wake();
        ASSERT_TRUE(eventually([&] { return board.arrived(0) == 5000 + k; }));
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_EQ(board.state(), BoardState::active);
    EXPECT_EQ(board.status().faults, 0);
    const std::lock_guard lock(state.mutex);
    EXPECT_TRUE(state.seen.empty()) << "told again what it holds";
}

/// What arrived late is the oldest of all: it must not be missing where ages are told.
TEST(Board, AgesOfWhatArrivedUnacknowledgedAreTold) {
    FakeState state;
    state.recalls = true;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(0, {4000, 8000, 1e5});
    state.lost_arrive = 1;
    state.delay_ms = 60;
    const double pose_at = device_clock();
    board.set(0, 5001, pose_at);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.arrived(0) == 5001; }));
    EXPECT_EQ(board.age(0).count(), 1);
    EXPECT_GE(board.newest_age(0), 0.06);
    EXPECT_LE(board.newest_age(0), device_clock() - pose_at);
}

TEST(Board, ABoardThatDoesNotTellWhatItHoldsLatches) {
    FakeState state;
    state.recalls = state.recall_fails = true;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(0, {4000, 8000, 1e5});
    state.lost_arrive = 1;
    board.set(0, 5100);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::faulted; }));
    const std::lock_guard lock(state.mutex);
    EXPECT_EQ(std::count(state.calls.begin(), state.calls.end(), 'w'), 1) << state.calls;
    EXPECT_EQ(board.status().fault, FaultKind::silent);
}

/// A board that started anew holds nothing of what it was told.
TEST(Board, AServoThatGetsNoPulsesAnyMoreLatches) {
    FakeState state;
    state.recalls = true;
    Board board(std::make_unique<FakeLink>(state));
    board.limit(0, {4000, 8000, 1e5});
    {
        const std::lock_guard lock(state.mutex);
        state.held[0] = no_pulse;
    }
    state.lost_vanish = 1;
    board.set(0, 5100);
    board.wake();
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::faulted; }));
    EXPECT_EQ(board.status().fault, FaultKind::watchdog);
}

}  // namespace
}  // namespace palpate
