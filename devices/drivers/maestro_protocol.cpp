#include "devices/drivers/maestro_protocol.h"

namespace palpate::maestro {

namespace {

constexpr std::uint8_t out = 0x40, in = 0xC0;
/// The six-channel board answers with its stacks before the seven bytes per servo.
constexpr int micro_header = 98, micro_script_done = 96, bytes_per_servo = 7, mini_variables = 8;

std::uint16_t word(std::span<const std::uint8_t> bytes, std::size_t at) {
    return std::uint16_t(bytes[at] | bytes[at + 1] << 8);
}

}  // namespace

std::optional<int> channels_of_product(std::uint16_t product) {
    for (const auto& [id, channels] : products)
        if (id == product) return channels;
    if (product == 0x88 || (product >= 0x8d && product <= 0x8f)) return 0;
    return std::nullopt;
}

Request set_target(int channel, WireValue quarter_us) { return {out, 0x85, quarter_us, std::uint16_t(channel)}; }
Request set_speed(int channel, std::uint16_t limit) { return {out, 0x84, limit, std::uint16_t(channel)}; }
Request set_acceleration(int channel, std::uint8_t limit) { return {out, 0x84, limit, std::uint16_t(channel | 0x80)}; }
Request clear_errors() { return {out, 0x86, 0, 0}; }
Request get_variables(int channels) {
    return {in, 0x83, 0, 0, std::uint16_t(channels == 6 ? micro_header + 6 * bytes_per_servo : mini_variables)};
}
Request get_servo_settings(int channels) { return {in, 0x87, 0, 0, std::uint16_t(channels * bytes_per_servo)}; }
Request get_parameter(int parameter, int bytes) {
    return {in, 0x81, 0, std::uint16_t(parameter), std::uint16_t(bytes)};
}
Request set_parameter(int parameter, int bytes, std::uint16_t value) {
    return {out, 0x82, value, std::uint16_t((bytes << 8) + parameter)};
}
Request reinitialise() { return {out, 0x90, 0, 0}; }

std::optional<Variables> parse_variables(int channels, std::span<const std::uint8_t> reply) {
    if (reply.size() != get_variables(channels).length) return std::nullopt;
    return Variables{word(reply, 2), reply[channels == 6 ? micro_script_done : 6] != 0};
}

std::optional<ServoSetting> parse_servo(int channels, int servo, std::span<const std::uint8_t> reply) {
    const std::size_t header = channels == 6 ? micro_header : 0;
    if (reply.size() != header + std::size_t(channels * bytes_per_servo) || servo < 0 || servo >= channels)
        return std::nullopt;
    const std::size_t at = header + std::size_t(servo * bytes_per_servo);
    return ServoSetting{word(reply, at), word(reply, at + 2), word(reply, at + 4), reply[at + 6]};
}

std::string describe_errors(std::uint16_t errors) {
    static constexpr const char* names[] = {"serial signal", "serial overrun",    "serial buffer full",
                                            "serial CRC",    "serial protocol",   "serial timeout",
                                            "script stack",  "script call stack", "script program counter"};
    std::string text;
    for (int bit = 0; bit < 16; ++bit)
        if (errors >> bit & 1) text += (text.empty() ? "" : ", ") + std::string(bit < 9 ? names[bit] : "unknown");
    return text;
}

}  // namespace palpate::maestro
