#include "devices/drivers/serial_protocol.h"

#include <algorithm>

namespace palpate {

namespace {

void append(Bytes& out, std::uint32_t value, int size) {
    for (int i = 0; i < size; ++i) out.push_back(std::uint8_t(value >> 8 * i));
}

}  // namespace

namespace compact {

namespace {
std::uint8_t low(std::uint16_t v) { return v & 0x7f; }
std::uint8_t high(std::uint16_t v) { return v >> 7 & 0x7f; }
}  // namespace

Bytes set_targets(std::span<const ChannelTarget> targets, bool multiple) {
    Bytes out;
    for (std::size_t i = 0; i < targets.size();) {
        std::size_t end = i + 1;
        while (end < targets.size() && targets[end].channel == targets[end - 1].channel + 1) ++end;
        if (multiple && end > i + 1) {
            out.insert(out.end(), {0x9F, std::uint8_t(end - i), std::uint8_t(targets[i].channel)});
            for (; i < end; ++i) out.insert(out.end(), {low(targets[i].value), high(targets[i].value)});
        } else {
            out.insert(out.end(),
                       {0x84, std::uint8_t(targets[i].channel), low(targets[i].value), high(targets[i].value)});
            ++i;
        }
    }
    return out;
}
Bytes set_speed(int channel, std::uint16_t limit) { return {0x87, std::uint8_t(channel), low(limit), high(limit)}; }
Bytes get_position(int channel) { return {0x90, std::uint8_t(channel)}; }
Bytes get_errors() { return {0xA1}; }

}  // namespace compact

namespace dynamixel {

std::uint16_t crc(std::span<const std::uint8_t> bytes) {
    std::uint16_t sum = 0;
    for (std::uint8_t byte : bytes) {
        sum = std::uint16_t(sum ^ byte << 8);
        for (int bit = 0; bit < 8; ++bit) sum = std::uint16_t(sum & 0x8000 ? sum << 1 ^ 0x8005 : sum << 1);
    }
    return sum;
}

Bytes instruction(std::uint8_t id, std::uint8_t what, std::span<const std::uint8_t> parameters) {
    Bytes body{what};
    int run = 0;  // how much of FF FF FD stands before this byte
    for (std::uint8_t p : parameters) {
        body.push_back(p);
        run = p == 0xFF ? std::min(run + 1, 2) : p == 0xFD && run == 2 ? 3 : 0;
        if (run == 3) body.push_back(0xFD), run = 0;
    }
    Bytes out{0xFF, 0xFF, 0xFD, 0x00, id};
    append(out, std::uint32_t(body.size() + 2), 2);
    out.insert(out.end(), body.begin(), body.end());
    append(out, crc(out), 2);
    return out;
}

Bytes write_register(std::uint8_t id, int address, int size, std::uint32_t value) {
    Bytes p;
    append(p, std::uint32_t(address), 2);
    append(p, value, size);
    return instruction(id, write, p);
}

Bytes read_register(std::uint8_t id, int address, int size) {
    Bytes p;
    append(p, std::uint32_t(address), 2);
    append(p, std::uint32_t(size), 2);
    return instruction(id, read, p);
}

Bytes write_all(int address, int size, std::span<const ChannelTarget> values) {
    Bytes p;
    append(p, std::uint32_t(address), 2);
    append(p, std::uint32_t(size), 2);
    for (const ChannelTarget& v : values) {
        p.push_back(std::uint8_t(v.channel));
        append(p, v.value, size);
    }
    return instruction(broadcast, sync_write, p);
}

Bytes write_targets(std::span<const ChannelTarget> targets) { return write_all(goal_position, 4, targets); }
Bytes write_torques(std::span<const ChannelTarget> limits) { return write_all(goal_current, 2, limits); }

Bytes read_all(int address, int size, std::span<const int> ids) {
    Bytes p;
    append(p, std::uint32_t(address), 2);
    append(p, std::uint32_t(size), 2);
    for (int id : ids) p.push_back(std::uint8_t(id));
    return instruction(broadcast, sync_read, p);
}
Bytes read_positions(std::span<const int> channels) { return read_all(present_position, 4, channels); }

LinkProblem problem_of(int id, int error, int hardware) {
    const std::string servo = "servo " + std::to_string(id);
    if (error & 0x80) {
        if (hardware & 0x04) return {servo + " is overheated", true, FaultKind::overheated};
        if (hardware & 0x20) return {servo + " is overloaded", true, FaultKind::overloaded};
        const char* what = hardware & 0x01 ? "its supply voltage" : hardware & 0x08 ? "its encoder" : "its electronics";
        return {servo + " reports a hardware error: " + what, true, FaultKind::electrical};
    }
    static constexpr const char* names[] = {"",
                                            "it failed",
                                            "an unknown instruction",
                                            "a wrong checksum",
                                            "a value out of range",
                                            "a wrong length",
                                            "a value beyond its limits",
                                            "no access"};
    if (error == 0) return {};
    return {servo + " refuses: " + (error < 8 ? names[error] : "an unknown error"), false, FaultKind::refused};
}

}  // namespace dynamixel

namespace feetech {

Bytes instruction(std::uint8_t id, std::uint8_t what, std::span<const std::uint8_t> parameters) {
    Bytes out{0xFF, 0xFF, id, std::uint8_t(parameters.size() + 2), what};
    for (std::uint8_t p : parameters) out.push_back(p);
    std::uint8_t sum = 0;
    for (std::size_t i = 2; i < out.size(); ++i) sum = std::uint8_t(sum + out[i]);
    out.push_back(std::uint8_t(~sum));
    return out;
}

Bytes write_register(std::uint8_t id, int address, int size, std::uint32_t value) {
    Bytes p{std::uint8_t(address)};
    append(p, value, size);
    return instruction(id, 3, p);
}

Bytes read_register(std::uint8_t id, int address, int size) {
    return instruction(id, 2, Bytes{std::uint8_t(address), std::uint8_t(size)});
}

Bytes write_all(int address, int size, std::span<const ChannelTarget> values) {
    Bytes p{std::uint8_t(address), std::uint8_t(size)};
    for (const ChannelTarget& v : values) {
        p.push_back(std::uint8_t(v.channel));
        append(p, v.value, size);
    }
    return instruction(broadcast, 0x83, p);
}
Bytes read_all(int address, int size, std::span<const int> ids) {
    Bytes p{std::uint8_t(address), std::uint8_t(size)};
    for (int id : ids) p.push_back(std::uint8_t(id));
    return instruction(broadcast, 0x82, p);
}

Bytes write_targets(std::span<const ChannelTarget> targets) { return write_all(goal_position, 2, targets); }
Bytes write_torques(std::span<const ChannelTarget> limits) { return write_all(torque_limit, 2, limits); }
Bytes read_positions(std::span<const int> channels) { return read_all(present_position, 2, channels); }

LinkProblem problem_of(int id, int error) {
    const std::string servo = "servo " + std::to_string(id);
    if (error & 0x04) return {servo + " is overheated", true, FaultKind::overheated};
    if (error & 0x28) return {servo + " is overloaded", true, FaultKind::overloaded};
    if (error & 0x03)
        return {servo + " reports a hardware error: " + (error & 0x01 ? "its supply voltage" : "its encoder"), true,
                FaultKind::electrical};
    if (error == 0) return {};
    return {servo + " reports an unknown error, bits " + std::to_string(error), false, FaultKind::reported};
}

}  // namespace feetech

namespace {

/// Bytes behind each other in memory that is there already.
struct Packet {
    std::span<std::uint8_t> out;
    std::size_t size = 0;
    void put(std::initializer_list<int> bytes) noexcept {
        for (int b : bytes)
            if (size < out.size()) out[size++] = std::uint8_t(b);
    }
};

}  // namespace

std::size_t encode_targets(SerialProtocol protocol, std::span<const ChannelTarget> targets,
                           std::span<std::uint8_t> out) noexcept {
    Packet p{out};
    const int count = int(targets.size());
    if (protocol == SerialProtocol::maestro_compact) {
        for (const auto& [c, v] : targets) p.put({0x84, c, v & 0x7f, v >> 7 & 0x7f});
    } else if (protocol == SerialProtocol::feetech) {
        p.put({0xFF, 0xFF, feetech::broadcast, 4 + 3 * count, 0x83, feetech::goal_position, 2});
        for (const auto& [c, v] : targets) p.put({c, v, v >> 8});
        int sum = 0;
        for (std::size_t i = 2; i < p.size; ++i) sum += out[i];
        p.put({~sum});
    } else {
        // Ids and high bytes are too small for what would have to be stuffed.
        const int length = 7 + 5 * count;
        p.put({0xFF, 0xFF, 0xFD, 0, dynamixel::broadcast, length, length >> 8, dynamixel::sync_write,
               dynamixel::goal_position, 0, 4, 0});
        for (const auto& [c, v] : targets) p.put({c, v, v >> 8, 0, 0});
        const std::uint16_t sum = dynamixel::crc(out.first(p.size));
        p.put({sum, sum >> 8});
    }
    return p.size < out.size() ? p.size : 0;
}

void StatusReader::drop(std::size_t count) {
    discarded += std::int64_t(count);
    buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(count));
}

