// Servos on serial lines: protocols against their published examples, noise and pieces, and buses on pseudo-terminals.

#include "devices/drivers/serial_protocol.h"
#include "tests/devices/serial_fixture.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::protocol_name;
using testing::ServoBusEmulator;
using testing::settings_for;
using testing::sweep;
using testing::why;

TEST(SerialProtocols, PublishedExamples) {
    // Pololu Maestro user's guide, 5.e: channel 2 to 1500 us; channel 3 off and channel 4 to 1500 us in one command.
    const ChannelTarget one[] = {{2, 6000}};
    EXPECT_EQ(compact::set_targets(one, true), (Bytes{0x84, 0x02, 0x70, 0x2E}));
    const ChannelTarget two[] = {{3, 0}, {4, 6000}};
    EXPECT_EQ(compact::set_targets(two, true), (Bytes{0x9F, 0x02, 0x03, 0x00, 0x00, 0x70, 0x2E}));
    EXPECT_EQ(compact::set_speed(5, 140), (Bytes{0x87, 0x05, 0x0C, 0x01}));
    // Dynamixel protocol 2.0, e-manual: ping of 1; present position of 1; goal positions 150 and 170 of 1 and 2.
    EXPECT_EQ(dynamixel::instruction(1, dynamixel::ping, {}),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x03, 0x00, 0x01, 0x19, 0x4E}));
    EXPECT_EQ(dynamixel::read_register(1, 132, 4),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x07, 0x00, 0x02, 0x84, 0x00, 0x04, 0x00, 0x1D, 0x15}));
    const ChannelTarget goals[] = {{1, 150}, {2, 170}};
    EXPECT_EQ(dynamixel::write_targets(goals),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0xFE, 0x11, 0x00, 0x83, 0x74, 0x00, 0x04, 0x00,
                     0x01, 0x96, 0x00, 0x00, 0x00, 0x02, 0xAA, 0x00, 0x00, 0x00, 0x82, 0x87}));
    // The same packet for the current limits of two servos: register 102, two bytes each.
    const Bytes currents = dynamixel::write_torques(goals);
    EXPECT_EQ(Bytes(currents.begin(), currents.end() - 2),
              (Bytes{0xFF, 0xFF, 0xFD, 0x00, 0xFE, 0x0D, 0x00, 0x83, 0x66, 0x00, 0x02, 0x00, 0x01, 0x96, 0x00, 0x02,
                     0xAA, 0x00}));
    // Feetech STS, protocol manual: ping of 1; present position of 1, and its answer.
    EXPECT_EQ(feetech::instruction(1, 1, {}), (Bytes{0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB}));
    EXPECT_EQ(feetech::read_register(1, 56, 2), (Bytes{0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE}));
    StatusReader reader(StatusReader::Protocol::feetech);
    reader.add(Bytes{0xFF, 0xFF, 0x01, 0x04, 0x00, 0x18, 0x05, 0xDD});
    const auto answer = reader.next();
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->parameters, (Bytes{0x18, 0x05}));
    StatusReader wide(StatusReader::Protocol::dynamixel);
    wide.add(Bytes{0xFF, 0xFF, 0xFD, 0x00, 0x01, 0x08, 0x00, 0x55, 0x00, 0xA6, 0x00, 0x00, 0x00, 0x8C, 0xC0});
    const auto position = wide.next();
    ASSERT_TRUE(position);
    EXPECT_EQ(position->parameters, (Bytes{0xA6, 0, 0, 0}));
}

/// What a Dynamixel servo would answer: instruction 0x55, an error byte, parameters.
Bytes dynamixel_status(int id, Bytes parameters) {
    parameters.insert(parameters.begin(), 0);
    return dynamixel::instruction(std::uint8_t(id), 0x55, parameters);
}
Bytes feetech_status(int id, const Bytes& parameters) { return feetech::instruction(std::uint8_t(id), 0, parameters); }

