// Servo controllers without hardware: what goes on the wire, and what happens when it breaks.

#include <unistd.h>

#include <thread>

#include "devices/device_thread.h"
#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_protocol.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;

TEST(WireValue, AnySequenceStaysInRangeAndInsideTheSpeedLimit) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(-1, 1);
    const double special[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 0};
    for (const ServoCalibration& servo : {ServoCalibration{}, ServoCalibration{1500, -636.62, 1000.1, 1999.9},
                                          ServoCalibration{2048, 651.9, 1024, 3072}}) {
        const double steps = servo.zero > 2000 ? 1 : 4;
        const WireLimits limits = wire_limits(servo, steps, 6);
        Told told;
        for (int i = 0; i < 10000000; ++i) {
            const double angle = i % 7 == 0 ? special[random() % 6] : (i % 3 ? 1.5 : 40.0) * u(random);
            const double elapsed = i % 11 == 0 ? special[random() % 6] : 0.12 * u(random);
            const WireValue wanted = i % 13 ? wire_value(servo, steps, angle) : WireValue(random());
            const WireValue value = limit_wire(wanted, told, limits, elapsed);
            if (value == no_pulse) {
                ASSERT_EQ(wanted, no_pulse);
                continue;
            }
            ASSERT_GE(value, servo.min * steps);
            ASSERT_LE(value, servo.max * steps);
            const double time = std::isfinite(elapsed) ? std::clamp(elapsed, 0.0, 0.1) : 0;
            const double step = std::abs(servo.units_per_rad) * steps * 6 * time;
            // From wherever it may be: no farther than a step, or than half of what is not known.
            if (told.low != no_pulse) {
                const double most = std::max(step, 0.5 * (told.high - told.low) + 1);
                ASSERT_LE(std::abs(int(value) - int(told.low)), most);
                ASSERT_LE(std::abs(int(value) - int(told.high)), most);
            }
            if (told.low == no_pulse || random() % 10)
                told = {value, value, 0};
            else  // lost, or not
                told = {std::min(told.low, value), std::max(told.high, value), 0};
            if (i % 1000 == 0) told = {};
        }
    }
    EXPECT_EQ(limit_wire(6000, {6000, 6000, 0}, {}, 0.02), no_pulse);  // a channel without limits is not driven
}

TEST(WireValue, AnglesComeBack) {
    for (const ServoCalibration& servo : {ServoCalibration{}, ServoCalibration{1480, -600, 900, 2100}})
        for (double q = -0.6; q <= 0.6; q += 0.01)
            EXPECT_NEAR(angle_of(servo, 4, wire_value(servo, 4, q)), q, 0.126 / 600);
}

TEST(ServoCalibrations, ClashingNumbersAreRefused) {
    EXPECT_TRUE(ServoCalibration{}.validate().empty());
    EXPECT_FALSE((ServoCalibration{1500, 0, 992, 2000}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{2500, 600, 992, 2000}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{1500, 600, 2000, 992}.validate().empty()));
    EXPECT_FALSE((ServoCalibration{1500, NAN, 992, 2000}.validate().empty()));
}

TEST(MaestroProtocol, RequestsAsDocumented) {
    using namespace maestro;
    EXPECT_EQ(set_target(3, 6000), (Request{0x40, 0x85, 6000, 3, 0}));
    EXPECT_EQ(set_speed(3, 140), (Request{0x40, 0x84, 140, 3, 0}));
    EXPECT_EQ(clear_errors(), (Request{0x40, 0x86, 0, 0, 0}));
    EXPECT_EQ(set_parameter(serial_timeout_parameter, 2, 20), (Request{0x40, 0x82, 20, 0x206, 0}));
    EXPECT_EQ(get_variables(18).length, 8);
    EXPECT_EQ(get_variables(6).length, 98 + 42);
    EXPECT_EQ(get_servo_settings(24).length, 168);
    EXPECT_EQ(channels_of_product(0x8b), 18);
    EXPECT_EQ(channels_of_product(0x8e), 0);
    EXPECT_FALSE(channels_of_product(0x1234));
}

TEST(MaestroProtocol, RepliesOfAnotherLengthAreNone) {
    using namespace maestro;
    Bytes reply(8);
    reply[2] = 0x21;
    EXPECT_EQ(parse_variables(18, reply)->errors, 0x21);
    EXPECT_EQ(describe_errors(0x21), "serial signal, serial timeout");
    for (std::size_t n : {0u, 7u, 9u, 140u}) EXPECT_FALSE(parse_variables(18, Bytes(n)));
    Bytes micro(140);
    micro[98 + 7] = 0x70, micro[98 + 8] = 0x17;
    EXPECT_EQ(parse_servo(6, 1, micro)->position, 6000);
    EXPECT_FALSE(parse_servo(6, 6, micro));
    EXPECT_FALSE(parse_servo(18, 0, micro));
}

/// A controller of our own, which remembers and breaks.
struct FakeState {
    std::mutex mutex;
    std::vector<ChannelTarget> seen;
    std::atomic<bool> refuse{false}, vanish{false}, there{true};
    std::atomic<int> delay_ms{0};
};
class FakeLink final : public BoardLink {
  public:
    explicit FakeLink(FakeState& state) : state_(state) {}
    std::string open(std::span<WireValue> positions) override {
        if (!state_.there) return "not there";
        positions[0] = 5000;
        return "";
    }
    void close() override {}
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<char> arrived) override {
        std::this_thread::sleep_for(std::chrono::milliseconds(state_.delay_ms));
        if (state_.vanish) return {"gone", true};
        if (state_.refuse) return {"refused"};
        const std::lock_guard lock(state_.mutex);
        for (std::size_t i = 0; i < targets.size(); ++i) state_.seen.push_back(targets[i]), arrived[i] = 1;
        return {};
    }
    LinkProblem feed() override { return state_.vanish ? LinkProblem{"gone", true} : LinkProblem{}; }

  private:
    FakeState& state_;
};

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
    EXPECT_EQ(state.seen.size(), 2u);
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
    EXPECT_EQ(board.state(), BoardState::ready);
    state.refuse = true;
    board.set(1, 6400);
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::lost; }));
    EXPECT_EQ(board.status().problem, "refused");
}

TEST(Board, WhatWasWantedBeforeALossIsNotSentAfterIt) {
    FakeState state;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    DeviceModel model = find_kind("chinello-3rrs")->defaults();
    ThimbleLoop loop;
    initialise(loop, model, {}, make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6));
    double t = 0;
    tick(loop, t += 0.02);
    board->drain();
    state.there = false;
    state.vanish = true;
    ASSERT_TRUE(eventually([&] { return board->state() == BoardState::lost; }));
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
    EXPECT_TRUE(rearm(loop, t));
    tick(loop, t += 0.02);
    board->drain();
    EXPECT_FALSE(state.seen.empty());
    EXPECT_EQ(loop.status.mode, ThimbleMode::resting);
}

TEST(Board, ASlowControllerDelaysNoTick) {
    FakeState state;
    state.delay_ms = 150;
    auto board = std::make_shared<Board>(std::make_unique<FakeLink>(state));
    auto driver = make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6);
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
               make_board_driver(board, {0, 1, 2}, std::vector<ServoCalibration>(3), 6));
    {
        DeviceThread thread({&loop});
        for (int k = 0; k < 30; ++k) {
            loop.mailbox.publish({0, Eigen::Vector3d(0.2, -0.2, 0.1), true});
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        EXPECT_NEAR(angle_of({}, 4, board->position(0)), 0.2, 0.126 / 636);
    }
    board->drain();
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

}  // namespace
}  // namespace palpate