std::optional<StatusPacket> StatusReader::next() {
    return protocol_ == Protocol::dynamixel ? next_dynamixel() : next_feetech();
}

std::optional<StatusPacket> StatusReader::next_dynamixel() {
    static constexpr std::uint8_t header[] = {0xFF, 0xFF, 0xFD, 0x00};
    constexpr std::size_t longest = 512;
    while (true) {
        const auto start = std::search(buffer_.begin(), buffer_.end(), std::begin(header), std::end(header));
        if (start == buffer_.end()) {
            if (buffer_.size() > 3) drop(buffer_.size() - 3);  // the end may be the beginning of a header
            return std::nullopt;
        }
        if (start != buffer_.begin()) drop(std::size_t(start - buffer_.begin()));
        if (buffer_.size() < 7) return std::nullopt;
        const std::size_t length = std::size_t(buffer_[5] | buffer_[6] << 8), whole = length + 7;
        if (length < 4 || whole > longest) {
            drop(4);
            continue;
        }
        if (buffer_.size() < whole) return std::nullopt;
        const std::uint16_t sum = dynamixel::crc(std::span(buffer_).first(whole - 2));
        if (buffer_[7] != 0x55 || sum != (buffer_[whole - 2] | buffer_[whole - 1] << 8)) {
            drop(4);
            continue;
        }
        StatusPacket p{buffer_[4], buffer_[8], {}};
        int run = 0;
        for (std::size_t i = 9; i + 2 < whole; ++i) {
            const std::uint8_t b = buffer_[i];
            if (run == 3 && b == 0xFD) {  // stuffing
                run = 0;
                continue;
            }
            run = b == 0xFF ? std::min(run + 1, 2) : b == 0xFD && run == 2 ? 3 : 0;
            p.parameters.push_back(b);
        }
        buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(whole));
        return p;
    }
}