TEST(SerialProtocols, PacketsAreFoundAmongNoiseInAnyPieces) {
    std::mt19937 random(2);
    for (const auto protocol : {StatusReader::Protocol::dynamixel, StatusReader::Protocol::feetech})
        for (int run = 0; run < 3000; ++run) {
            StatusReader reader(protocol);
            Bytes line;
            std::vector<Bytes> sent;
            for (int k = 0; k < 4; ++k) {
                // Noise that cannot pass for the beginning of a packet.
                for (unsigned n = random() % 9; n > 0; --n) line.push_back(std::uint8_t(random() % 0xF0));
                Bytes parameters;
                for (unsigned n = random() % 9; n > 0; --n)
                    parameters.push_back(std::uint8_t(random() % 3 ? 0xFF - 2 * (random() % 2) : random()));
                sent.push_back(parameters);
                const Bytes packet = protocol == StatusReader::Protocol::dynamixel ? dynamixel_status(k + 1, parameters)
                                                                                   : feetech_status(k + 1, parameters);
                line.insert(line.end(), packet.begin(), packet.end());
            }
            std::size_t found = 0;
            for (std::size_t at = 0; at < line.size();) {
                const std::size_t piece = std::min<std::size_t>(1 + random() % 7, line.size() - at);
                reader.add(std::span(line).subspan(at, piece));
                at += piece;
                while (const auto p = reader.next()) {
                    ASSERT_LT(found, sent.size());
                    EXPECT_EQ(p->parameters, sent[found]);
                    EXPECT_EQ(p->id, int(++found));
                }
            }
            EXPECT_EQ(found, sent.size());
        }
}

TEST(SerialProtocols, HostileBytesAreDiscarded) {
    std::mt19937 random(3);
    for (const auto protocol : {StatusReader::Protocol::dynamixel, StatusReader::Protocol::feetech})
        for (int run = 0; run < 2000; ++run) {
            StatusReader reader(protocol);
            for (int k = 0; k < 30; ++k) {
                Bytes bytes(random() % 40);
                for (auto& b : bytes) b = std::uint8_t(random() % 2 ? 0xFF - random() % 4 : random());
                reader.add(bytes);
                while (reader.next()) {}
            }
        }
}

class SerialBuses : public ::testing::TestWithParam<SerialProtocol> {};
INSTANTIATE_TEST_SUITE_P(All, SerialBuses,
                         ::testing::Values(SerialProtocol::maestro_compact, SerialProtocol::dynamixel,
                                           SerialProtocol::feetech),
                         protocol_name);

/// Servos that answer, and can limit their torque: hobby servos on a Maestro do neither.
class AnsweringSerialBuses : public ::testing::TestWithParam<SerialProtocol> {};
INSTANTIATE_TEST_SUITE_P(All, AnsweringSerialBuses,
                         ::testing::Values(SerialProtocol::dynamixel, SerialProtocol::feetech), protocol_name);

void expect_orderly(ServoBusEmulator& bus) {
    EXPECT_EQ(bus.bad_checksums, 0);
    EXPECT_EQ(bus.unknown_ids, 0);
    EXPECT_EQ(bus.collisions, 0);
}

TEST_P(SerialBuses, TargetsArriveAndPositionsComeBack) {
    ServoBusEmulator bus(GetParam(), {4, 5, 6, 9});
    SerialBusSettings settings = settings_for(GetParam(), bus, {4, 5, 6, 9});
    settings.speed_units_per_s = 4000;
    settings.acceleration_units_per_s2 = 20000;
    Board board(make_serial_bus(settings));
    if (GetParam() == SerialProtocol::dynamixel) {
        EXPECT_EQ(bus.get(4, dynamixel::torque_enable), 1);
        EXPECT_EQ(bus.get(9, dynamixel::bus_watchdog), 10);
        EXPECT_EQ(bus.get(9, dynamixel::profile_velocity, 4), 43) << "slow at first: a sixth of 4000 ticks/s";
        EXPECT_EQ(bus.get(9, dynamixel::goal_position, 4), 2000) << "where it was found";
    }
    for (int c : settings.channels) {
        board.limit(c, {1000, 3000, 1e9});
        board.set(c, WireValue(2000 + c));
    }
    board.wake();
    board.drain();
    EXPECT_TRUE(eventually([&] {
        const auto goals = bus.goals();
        for (int c : settings.channels)
            if (!goals.count(c) || goals.at(c) != 2000 + c) return false;
        return true;
    }));
    EXPECT_TRUE(eventually([&] { return board.position(9) == 2009; }));
    EXPECT_EQ(board.state(), BoardState::active);
    if (GetParam() != SerialProtocol::maestro_compact) {
        const bool wide = GetParam() == SerialProtocol::dynamixel;
        EXPECT_TRUE(eventually([&] {
            return wide ? bus.get(9, dynamixel::profile_velocity, 4) == 256
                        : bus.get(9, feetech::goal_speed, 2) == 4000;
        })) << "and then as it may";
        expect_orderly(bus);
    }
    bus.silent = true;
    EXPECT_TRUE(eventually([&] { return board.state() == BoardState::faulted; }));
    EXPECT_EQ(board.status().fault, FaultKind::silent);
}

