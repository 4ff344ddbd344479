#pragma once
// A Pololu Maestro by its compact protocol, on a tty.

#include "devices/drivers/serial_bus.h"

namespace palpate {

std::unique_ptr<BoardLink> make_compact_link(const SerialBusSettings& settings);

}  // namespace palpate
