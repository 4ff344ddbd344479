// The thimble's promises.

#include <random>
#include <thread>
#include <utility>

#include "devices/drivers/simulated.h"
#include "devices/loop/loop.h"
#include "devices/matching/platform_force.h"
#include "tests/support.h"

namespace palpate {
namespace {

DeviceModel chinello() { return find_kind("chinello-3rrs")->defaults(); }

/// Remembers what was sent; fails on request.
class SpyDriver final : public Driver {
  public:
    SpyDriver(std::vector<Coordinates>& sent, bool& broken) : sent_(sent), broken_(broken) {}
    DriverStatus send(const Coordinates& q, double, double) override {
        if (broken_) return DriverStatus::fault;
        sent_.push_back(q);
        return DriverStatus::ok;
    }
    Coordinates actual(double) override { return sent_.empty() ? Coordinates::Zero(3) : sent_.back(); }
    bool limit_torque(const Coordinates& torque) override {
        torques.push_back(torque);
        return true;
    }
    std::vector<Coordinates> torques;

  private:
    std::vector<Coordinates>& sent_;
    bool& broken_;
};

struct Bench {
    std::vector<Coordinates> sent;
    bool broken = false;
    ThimbleLoop loop;
    Bench() { initialise(loop, chinello(), {}, std::make_unique<SpyDriver>(sent, broken)); }
    void publish(double time, double theta, bool valid = true) {
        const Coordinates w = Eigen::Vector3d(theta, 0, 0.024);
        loop.mailbox.publish({time, loop.model.kind->joints(loop.model, w).q, valid});
    }
};

TEST(ForceMode, AnyTorqueIsFiniteAndNoMoreThanTheLargest) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> u(-1, 1);
    const double special[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 0, -0.0};
    const ServoCalibration servo{2048, 651.9, 1024, 3072, 2827, 800};
    for (int i = 0; i < 300000; ++i) {
        Coordinates torque(3), largest(3);
        for (int k = 0; k < 3; ++k) {
            torque[k] = i % 3 == 0 ? special[random() % 7] : u(random);
            largest[k] = i % 7 == 0 ? special[random() % 7] : 0.2 * std::abs(u(random));
        }
        const Coordinates limited = limit_torque(torque, largest);
        for (int k = 0; k < 3; ++k) {
            ASSERT_TRUE(std::isfinite(limited[k]) && limited[k] >= 0);
            ASSERT_LE(limited[k], std::isfinite(largest[k]) ? std::max(0.0, largest[k]) : 0);
            ASSERT_LE(torque_value(servo, torque[k]), 800);
            ASSERT_LE(torque_value(servo, limited[k]), 800);
        }
    }
    EXPECT_EQ(torque_value(servo, 0.1), 283);
    EXPECT_EQ(torque_value(servo, NAN), 0);
    EXPECT_EQ(torque_value(ServoCalibration{}, 0.1), no_torque_limit);
    EXPECT_EQ(limit_torque({}, Coordinates::Ones(3)).size(), 0);
}

TEST(ForceMode, TheLoopPushesWithTheCommandsTorqueAndMovesGentlyWithoutOne) {
    Bench bench;
    auto& spy = static_cast<SpyDriver&>(*bench.loop.driver);
    ASSERT_TRUE(use_force_mode(bench.loop));
    const Coordinates moving = bench.loop.moving_torque;
    EXPECT_GT(moving.minCoeff(), 0);
    EXPECT_LT(moving.maxCoeff(), bench.loop.largest_torque.maxCoeff());
    auto command = [&](double time, const Coordinates& torque) {
        const Coordinates q = bench.loop.model.kind->joints(bench.loop.model, bench.loop.model.rest).q;
        bench.loop.mailbox.publish({time, q, true, 0, torque});
        tick(bench.loop, time);
    };
    const Coordinates push = Eigen::Vector3d(0.005, 0.01, 0.015);
    command(0.02, push);
    EXPECT_EQ(spy.torques.back(), push);
    command(0.04, Eigen::Vector3d(NAN, 1e9, -1));
    EXPECT_EQ(spy.torques.back()[0], 0);
    EXPECT_EQ(spy.torques.back()[1], bench.loop.largest_torque[1]);
    EXPECT_EQ(spy.torques.back()[2], 0);
    command(0.06, push);
    tick(bench.loop, 0.13);  // nothing new for 70 ms: held, as it was
    EXPECT_EQ(bench.loop.status.mode, ThimbleMode::holding);
    EXPECT_EQ(spy.torques.back(), push);
    tick(bench.loop, 0.30);  // and then to rest
    EXPECT_EQ(bench.loop.status.mode, ThimbleMode::resting);
    EXPECT_EQ(spy.torques.back(), moving);
    ThimbleLoop simulated;
    const Coordinates rest = chinello().kind->joints(chinello(), chinello().rest).q;
    initialise(simulated, chinello(), {}, make_simulated_driver({}, rest));
    EXPECT_TRUE(use_force_mode(simulated));
}

TEST(LimitCommand, AnySequenceStaysFiniteInRangeAndSlewLimited) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(-1, 1);
    const Coordinates low = Eigen::Vector3d(-0.6, -0.5, -0.4), high = Eigen::Vector3d(0.6, 0.7, 0.3);
    const SlewLimits limits{3, 60};
    const double dt = 0.02, special[] = {NAN, INFINITY, -INFINITY, 1e300, -1e300, 0, 0.6, -0.6};
    Coordinates q = Coordinates::Zero(3), v = Coordinates::Zero(3);
    for (int i = 0; i < 1000000; ++i) {
        Coordinates target(3);
        for (int k = 0; k < 3; ++k) target[k] = i % 5 == 0 ? special[random() % 8] : (i % 3 ? 0.8 : 30.0) * u(random);
        const Coordinates before = q, speed = v;
        limit_command(target, low, high, limits, dt, q, v);
        for (int k = 0; k < 3; ++k) {
            ASSERT_TRUE(std::isfinite(q[k]) && std::isfinite(v[k]));
            ASSERT_GE(q[k], low[k]);
            ASSERT_LE(q[k], high[k]);
            ASSERT_LE(std::abs(q[k] - before[k]), limits.velocity * dt * (1 + 1e-9));
            ASSERT_LE(std::abs(v[k] - speed[k]), limits.acceleration * dt * (1 + 1e-9))
                << "step " << i << " joint " << k;
        }
    }
}