TEST_P(AnsweringSerialBuses, TorqueLimitsArriveBeforeTargetsAndRiseSlowly) {
    ServoBusEmulator bus(GetParam(), {4, 5, 6});
    SerialBusSettings settings = settings_for(GetParam(), bus, {4, 5});
    settings.force_channels = {4, 5};
    const int where = GetParam() == SerialProtocol::dynamixel ? dynamixel::goal_current : feetech::torque_limit;
    {
        const ServoCalibration servo{2048, 651.9, 1024, 3072, 2827, 800};
        auto board = std::make_shared<Board>(make_serial_bus(settings));
        const auto driver = make_board_driver(board, {4, 5}, {servo, servo}, {6, 0, 0, {}});
        if (GetParam() == SerialProtocol::dynamixel) {
            EXPECT_EQ(bus.get(4, dynamixel::operating_mode), 5);
            EXPECT_EQ(bus.get(4, where, 2), 0) << "no force before the first limit";
        }
        ASSERT_TRUE(driver->limit_torque(Eigen::Vector2d(0.1, 5.0)));
        driver->send(Eigen::Vector2d(0, 0.05), 0);
        driver->flush();
        EXPECT_TRUE(eventually([&] { return bus.goals()[5] != 2000; }));
        const int first = bus.get(5, where, 2);
        EXPECT_GT(first, 0);
        EXPECT_LT(first, 800) << "from nothing to everything at once";
        EXPECT_TRUE(eventually([&] { return bus.get(5, where, 2) == 800; }));
        EXPECT_EQ(bus.get(4, where, 2), 283);
        ASSERT_TRUE(driver->limit_torque(Eigen::Vector2d(NAN, 0)));
        driver->send(Eigen::Vector2d(0, 0.05), 0.02);
        driver->flush();
        EXPECT_TRUE(eventually([&] { return bus.get(4, where, 2) == 0; }));
        const ServoCalibration hobby;
        EXPECT_FALSE(make_board_driver(board, {6}, {hobby}, {})->limit_torque(Coordinates::Ones(1)));
    }
    if (GetParam() != SerialProtocol::dynamixel) return;
    EXPECT_TRUE(eventually([&] { return bus.get(4, dynamixel::operating_mode) == 3; }));
    EXPECT_EQ(bus.get(4, dynamixel::torque_enable), 0);
    bus.stubborn = true;
    try {
        Board board(make_serial_bus(settings));
        FAIL() << "a servo without the mode was taken";
    } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find("current-based position"), std::string::npos) << error.what();
    }
}

TEST_P(SerialBuses, SilenceAtTheStartIsAProblem) {
    ServoBusEmulator bus(GetParam(), {1});
    bus.silent = true;
    SerialBusSettings settings = settings_for(GetParam(), bus, {1});
    settings.need_watchdog = false;
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.port = "/dev/null";
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.port = "/dev/no-such-port";
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
}

/// From within what it can be told, a servo comes back into its range by steps; from beyond it would turn at once.
TEST_P(AnsweringSerialBuses, AServoOutOfItsRangeComesBackSlowlyOrIsNotArmed) {
    ServoBusEmulator bus(GetParam(), {1, 2});
    const SerialBusSettings settings = settings_for(GetParam(), bus, {1, 2});
    bus.turn(2, 3500);
    {
        Board board(make_serial_bus(settings));
        board.limit(2, {1000, 3000, 1200});
        board.set(2, 3000);
        board.wake();
        const double began = device_clock();
        EXPECT_TRUE(eventually([&] { return board.position(2) == 3000; })) << board.status().problem;
        EXPECT_GT(device_clock() - began, 0.9 * 500 / (1200 * first_move_share));
    }
    bus.turn(2, GetParam() == SerialProtocol::dynamixel ? -5000 : 0x8000 | 5000);
    try {
        Board board(make_serial_bus(settings));
        FAIL() << "it is armed";
    } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find("servo 2 stands beyond"), std::string::npos) << error.what();
    }
}

