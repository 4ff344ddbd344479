// What comes back on servo lines: status packets in pieces, and replies of Maestro boards.

#include <algorithm>

#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_protocol.h"

using namespace palpate;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 2) return 0;
    const auto protocol = data[0] % 2 ? StatusReader::Protocol::dynamixel : StatusReader::Protocol::feetech;
    const std::size_t piece = 1 + data[1] % 64;
    const std::span<const std::uint8_t> line(data + 2, size - 2);
    StatusReader reader(protocol);
    std::size_t taken = 0;
    for (std::size_t at = 0; at < line.size(); at += piece) {
        reader.add(line.subspan(at, std::min(piece, line.size() - at)));
        while (const auto packet = reader.next()) taken += packet->parameters.size() + 1;
    }
    if (taken + std::size_t(reader.discarded) > line.size()) __builtin_trap();  // more came out than went in
    for (int channels : {6, 12, 18, 24}) {
        if (const auto v = maestro::parse_variables(channels, line)) maestro::describe_errors(v->errors);
        for (int servo = 0; servo < channels; ++servo) maestro::parse_servo(channels, servo, line);
    }
    return 0;
}
