// What bus servos keep without supply, and what they forget: modes in which no target is a place, and starts in
// mid-run.

#include "tests/devices/serial_fixture.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::protocol_name;
using testing::ServoBusEmulator;
using testing::settings_for;
using testing::sweep;
using testing::why;

class BusServos : public ::testing::TestWithParam<SerialProtocol> {};
INSTANTIATE_TEST_SUITE_P(All, BusServos, ::testing::Values(SerialProtocol::dynamixel, SerialProtocol::feetech),
                         protocol_name);

/// What is said of a bus that does not open; empty where it does.
std::string refusal(const SerialBusSettings& settings) {
    std::array<WireValue, max_channels> positions{};
    return make_serial_bus(settings)->open(positions);
}

/// In another mode a target is no place, or a speed limit no speed. (register, what is found, what is said)
TEST_P(BusServos, ModesInWhichATargetIsNoPlaceAreRefusedByName) {
    struct Case {
        int address, value;
        std::vector<std::string> said;
    };
    const bool wide = GetParam() == SerialProtocol::dynamixel;
    const std::vector<Case> cases =
        wide ? std::vector<Case>{{11, 1, {"operating mode 1 (velocity", "set register 11 to 3"}},
                                 {11, 0, {"operating mode 0 (current)", "set register 11 to 3"}},
                                 {11, 4, {"operating mode 4 (extended position", "set register 11 to 3"}},
                                 {11, 16, {"operating mode 16 (PWM", "set register 11 to 3"}},
                                 {10, 5, {"drive mode 5 (bit 2: profiles are times", "set register 10 to 1"}},
                                 {10, 8, {"drive mode 8 (bit 3", "set register 10 to 0"}}}
             : std::vector<Case>{{33, 1, {"mode 1 (wheel", "set register 33 to 0"}},
                                 {33, 2, {"mode 2 (PWM", "set register 33 to 0"}},
                                 {33, 3, {"mode 3 (steps", "set register 33 to 0"}}};
    const int torque = wide ? dynamixel::torque_enable : feetech::torque_enable;
    for (const Case& c : cases) {
        ServoBusEmulator bus(GetParam(), {4, 5});
        bus.keep(5, c.address, c.value);
        bus.keep(5, torque, 1);  // another program has left it on
        const std::string problem = refusal(settings_for(GetParam(), bus, {4, 5}));
        EXPECT_NE(problem.find("servo 5 is in"), std::string::npos) << problem;
        for (const std::string& said : c.said) EXPECT_NE(problem.find(said), std::string::npos) << problem;
        EXPECT_EQ(bus.goals_seen, 0) << "it was told a target in mode " << c.value;
        EXPECT_EQ(bus.get(5, torque), 0);
        EXPECT_EQ(bus.get(5, c.address), c.value) << "it is not ours to change";
    }
}

/// A run in force mode that was killed leaves its mode behind; a calibration holds which way a servo turns.
TEST(BusModes, ModesThatAreOursAreTakenBack) {
    ServoBusEmulator bus(SerialProtocol::dynamixel, {4, 5});
    bus.keep(5, dynamixel::operating_mode, dynamixel::current_based_position);
    bus.keep(4, dynamixel::drive_mode, 1);
    const SerialBusSettings settings = settings_for(SerialProtocol::dynamixel, bus, {4, 5});
    EXPECT_EQ(refusal(settings), "");
    EXPECT_EQ(bus.get(5, dynamixel::operating_mode), int(dynamixel::plain_position));
    bus.keep(5, dynamixel::operating_mode, dynamixel::current_based_position);
    bus.stubborn = true;
    const std::string problem = refusal(settings);
    EXPECT_NE(problem.find("does not keep its operating mode"), std::string::npos) << problem;
}

/// Torque off, nothing limited, and it answers as ever; a hand that is still shows nothing of it.
TEST_P(BusServos, AServoThatStartsAnewLatchesAlthoughNothingMoves) {
    ServoBusEmulator bus(GetParam(), {4, 5, 6});
    SerialBusSettings settings = settings_for(GetParam(), bus, {4, 5, 6});
    settings.speed_units_per_s = 4000;
    Board board(make_serial_bus(settings));
    for (int id : {4, 5, 6}) board.limit(id, {1000, 3000, 1e4});
    sweep(board, {4, 5, 6}, 20);
    ASSERT_TRUE(board.drain(5));
    ASSERT_EQ(board.state(), BoardState::active) << board.status().problem;
    int goals = -1;
    ASSERT_TRUE(eventually([&] {  // the hand is still: on a busy machine the last targets are still on their way
        goals = bus.goals_seen;
        std::this_thread::sleep_for(std::chrono::milliseconds(100));
        return bus.goals_seen == goals;
    }));
    bus.restart(5);
    ASSERT_TRUE(eventually([&] { return board.status().faults == 1; })) << "for ever active";
    EXPECT_NE(why(board.status()).find("servo 5 has started anew"), std::string::npos) << why(board.status());
    EXPECT_EQ(bus.goals_seen, goals);
    ASSERT_TRUE(eventually([&] { return board.state() == BoardState::inactive; })) << board.status().problem;
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    EXPECT_EQ(board.state(), BoardState::inactive) << "it waits for a person";
    EXPECT_TRUE(eventually([&] { return board.rearm(); }));
    EXPECT_EQ(board.status().faults, 1) << why(board.status());
}

/// Some switch their torque on again with the next target, and then know no limit of speed.
TEST(BusModes, AServoThatStartsAnewAndGoesOnLatches) {
    ServoBusEmulator bus(SerialProtocol::feetech, {4, 5});
    SerialBusSettings settings = settings_for(SerialProtocol::feetech, bus, {4, 5});
    settings.speed_units_per_s = 4000;
    Board board(make_serial_bus(settings));
    ASSERT_EQ(board.state(), BoardState::active);
    bus.restart(5);
    bus.keep(5, feetech::torque_enable, 1);
    ASSERT_TRUE(eventually([&] { return board.status().faults == 1; })) << "for ever active";
    EXPECT_NE(why(board.status()).find("speed limit is 0"), std::string::npos) << why(board.status());
}

}  // namespace
}  // namespace palpate
