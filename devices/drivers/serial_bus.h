#pragma once
// Servo controllers on a tty: Pololu Maestro by its compact protocol, Dynamixel and Feetech bus servos.

#include "devices/drivers/board.h"

namespace palpate {

enum class SerialProtocol { maestro_compact, dynamixel, feetech };

struct SerialBusSettings {
    SerialProtocol protocol = SerialProtocol::maestro_compact;
    std::string port;  ///< for example /dev/ttyUSB0
    int baud = 0;      ///< 0: the protocol's usual one (57600; Feetech 1000000)
    std::vector<int> channels;
    std::vector<int> force_channels;  ///< of thimbles in force mode: their torque is limited
    double speed_units_per_s = 0;     ///< the servos' own speed limit; 0: none
    bool need_watchdog = true;        ///< refuse what has no watchdog
};

std::unique_ptr<BoardLink> make_serial_bus(const SerialBusSettings& settings);

}  // namespace palpate