/// On one wire whoever speaks hears it, too, and adapters send it back. That is no answer: of bus servos it can be told
/// from one; of a Maestro it would be taken for where a servo is, or for errors.
TEST_P(SerialBuses, WhatIsSaidAndComesBackIsNoAnswer) {
    ServoBusEmulator bus(GetParam(), {1, 2});
    bus.echoes = true;
    const SerialBusSettings settings = settings_for(GetParam(), bus, {1, 2});
    if (GetParam() == SerialProtocol::maestro_compact) {
        for (const bool joined : {false, true}) {  // and nobody else is there
            bus.silent = joined;
            std::array<WireValue, max_channels> positions{};
            const std::string problem = make_serial_bus(settings)->open(positions);
            EXPECT_NE(problem.find("what is said comes back"), std::string::npos) << problem;
            EXPECT_EQ(positions[1], no_pulse);
        }
        return;
    }
    Board board(make_serial_bus(settings));
    EXPECT_EQ(board.position(2), 2000);
    board.limit(2, {1000, 3000, 1e9});
    board.set(2, 2040);
    board.wake();
    EXPECT_TRUE(eventually([&] { return board.position(2) == 2040; })) << board.status().problem;
    EXPECT_EQ(board.state(), BoardState::active) << board.status().problem;
    EXPECT_EQ(bus.unknown_ids, 0);
}

TEST_P(SerialBuses, OnePortHasOneDriver) {
    ServoBusEmulator bus(GetParam(), {1});
    const SerialBusSettings settings = settings_for(GetParam(), bus, {1});
    {
        Board first(make_serial_bus(settings));
        try {
            Board second(make_serial_bus(settings));
            FAIL() << "two of them on one port";
        } catch (const std::runtime_error& error) {
            EXPECT_NE(std::string(error.what()).find("is in use"), std::string::npos) << error.what();
        }
    }
    EXPECT_NO_THROW(Board again(make_serial_bus(settings)));
}

/// What a bus with a dead servo came to.
struct DeadServo {
    BoardState before;
    BoardStatus after;
    bool lets_go;
    int told_later;
    double slowest;  ///< turn of the bus [s]
};

DeadServo let_a_servo_die(SerialProtocol protocol) {
    ServoBusEmulator bus(protocol, {4, 5, 6});
    Board board(make_serial_bus(settings_for(protocol, bus, {4, 5, 6})));
    for (int c : {4, 5, 6}) board.limit(c, {1000, 3000, 1e4});
    sweep(board, {4, 5, 6}, 20);
    DeadServo d{board.state(), {}, false, 0, 0};
    bus.dead = 5;  // writes to all go well on
    sweep(board, {4, 5, 6}, 500);
    d.after = board.status();
    const int torque = protocol == SerialProtocol::dynamixel ? dynamixel::torque_enable : feetech::torque_enable;
    d.lets_go = eventually([&] { return bus.get(4, torque) == 0; });
    const int goals = bus.goals_seen;
    sweep(board, {4, 5, 6}, 10);
    d.told_later = bus.goals_seen - goals;
    d.slowest = bus.slowest;
    return d;
}

TEST_P(AnsweringSerialBuses, ADeadServoLatchesWhileTheHandMovesOn) {
    DeadServo d{};
    for (int attempt = 0; attempt < 10; ++attempt) {
        // Answers that come late because the computer, and the bus that it emulates, stood still are failures, rightly.
        d = let_a_servo_die(GetParam());
        if (d.slowest < 0.015) break;
    }
    ASSERT_EQ(d.before, BoardState::active);
    EXPECT_NE(d.after.state, BoardState::active);
    EXPECT_EQ(d.after.fault, FaultKind::silent);
    EXPECT_NE(why(d.after).find("servo 5"), std::string::npos) << why(d.after);
    EXPECT_GE(d.after.read_failures[5], 2);
    EXPECT_EQ(d.after.read_failures[4], 0);
    EXPECT_EQ(d.after.write_failures[5], 0);
    EXPECT_TRUE(d.lets_go) << "a fault lets go";
    EXPECT_EQ(d.told_later, 0) << "nothing is sent after it";
}