TEST(LimitCommand, FromOutOfRangeItComesBackAsSlowly) {
    const Coordinates low = Coordinates::Constant(1, -1), high = Coordinates::Constant(1, 1),
                      target = Coordinates::Constant(1, 5);
    for (const double from : {2.0, -2.0}) {
        Coordinates q = Coordinates::Constant(1, from), v = Coordinates::Zero(1);
        for (int i = 0; i < 200; ++i) {
            const double before = q[0];
            limit_command(target, low, high, {3, 60}, 0.02, q, v);
            ASSERT_LE(std::abs(q[0] - before), 3 * 0.02 + 1e-12);
            ASSERT_LE(std::abs(q[0]), std::max(1.0, std::abs(before)));
        }
        EXPECT_NEAR(q[0], 1, 1e-6);
    }
}

TEST(LimitCommand, ReachesTheTargetWithoutOvershoot) {
    Coordinates q = Coordinates::Zero(1), v = Coordinates::Zero(1);
    const Coordinates low = Coordinates::Constant(1, -1), high = Coordinates::Constant(1, 1),
                      target = Coordinates::Constant(1, 0.5);
    for (int i = 0; i < 100; ++i) {
        limit_command(target, low, high, {3, 60}, 0.02, q, v);
        EXPECT_LE(q[0], 0.5 + 1e-12);
    }
    EXPECT_NEAR(q[0], 0.5, 1e-6);
}

