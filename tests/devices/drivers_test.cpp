// Servo controllers without hardware: what goes on the wire, and what happens when it breaks.

#include <fstream>

#include "devices/drivers/board.h"
#include "devices/drivers/first_move.h"
#include "devices/drivers/maestro.h"
#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_protocol.h"
#include "tests/support.h"

namespace palpate {
namespace {

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
            told = told_after(told, value, random() % 10 != 0, limits, elapsed, 0);
            if (i % 1000 == 0) told = {};
        }
    }
    EXPECT_EQ(limit_wire(6000, {6000, 6000, 0}, {}, 0.02), no_pulse);  // a channel without limits is not driven
}

TEST(WireValue, SpeedRisesByTheAccelerationLimitAndAnyTargetIsReached) {
    std::mt19937 random(5);
    const double speed = 15000, acceleration = 700000;
    const WireLimits limits{4000, 8000, speed, acceleration};
    Told told{6000, 6000, 0};
    double v = 0;
    WireValue wanted = 6000;
    for (int i = 0; i < 1000000; ++i) {
        const double elapsed = i % 50 == 49 ? 0.3 : 0.001 + 0.03 * double(random() % 1000) / 1000;
        if (i % 37 == 0) wanted = WireValue(random());
        const WireValue value = limit_wire(wanted, told, limits, elapsed);
        const double time = std::min(elapsed, 0.03), step = double(value) - double(told.low);
        if (elapsed > 0.05) v = 0;  // it has stood since
        ASSERT_LE(std::abs(step), std::max(1.0, speed * time));
        ASSERT_LE(step, std::max(1.0, (std::max(v, 0.0) + acceleration * time) * time)) << i;
        ASSERT_GE(step, -std::max(1.0, (std::max(-v, 0.0) + acceleration * time) * time)) << i;
        told = told_after(told, value, true, limits, elapsed, 0);
        v = std::copysign(std::abs(step) + 1, step) / time;  // known to one value
    }
    for (int k = 0; k < 200; ++k) told = told_after(told, limit_wire(7777, told, limits, 0.02), true, limits, 0.02, 0);
    EXPECT_EQ(told.low, 7777);
    // Slow limits get there, too.
    const WireLimits slow{4000, 8000, 10, 20};
    Told at{6000, 6000, 0};
    for (int k = 0; k < 200; ++k) {
        const double now = 0.1 * k;
        const WireValue value = limit_wire(6010, at, slow, now - at.at);
        if (value != at.low) at = told_after(at, value, true, slow, now - at.at, now);
    }
    EXPECT_EQ(at.low, 6010);
}

TEST(WireValue, WhatStandsOutOfRangeComesBackByStepsAndGoesNoFartherOut) {
    std::mt19937 random(3);
    const WireLimits limits{4000, 8000, 15000, 700000};
    for (int run = 0; run < 2000; ++run) {
        const WireValue at = WireValue(1 + random() % 12000), other = WireValue(at + random() % 500);
        Told told{at, run % 2 ? at : other, 0};
        const int most = std::max<int>(limits.max, told.high), least = std::min<int>(limits.min, told.low);
        for (int k = 0; k < 200; ++k) {
            const double elapsed = 0.001 * double(1 + random() % 40);
            const WireValue value = limit_wire(WireValue(1 + random() % 65535), told, limits, elapsed);
            ASSERT_LE(value, std::max<int>(limits.max, told.high));
            ASSERT_GE(value, std::min<int>(limits.min, told.low));
            ASSERT_TRUE(value <= most && value >= least);
            const double step = std::max(limits.speed * std::min(elapsed, 0.03), 0.5 * (told.high - told.low)) + 1;
            ASSERT_LE(std::abs(int(value) - int(told.low)), step) << "from " << told.low << " to " << told.high;
            ASSERT_LE(std::abs(int(value) - int(told.high)), step) << "from " << told.low << " to " << told.high;
            told = told_after(told, value, random() % 10 != 0, limits, elapsed, 0);
        }
        ASSERT_TRUE(told.low >= limits.min && told.high <= limits.max) << "it is back in its range";
    }
}

TEST(FirstMoves, AreOverOnceAServoCanHaveArrived) {
    FirstMove way;
    way.told(1000, 2000, 1);
    EXPECT_FALSE(way.caught_up({6000, 6000, 6000, 0}, 1.5)) << "half a second is not yet over, by its own limit";
    EXPECT_TRUE(way.caught_up({6000, 6000, 6000, 0}, 1.8));
    FirstMove behind;
    behind.told(100, 2000, 1);
    EXPECT_FALSE(behind.caught_up({7000, 6000, 0, 0}, 9)) << "limits hold it back";
    EXPECT_FALSE(behind.caught_up({7000, no_pulse, 0, 0}, 9)) << "nobody knows what it was told";
    EXPECT_TRUE(behind.caught_up({6500, 6600, 0, 0}, 9)) << "what is wanted has passed it";
    EXPECT_TRUE(behind.caught_up({9000, 6600, 0, 0}, 9));
    FirstMove measured;
    measured.told(100, 2000, 1);
    EXPECT_FALSE(measured.caught_up({6000, 6000, 5000, 400}, 9));
    EXPECT_TRUE(measured.caught_up({6000, 6000, 5700, 400}, 9));
    EXPECT_EQ(longest_travel({}, 6000, {4000, 8000}), 4000) << "nobody knows where it was";
    EXPECT_EQ(longest_travel({9000, 9500}, 6000, {4000, 8000}), 3500);
}