std::optional<StatusPacket> StatusReader::next_feetech() {
    while (true) {
        const auto start = std::adjacent_find(buffer_.begin(), buffer_.end(),
                                              [](std::uint8_t a, std::uint8_t b) { return a == 0xFF && b == 0xFF; });
        if (start == buffer_.end()) {
            if (buffer_.size() > 1) drop(buffer_.size() - 1);
            return std::nullopt;
        }
        if (start != buffer_.begin()) drop(std::size_t(start - buffer_.begin()));
        if (buffer_.size() < 4) return std::nullopt;
        const std::size_t length = buffer_[3], whole = length + 4;
        if (buffer_[2] == 0xFF || length < 2) {
            drop(1);
            continue;
        }
        if (buffer_.size() < whole) return std::nullopt;
        std::uint8_t sum = 0;
        for (std::size_t i = 2; i + 1 < whole; ++i) sum = std::uint8_t(sum + buffer_[i]);
        if (buffer_[whole - 1] != std::uint8_t(~sum)) {
            drop(1);
            continue;
        }
        StatusPacket p{buffer_[2], buffer_[4], Bytes(buffer_.begin() + 5, buffer_.begin() + std::ptrdiff_t(whole) - 1)};
        buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(whole));
        if (p.id == feetech::broadcast) {  // no servo's: an adapter that echoes sends back what it was told
            discarded += std::int64_t(whole);
            continue;
        }
        return p;
    }
}

}  // namespace palpate