TEST_P(AnsweringSerialBuses, WhatServosReportIsTypedAndLatches) {
    struct Case {
        int error, hardware;
        FaultKind kind;
    };
    const bool wide = GetParam() == SerialProtocol::dynamixel;
    for (const Case& c : wide ? std::vector<Case>{{0x80, 0x04, FaultKind::overheated},
                                                  {0x80, 0x20, FaultKind::overloaded},
                                                  {0x80, 0x01, FaultKind::electrical},
                                                  {0x07, 0, FaultKind::refused}}
                              : std::vector<Case>{{0x04, 0, FaultKind::overheated},
                                                  {0x20, 0, FaultKind::overloaded},
                                                  {0x01, 0, FaultKind::electrical}}) {
        ServoBusEmulator bus(GetParam(), {4, 5});
        Board board(make_serial_bus(settings_for(GetParam(), bus, {4, 5})));
        for (int id : {4, 5}) board.limit(id, {1000, 3000, 1e4});
        bus.error = c.error, bus.hardware = c.hardware;
        bus.error_of = 5;
        sweep(board, {4, 5}, 500);
        EXPECT_EQ(board.state(), BoardState::faulted) << c.error;
        EXPECT_EQ(name(board.status().fault), std::string(name(c.kind))) << board.status().problem;
        EXPECT_NE(why(board.status()).find("servo 5"), std::string::npos) << why(board.status());
    }
}

TEST_P(AnsweringSerialBuses, OneServoThatAnswersForAnotherLatches) {
    for (int as : {4, 77}) {
        ServoBusEmulator bus(GetParam(), {4, 5});
        Board board(make_serial_bus(settings_for(GetParam(), bus, {4, 5})));
        for (int id : {4, 5}) board.limit(id, {1000, 3000, 1e4});
        bus.answers_as = as;
        bus.impostor = 5;
        sweep(board, {4, 5}, 500);
        EXPECT_EQ(board.state(), BoardState::faulted);
        EXPECT_EQ(name(board.status().fault), std::string("wrong servo")) << board.status().problem;
    }
}

TEST_P(AnsweringSerialBuses, AServoThatDoesNotFollowLatches) {
    ServoBusEmulator bus(GetParam(), {4, 5});
    auto board = std::make_shared<Board>(make_serial_bus(settings_for(GetParam(), bus, {4, 5})));
    const ServoCalibration servo{2048, 651.9, 1024, 3072};
    const auto driver = make_board_driver(board, {4, 5}, {servo, servo}, {6, 200, 0.15, {}});
    const double at = (2000 - 2048) / 651.9;
    for (int k = 0; k < 60; ++k) {  // to and fro within a quarter radian, as fast as it may
        const double q = at + 0.25 * std::sin(0.2 * k);
        driver->send(Eigen::Vector2d(q, q), 0);
        driver->flush();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_EQ(board->state(), BoardState::active) << board->status().problem;
    bus.stuck = 5;
    for (int k = 0; k < 200 && board->state() == BoardState::active; ++k) {
        driver->send(Eigen::Vector2d(at + 0.3, at + 0.3), 0);
        driver->flush();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_EQ(name(board->status().fault), std::string("blocked")) << board->status().problem;
    EXPECT_NE(why(board->status()).find("servo 5"), std::string::npos) << why(board->status());
}

TEST(SerialBuses, AWatchdogThatHasBittenLatches) {
    const auto protocol = SerialProtocol::dynamixel;
    ServoBusEmulator bus(protocol, {4, 5});
    Board board(make_serial_bus(settings_for(protocol, bus, {4, 5})));
    for (int id : {4, 5}) board.limit(id, {1000, 3000, 1e4});
    sweep(board, {4, 5}, 10);
    ASSERT_EQ(board.state(), BoardState::active);
    bus.bite_now = true;  // as where this program was stopped for a while
    sweep(board, {4, 5}, 300);
    EXPECT_EQ(name(board.status().fault), std::string("watchdog")) << board.status().problem;
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::inactive; }));
    EXPECT_EQ(bus.get(4, dynamixel::torque_enable), 0) << "found again, and not armed";
    EXPECT_TRUE(eventually([&] { return board.rearm(); }));
    EXPECT_EQ(bus.get(4, dynamixel::torque_enable), 1);
    EXPECT_EQ(bus.get(4, dynamixel::bus_watchdog), 10);
}