TEST(ThimbleLoop, FollowsHoldsThenRests) {
    Bench b;
    double t = 0;
    for (; t < 0.5; t += 0.02) b.publish(t, 0.1), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::following);
    const Coordinates wanted = b.loop.model.kind->joints(b.loop.model, Eigen::Vector3d(0.1, 0, 0.024)).q;
    EXPECT_LT((b.loop.q - wanted).norm(), 1e-9);
    const double silent = t;
    for (; t < silent + 0.07; t += 0.02) tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::holding);
    EXPECT_LT((b.loop.q - wanted).norm(), 1e-9);
    for (; t < silent + 0.06 + 0.5; t += 0.02) tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::resting);
    EXPECT_LT((b.loop.q - b.loop.rest_q).norm(), 1e-9) << "contact-free rest pose within 500 ms";
    b.publish(t, 0.1);
    tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::following);
}

TEST(ThimbleLoop, InvalidSolvesCountAsNone) {
    Bench b;
    for (double t = 0; t < 0.5; t += 0.02) b.publish(t, 0.1, false), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::resting);
    EXPECT_LT((b.loop.q - b.loop.rest_q).norm(), 1e-12);
}

TEST(ThimbleLoop, FaultsLatchUntilRearmed) {
    Bench b;
    double t = 0;
    for (; t < 0.2; t += 0.02) b.publish(t, 0.1), tick(b.loop, t);
    b.broken = true;
    b.publish(t, 0.1);
    tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::fault);
    b.broken = false;
    const std::size_t sent = b.sent.size();
    for (double end = t + 0.4; t < end; t += 0.02) b.publish(t, 0.1), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::fault);
    EXPECT_EQ(b.sent.size(), sent) << "a latched fault sends nothing";
    rearm(b.loop, t);
    EXPECT_EQ(b.loop.q, b.sent.back()) << "from the actual pose";
    b.publish(t, 0.1), tick(b.loop, t + 0.02);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::following);
}

TEST(ThimbleLoop, MissedTicksAreCountedNotCaughtUp) {
    Bench b;
    tick(b.loop, 0);
    EXPECT_FALSE(tick(b.loop, 0.01));
    EXPECT_TRUE(tick(b.loop, 0.105));
    EXPECT_EQ(b.loop.status.misses, 4);
    EXPECT_FALSE(tick(b.loop, 0.106)) << "no burst";
    EXPECT_EQ(b.loop.status.ticks, 2);
}

TEST(ThimbleLoop, ATickThatIsANanosecondEarlyIsOneTick) {
    Bench b;
    tick(b.loop, 0);
    for (int k = 1; k <= 50; ++k) {
        const double early = b.loop.next_tick - 0.9e-9;
        EXPECT_TRUE(tick(b.loop, early));
        EXPECT_FALSE(tick(b.loop, early + 1e-4)) << "ticked twice";
    }
    EXPECT_EQ(b.loop.status.misses, 0);
    EXPECT_EQ(b.loop.status.ticks, 51);
    EXPECT_EQ(b.loop.status.worst_lateness, 0);
}

/// A hand in real time: commands every 20 ms, of poses that were read `takes` before.
struct Paced {
    Bench b;
    double at = 1;  ///< when the next tracked pose is read [s]
    /// A rendering step and its tick. Returns how long after the step's end its command was sent, or 1 if it was not
    /// within `patience`.
    double step_and_tick(double takes, double patience) {
        const double done = at + takes;
        b.loop.pose_stamps.add(at, at);
        // Ticks come as often as a thread may look, before and after the command.
        for (double t = at; t < done; t += 1e-4) tick(b.loop, t);
        b.loop.pose_stamps.done(done);
        const Coordinates w = Eigen::Vector3d(0.1, 0, 0.024);
        b.loop.mailbox.publish({at, b.loop.model.kind->joints(b.loop.model, w).q, true, at});
        const double sampled = std::exchange(at, at + 0.02);
        for (double t = done; t < done + patience; t += 1e-4)
            if (tick(b.loop, t) && b.loop.newest.sampled_at == sampled) return t - done;
        return 1;
    }
};

TEST(ThimbleLoop, TicksComeJustAfterTheStepsThatTheyWaitFor) {
    for (const double takes : {0.3e-3, 1e-3, 3e-3}) {
        Paced p;
        for (int k = 0; k < 400; ++k) p.step_and_tick(takes, 0.016);
        for (int k = 0; k < 50; ++k) EXPECT_LT(p.step_and_tick(takes, 0.016), 1e-3) << takes;
    }
}

