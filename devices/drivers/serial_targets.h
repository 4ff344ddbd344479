#pragma once
// How targets go over a serial line, whatever the protocol.

#include "devices/drivers/serial_line.h"
#include "devices/drivers/serial_protocol.h"

namespace palpate {

/// One packet for all targets, which arrive as its last byte has gone over the line, which takes so long a byte [s].
LinkProblem write_in_one(SerialLine& line, const Bytes& packet, double byte_takes, std::span<Transfer> transfers);

/// In a signal handler: what fits into the line's buffer.
bool write_now(int fd, SerialProtocol protocol, std::span<const ChannelTarget> targets) noexcept;

}  // namespace palpate