/// A Maestro that has told its errors has forgotten them: the answer may have been lost.
TEST(SerialBuses, AWatchdogThatHasBittenLatchesAlthoughTheAnswerThatSaysSoIsLost) {
    const auto protocol = SerialProtocol::maestro_compact;
    for (const int home : {0, 6000}) {
        ServoBusEmulator bus(protocol, {4, 5});
        bus.home = home;
        Board board(make_serial_bus(settings_for(protocol, bus, {4, 5})));
        for (int id : {4, 5}) board.limit(id, {1000, 8000, 1e4});
        sweep(board, {4, 5}, 10);
        ASSERT_EQ(board.state(), BoardState::active);
        bus.errors_unheard = 1;  // nothing has bitten: it is asked again, and goes on
        sweep(board, {4, 5}, 40);
        EXPECT_EQ(bus.errors_unheard, 0);
        EXPECT_EQ(board.state(), BoardState::active) << why(board.status());
        ASSERT_TRUE(board.drain(5));
        bus.bites_unheard = true;
        bus.bite_now = true;
        ASSERT_TRUE(eventually([&] { return !bus.bite_now && bus.errors_unheard == 0; }));
        sweep(board, {4, 5}, 50);
        EXPECT_NE(board.state(), BoardState::active);
        EXPECT_EQ(bus.goals_after_bite, 0) << "told after its watchdog had bitten";
        if (home == 0) {
            EXPECT_EQ(name(board.status().fault), std::string("watchdog")) << why(board.status());
        } else {
            EXPECT_NE(why(board.status()).find("not where it was told to be"), std::string::npos)
                << why(board.status());
        }
    }
}

TEST(SerialBuses, SettingsThatSafetyRestsOnAreReadBack) {
    ServoBusEmulator bus(SerialProtocol::dynamixel, {4});
    bus.forgets_watchdog = true;
    try {
        Board board(make_serial_bus(settings_for(SerialProtocol::dynamixel, bus, {4})));
        FAIL() << "a watchdog that is not set was taken for one that is";
    } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find("does not keep its watchdog"), std::string::npos) << error.what();
    }
}

TEST(SerialBuses, WithoutAWatchdogTheyAreRefused) {
    ServoBusEmulator bus(SerialProtocol::feetech, {1});
    SerialBusSettings settings = settings_for(SerialProtocol::feetech, bus, {1});
    settings.need_watchdog = true;
    EXPECT_THROW(Board board(make_serial_bus(settings)), std::runtime_error);
    settings.need_watchdog = false;
    EXPECT_NO_THROW(Board board(make_serial_bus(settings)));
}

TEST(SerialProtocols, ADyingProgramSaysTheSame) {
    const std::vector<ChannelTarget> targets{{0, 1500}, {7, 2048}, {31, 3071}};
    std::array<std::uint8_t, 512> out;
    auto encoded = [&](SerialProtocol protocol) {
        return Bytes(out.begin(), out.begin() + std::ptrdiff_t(encode_targets(protocol, targets, out)));
    };
    EXPECT_EQ(encoded(SerialProtocol::dynamixel), dynamixel::write_targets(targets));
    EXPECT_EQ(encoded(SerialProtocol::feetech), feetech::write_targets(targets));
    EXPECT_EQ(encoded(SerialProtocol::maestro_compact), compact::set_targets(targets, false));
    std::array<std::uint8_t, 8> small;
    EXPECT_EQ(encode_targets(SerialProtocol::dynamixel, targets, small), 0u);
}

}  // namespace
}  // namespace palpate