TEST(ThimbleLoop, OneLongStepMakesNoOtherCommandOld) {
    Paced p;
    for (int k = 0; k < 400; ++k) p.step_and_tick(1e-3, 0.016);
    p.step_and_tick(15e-3, 0.004);
    for (int k = 0; k < 20; ++k) p.step_and_tick(1e-3, 0.016);
    for (int k = 0; k < 50; ++k) EXPECT_LT(p.step_and_tick(1e-3, 0.016), 2e-3);
}

TEST(ThimbleLoop, ACommandThatIsOnItsWayIsWaitedFor) {
    Paced p;
    for (int k = 0; k < 400; ++k) p.step_and_tick(1e-3, 0.016);
    EXPECT_LT(p.step_and_tick(4e-3, 0.016), 0.5e-3) << "not a period later";
    const std::int64_t misses = p.b.loop.status.misses;
    // Where none comes, ticks go on, a little later.
    const std::int64_t ticks = p.b.loop.status.ticks;
    const double end = p.at + 0.2;
    for (double t = p.at; t < end; t += 1e-4) tick(p.b.loop, t);
    EXPECT_GE(p.b.loop.status.ticks - ticks, 8);
    EXPECT_EQ(p.b.loop.status.misses, misses);
    EXPECT_EQ(p.b.loop.status.mode, ThimbleMode::resting);
}

TEST(ThimbleLoop, TheFirstMoveAfterArmingIsSlow) {
    Bench b;
    ASSERT_TRUE(rearm(b.loop, 0));
    double t = 0;
    for (; t < 0.2; t += 0.02) {
        const Coordinates before = b.loop.q;
        b.publish(t, 0.3), tick(b.loop, t);
        EXPECT_LE((b.loop.q - before).cwiseAbs().maxCoeff(), b.loop.settings.first_velocity * 0.02 * (1 + 1e-9));
    }
    EXPECT_GT((b.loop.q - b.loop.rest_q).norm(), 0.05) << "it moves";
    for (; t < 3; t += 0.02) b.publish(t, 0.3), tick(b.loop, t);
    double fastest = 0;
    for (double end = t + 0.3; t < end; t += 0.02) {
        const Coordinates before = b.loop.q;
        b.publish(t, -0.3), tick(b.loop, t);
        fastest = std::max(fastest, (b.loop.q - before).cwiseAbs().maxCoeff() / 0.02);
    }
    EXPECT_GT(fastest, 2 * b.loop.settings.first_velocity) << "and is fast from then on";
}

TEST(ThimbleLoop, WhereTheDeadMansSwitchIsLetGoItHoldsThenRests) {
    Bench b;
    double t = 0;
    for (; t < 0.5; t += 0.02) b.publish(t, 0.1), tick(b.loop, t);
    ASSERT_EQ(b.loop.status.mode, ThimbleMode::following);
    b.loop.let_go = true;
    const double released = t;
    for (; t < released + 0.07; t += 0.02) b.publish(t, 0.2), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::holding);
    for (; t < released + 0.6; t += 0.02) b.publish(t, 0.2), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::resting);
    EXPECT_LT((b.loop.q - b.loop.rest_q).norm(), 1e-9) << "whatever commands come";
    b.loop.let_go = false;
    b.publish(t, 0.2), tick(b.loop, t);
    EXPECT_EQ(b.loop.status.mode, ThimbleMode::following);
    EXPECT_GE(b.loop.easing_since, 0) << "slowly, as after arming";
}