/// A board is woken by each of its thimbles, some of them right after it has sent something.
TEST(WireValue, ManySmallStepsEarnNoSpeed) {
    const double acceleration = 12 * 4 * 636.62;
    const WireLimits limits{4000, 8000, 15000, acceleration};
    for (const double pause : {0.00007, 0.0003, 0.002}) {
        Told told{5000, 5000, 0};
        double now = 0;
        for (int k = 0; k < 100; ++k) {
            for (const double elapsed : {pause, 0.01}) {
                now += elapsed;
                const WireValue value = limit_wire(8000, told, limits, now - told.at);
                if (value == told.low) continue;
                told = told_after(told, value, true, limits, now - told.at, now);
            }
            ASSERT_LE(told.low - 5000, acceleration * now * (0.5 * now + 0.012) + 2) << "after " << now << " s";
            if (told.low == 8000) break;
        }
        EXPECT_GT(told.low, 7000) << "it gets there";
    }
}

TEST(WireValue, WhatWaitedForASlowTransferSetsOutAnew) {
    const WireLimits limits{4000, 8000, 15000, 30000};
    const Told moving{6000, 6000, 0, 10000, 0.002}, stood{6000, 6000, 0, 10000, 0.1};
    EXPECT_GT(limit_wire(8000, moving, limits, 0.02), 6190);
    EXPECT_LE(limit_wire(8000, stood, limits, 0.02), 6012);
}

/// A transfer that arrived late, although it was sent right after the one before, has shown no speed.
TEST(WireValue, WhatArrivedLateWasSlow) {
    const WireLimits limits{4000, 8000, 15000, 1e7};
    const Told before{6000, 6000, 0};
    EXPECT_GT(told_after(before, 6040, true, limits, 0.005, 0.005, 0.0052).velocity, 7000);
    EXPECT_LT(told_after(before, 6040, true, limits, 0.005, 0.025, 0.025).velocity, 2000);
}

TEST(WireValue, TorqueLimitsRiseSlowlyAndFallAtOnce) {
    const WireLimits limits{1000, 3000, 1000, 0, 0, 4000};
    EXPECT_LE(limit_torque_wire(800, no_torque_limit, limits, 10), 120);
    EXPECT_LE(limit_torque_wire(800, 100, limits, 0.02), 180);
    EXPECT_EQ(limit_torque_wire(0, 800, limits, 0.001), 0);
    EXPECT_EQ(limit_torque_wire(no_torque_limit, 800, limits, 0.001), no_torque_limit);
}

TEST(FollowingErrors, LagIsNoneAndStandingIsBlocked) {
    FollowingError servo;
    servo.start(2000, 0);
    double t = 0;
    WireValue told[400];
    for (int k = 0; k < 400; ++k, t += 0.02) {  // 3 rad/s to and fro, followed 0.1 s later
        told[k] = WireValue(2048 + 300 * std::sin(0.13 * k));
        servo.told(told[k], t);
        ASSERT_EQ(servo.measured(told[std::max(0, k - 5)], 100, t), FaultKind::none) << k;
    }
    FaultKind found = FaultKind::none;
    const double stands = t;
    for (int k = 0; k < 50 && found == FaultKind::none; ++k, t += 0.02) {
        servo.told(2600, t);
        found = servo.measured(2100, 100, t);
    }
    EXPECT_EQ(found, FaultKind::blocked);
    EXPECT_GT(t - stands, 0.1);
    EXPECT_LT(t - stands, 0.5);
    servo.start(2000, t);
    found = FaultKind::none;
    for (int k = 0; k < 50 && found == FaultKind::none; ++k, t += 0.02)
        found = servo.measured(WireValue(2000 + 30 * k), 100, t);
    EXPECT_EQ(found, FaultKind::off_course) << "nobody told it to move";
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

TEST(ServoCalibrations, WhatTheirRangeCutsOff) {
    const ServoCalibration servo{1500, -500, 1000, 1600};
    for (const double q : {-0.2, -0.201, 0.0, 1.0, 1.001}) EXPECT_EQ(cut_off(servo, q), 0) << q;
    EXPECT_NEAR(cut_off(servo, -0.5), 150, 1e-9);
    EXPECT_NEAR(cut_off(servo, 1.2), 100, 1e-9);
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

TEST(DryMaestros, AFolderThatIsNotThereIsMade) {
    const testing::ScratchFolder scratch;
    std::array<WireValue, max_channels> positions{};
    const auto log = scratch.path / "not" / "there" / "maestro.csv";
    EXPECT_EQ(maestro::make_dry_link({}, log)->open(positions), "");
    EXPECT_TRUE(std::filesystem::exists(log));
    std::ofstream(scratch.path / "file") << "";
    EXPECT_NE(maestro::make_dry_link({}, scratch.path / "file" / "maestro.csv")->open(positions), "");
}

}  // namespace
}  // namespace palpate
