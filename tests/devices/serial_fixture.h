#pragma once
// What tests of servos on emulated buses share.

#include "devices/drivers/board.h"
#include "devices/drivers/serial_bus.h"
#include "tests/emulator/servo_bus.h"
#include "tests/support.h"

namespace palpate::testing {

inline std::string protocol_name(const ::testing::TestParamInfo<SerialProtocol>& info) {
    return info.param == SerialProtocol::dynamixel ? "dynamixel"
           : info.param == SerialProtocol::feetech ? "feetech"
                                                   : "maestro";
}

inline SerialBusSettings settings_for(SerialProtocol protocol, const ServoBusEmulator& bus, std::vector<int> ids) {
    SerialBusSettings settings;
    settings.protocol = protocol;
    settings.port = bus.port;
    settings.channels = std::move(ids);
    settings.need_watchdog = protocol == SerialProtocol::dynamixel;
    return settings;
}

/// Keeps a board's servos on the move, as a hand does; every servo is told something new each time.
inline void sweep(Board& board, const std::vector<int>& ids, int steps, int ms = 10) {
    for (int k = 0; k < steps && board.state() == BoardState::active; ++k) {
        for (int c : ids) board.set(c, WireValue(2000 + k % 50));
        board.wake();
        std::this_thread::sleep_for(std::chrono::milliseconds(ms));
    }
}

/// Why a board went into its first fault; its newest problem is of its attempts to come back.
inline std::string why(const BoardStatus& status) {
    for (const BoardTransition& t : status.transitions)
        if (t.to == BoardState::faulted) return t.reason;
    return "";
}

}  // namespace palpate::testing
