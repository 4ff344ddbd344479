#pragma once
// Servo controllers on a tty: Pololu Maestro by its compact protocol, Dynamixel and Feetech bus servos.

#include <memory>

#include "devices/drivers/board_link.h"
#include "devices/drivers/serial_protocol.h"

namespace palpate {

struct SerialBusSettings {
    SerialProtocol protocol = SerialProtocol::maestro_compact;
    std::string port;  ///< for example /dev/ttyUSB0
    int baud = 0;      ///< 0: the protocol's usual one (57600; Feetech 1000000)
    std::vector<int> channels;
    std::vector<int> force_channels;       ///< of thimbles in force mode: their torque is limited
    double speed_units_per_s = 0;          ///< the servos' own speed limit; 0: none
    double acceleration_units_per_s2 = 0;  ///< the servos' own acceleration limit; 0: none
    bool need_watchdog = true;             ///< refuse what has no watchdog
};

/// Throws std::runtime_error where a watchdog is needed and the protocol has none.
std::unique_ptr<BoardLink> make_serial_bus(const SerialBusSettings& settings);

}  // namespace palpate
