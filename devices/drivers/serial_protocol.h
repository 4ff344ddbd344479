#pragma once
// What servo controllers on serial lines understand: Pololu's compact protocol, Dynamixel protocol 2.0, Feetech STS.
// Plain encoding and decoding, without a line.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "devices/drivers/board_link.h"

namespace palpate {

using Bytes = std::vector<std::uint8_t>;

namespace compact {
inline constexpr WireValue most = 0x3fff;  ///< that a target can say
/// Set Multiple Targets where channels follow each other (and the board has 12 channels or more), Set Target otherwise.
Bytes set_targets(std::span<const ChannelTarget> targets, bool multiple);
Bytes set_speed(int channel, std::uint16_t limit);
Bytes get_position(int channel);  ///< two bytes come back, low one first
Bytes get_errors();               ///< the same; clears them
}  // namespace compact

namespace dynamixel {
inline constexpr int drive_mode = 10, operating_mode = 11, torque_enable = 64, hardware_error = 70, bus_watchdog = 98,
                     goal_current = 102, profile_acceleration = 108, profile_velocity = 112, goal_position = 116,
                     present_position = 132;
/// Operating modes: a position; a position with a limited current.
inline constexpr std::uint32_t plain_position = 3, current_based_position = 5;
inline constexpr std::uint8_t ping = 1, read = 2, write = 3, sync_read = 0x82, sync_write = 0x83, broadcast = 0xFE;
/// CRC-16 (polynomial 0x8005) of a packet without its last two bytes.
std::uint16_t crc(std::span<const std::uint8_t> bytes);
/// A packet, bytes stuffed where parameters look like a header.
Bytes instruction(std::uint8_t id, std::uint8_t what, std::span<const std::uint8_t> parameters);
/// Little-endian numbers to or from a register of several servos.
Bytes write_register(std::uint8_t id, int address, int size, std::uint32_t value);
Bytes read_register(std::uint8_t id, int address, int size);
/// One register of several servos, written or asked for in one packet.
Bytes write_all(int address, int size, std::span<const ChannelTarget> values);
Bytes read_all(int address, int size, std::span<const int> ids);
Bytes write_targets(std::span<const ChannelTarget> targets);
Bytes write_torques(std::span<const ChannelTarget> limits);
Bytes read_positions(std::span<const int> channels);
/// What a status packet's error byte says: nothing for 0. `hardware` is the register hardware_error, asked for where
/// bit 7 (alert) is set.
LinkProblem problem_of(int id, int error, int hardware);
}  // namespace dynamixel

namespace feetech {
inline constexpr std::uint8_t broadcast = 0xFE;
inline constexpr int plain_position = 0;  ///< of its mode
inline constexpr int mode = 33, torque_enable = 40, acceleration = 41, goal_position = 42, goal_speed = 46,
                     torque_limit = 48, present_position = 56;
Bytes instruction(std::uint8_t id, std::uint8_t what, std::span<const std::uint8_t> parameters);
Bytes write_register(std::uint8_t id, int address, int size, std::uint32_t value);
Bytes read_register(std::uint8_t id, int address, int size);
/// One register of several servos, written or asked for in one packet.
Bytes write_all(int address, int size, std::span<const ChannelTarget> values);
Bytes read_all(int address, int size, std::span<const int> ids);
Bytes write_targets(std::span<const ChannelTarget> targets);
Bytes write_torques(std::span<const ChannelTarget> limits);
Bytes read_positions(std::span<const int> channels);
/// What a status packet's error byte says: nothing for 0.
LinkProblem problem_of(int id, int error);
}  // namespace feetech

enum class SerialProtocol { maestro_compact, dynamixel, feetech };

/// Targets as bytes for a signal handler: the same as the write_targets above (set_targets for a Maestro), without
/// allocating. Returns how many bytes of `out` [512] were used; 0 where they do not fit.
std::size_t encode_targets(SerialProtocol protocol, std::span<const ChannelTarget> targets,
                           std::span<std::uint8_t> out) noexcept;

/// What a bus servo answers.
struct StatusPacket {
    int id = 0, error = 0;
    Bytes parameters;
};

/// Finds status packets in what a line delivers, whatever else is on it. Never keeps more than the longest packet.
class StatusReader {
  public:
    enum class Protocol { dynamixel, feetech };
    explicit StatusReader(Protocol protocol) : protocol_(protocol) {}
    void add(std::span<const std::uint8_t> bytes) { buffer_.insert(buffer_.end(), bytes.begin(), bytes.end()); }
    std::optional<StatusPacket> next();
    std::int64_t discarded = 0;  ///< bytes that belonged to no packet
    void clear() { buffer_.clear(); }

  private:
    std::optional<StatusPacket> next_dynamixel();
    std::optional<StatusPacket> next_feetech();
    void drop(std::size_t count);
    Protocol protocol_;
    Bytes buffer_;
};

}  // namespace palpate