TEST(ThimbleLoop, TheApproachToAFirstContactHasALimitOfItsOwn) {
    Bench b;
    b.loop.settings.touch_velocity = 0.5;
    auto command = [&](double time, double theta, bool contact) {
        const Coordinates w = contact ? Eigen::Vector3d(theta, 0, 0.024) : Eigen::Vector3d(b.loop.model.rest);
        b.loop.mailbox.publish({time, b.loop.model.kind->joints(b.loop.model, w).q, true});
        const Coordinates before = b.loop.q;
        tick(b.loop, time);
        return (b.loop.q - before).cwiseAbs().maxCoeff() / 0.02;
    };
    double t = 0, fastest = 0;
    for (; t < 0.3; t += 0.02) command(t, 0, false);
    for (; t < 4; t += 0.02) fastest = std::max(fastest, command(t, 0.3, true));
    EXPECT_LE(fastest, 0.5 * (1 + 1e-9));
    const DeviceModel& m = b.loop.model;
    EXPECT_LT((b.loop.q - b.loop.newest.q.cwiseMax(m.joint_min).cwiseMin(m.joint_max)).norm(), 1e-3)
        << "it gets there, as far as joints go";
    fastest = 0;
    for (; t < 5; t += 0.02) fastest = std::max(fastest, command(t, -0.3, true));
    EXPECT_GT(fastest, 1) << "in contact it follows as fast as ever";
}

TEST(ThimbleLoop, ParkingBringsTheRestPose) {
    Bench b;
    double t = 0;
    for (; t < 0.3; t += 0.02) b.publish(t, 0.15), tick(b.loop, t);
    park(b.loop);
    for (double end = t + 0.5; t < end; t += 0.02) b.publish(t, 0.15), tick(b.loop, t);
    EXPECT_LT((b.loop.q - b.loop.rest_q).norm(), 1e-9);
}

TEST(ThimbleLoop, RefusesBadSettings) {
    ThimbleLoop loop;
    EXPECT_THROW(initialise(loop, chinello(), {}, nullptr), std::invalid_argument);
    std::vector<Coordinates> sent;
    bool broken = false;
    ThimbleLoopSettings bad;
    bad.limits.velocity = NAN;
    EXPECT_THROW(initialise(loop, chinello(), bad, std::make_unique<SpyDriver>(sent, broken)), std::invalid_argument);
}

TEST(SimulatedServo, QuantisesDelaysAndSlews) {
    ServoModel servo;
    servo.pulse_step_us = 10;
    servo.delay_s = 0.05;
    servo.slew_rad_per_s = 2;
    auto driver = make_simulated_driver(servo, Coordinates::Zero(1));
    driver->send(Coordinates::Constant(1, 0.3), 0);
    EXPECT_EQ(driver->actual(0.04)[0], 0);
    driver->actual(0.05);
    EXPECT_NEAR(driver->actual(0.10)[0], 0.12, 0.021);  // slewing at 2 rad/s
    const double settled = driver->actual(1.0)[0];
    EXPECT_NEAR(settled * servo.us_per_rad / 10, std::round(settled * servo.us_per_rad / 10), 1e-9);
    EXPECT_NEAR(settled, 0.3, 5.1 / servo.us_per_rad);
}

TEST(SimulatedServo, ReachesBothSidesAlike) {
    ServoModel servo;
    servo.pulse_step_us = 0.3;
    servo.us_per_rad = 5000;
    for (const double angle : {0.123, 1.0, 1.9, 3.9}) {
        double reached[2];
        for (const int side : {0, 1}) {
            auto driver = make_simulated_driver(servo, Coordinates::Zero(1));
            driver->send(Coordinates::Constant(1, side ? -angle : angle), 0);
            driver->actual(0.1);
            reached[side] = driver->actual(2)[0];
        }
        EXPECT_EQ(reached[0], -reached[1]);
        EXPECT_NEAR(reached[0], angle, 0.51 * servo.pulse_step_us / servo.us_per_rad);
    }
}

TEST(Mailbox, NewestWinsAcrossThreads) {
    Mailbox<std::array<long, 8>> box;
    std::array<long, 8> value{};
    EXPECT_FALSE(box.take(value));
    std::thread writer([&] {
        for (long i = 1; i <= 200000; ++i) {
            std::array<long, 8> message;
            message.fill(i);
            box.publish(message);
        }
    });
    long last = 0;
    while (last < 200000) {
        if (!box.take(value)) continue;
        for (long x : value) ASSERT_EQ(x, value[0]) << "torn message";
        ASSERT_GT(value[0], last);
        last = value[0];
    }
    writer.join();
}

}  // namespace
}  // namespace palpate
