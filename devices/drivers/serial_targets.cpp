#include "devices/drivers/serial_targets.h"

#include <unistd.h>

#include <algorithm>

#include "devices/loop/clock.h"

namespace palpate {

LinkProblem write_in_one(SerialLine& line, const Bytes& packet, double byte_takes, std::span<Transfer> transfers) {
    const double sent = device_clock();
    const LinkProblem problem = line.write(packet);
    const Transfer all{sent, device_clock() + byte_takes * double(packet.size())};
    if (!problem) std::fill(transfers.begin(), transfers.end(), all);
    return problem;
}

bool write_now(int fd, SerialProtocol protocol, std::span<const ChannelTarget> targets) noexcept {
    std::uint8_t bytes[512];
    const std::size_t size = fd >= 0 ? encode_targets(protocol, targets, bytes) : 0;
    return size > 0 && ::write(fd, bytes, size) == ssize_t(size);
}

}  // namespace palpate
