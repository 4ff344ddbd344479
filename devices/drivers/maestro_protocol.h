#pragma once
// Pololu Maestro servo controllers: native USB protocol (pololu-usb-sdk, MIT). Vendor requests to the device; no
// interface is claimed. Plain encoding and decoding, without USB.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "devices/drivers/servo.h"

namespace palpate::maestro {

inline constexpr std::uint16_t vendor = 0x1ffb;
inline constexpr std::array<std::pair<std::uint16_t, int>, 4> products{{{0x89, 6}, {0x8a, 12}, {0x8b, 18}, {0x8c, 24}}};
/// Channels of a product, 0 for a board in its bootloader (never to be driven), nothing for other devices.
std::optional<int> channels_of_product(std::uint16_t product);

/// A control transfer without data, or how to ask for some.
struct Request {
    std::uint8_t type, request;
    std::uint16_t value, index;
    std::uint16_t length = 0;
    bool operator==(const Request&) const = default;
};
/// Pulse in quarter microseconds; 0 = no pulses.
Request set_target(int channel, WireValue quarter_us);
/// Speed limit in 0.25 us / 10 ms; 0 = none.
Request set_speed(int channel, std::uint16_t limit);
/// Acceleration limit in 0.25 us / 10 ms / 80 ms; 0 = none.
Request set_acceleration(int channel, std::uint8_t limit);
Request clear_errors();
Request get_variables(int channels);
Request get_servo_settings(int channels);  ///< boards of 12 channels and more
Request get_parameter(int parameter, int bytes);
Request set_parameter(int parameter, int bytes, std::uint16_t value);
Request reinitialise();

inline constexpr int serial_timeout_parameter = 6;       ///< u16, 10 ms: the board's watchdog; 0 = off
inline constexpr std::uint16_t serial_timeout = 1 << 5;  ///< error bit: it has bitten
/// Parameters of servo i: home u16 (0 = off, 1 = ignore), smallest and largest pulse u8 in 16 us.
inline constexpr int home_parameter(int servo) { return 30 + 9 * servo; }
inline constexpr int min_parameter(int servo) { return 32 + 9 * servo; }
inline constexpr int max_parameter(int servo) { return 33 + 9 * servo; }

inline constexpr int home_ignore = 1;

struct Variables {
    std::uint16_t errors;
    bool script_done;
};
struct ServoSetting {
    WireValue position, target;
    std::uint16_t speed;
    std::uint8_t acceleration;
};
/// Nothing where the reply has another length than this board's.
std::optional<Variables> parse_variables(int channels, std::span<const std::uint8_t> reply);
/// Settings of one servo from the reply that holds them: servo settings, or the six-channel board's variables.
std::optional<ServoSetting> parse_servo(int channels, int servo, std::span<const std::uint8_t> reply);
/// Error bits in words; empty for none.
std::string describe_errors(std::uint16_t errors);

}  // namespace palpate::maestro
