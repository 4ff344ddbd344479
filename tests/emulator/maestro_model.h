#pragma once
// What a Pololu Maestro does with requests, wherever they come from, and what it writes down (wire_log.h).

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <map>
#include <vector>

#include "devices/drivers/maestro_protocol.h"
#include "tests/emulator/wire_log.h"

namespace palpate::testing {

struct MaestroModel {
    struct Servo {
        std::uint16_t position = 0, target = 0, speed = 0;
        std::uint8_t acceleration = 0;
    };
    int number = 0, channels = 0;  ///< 0 channels: in its bootloader
    std::vector<Servo> servos;
    std::map<int, int> parameters;
    std::uint16_t errors = 0;
    bool sticky = false, deaf = false, fed = false, told = false, keeps_speed = true;
    std::chrono::steady_clock::time_point last_fed, start = std::chrono::steady_clock::now();
    FILE* log = nullptr;
};

inline void set_up(MaestroModel& b, int channels, int watchdog_ms, int home, int at) {
    b.channels = channels;
    b.servos.resize(std::size_t(channels));
    b.parameters[maestro::serial_timeout_parameter] = watchdog_ms / 10;
    for (int c = 0; c < channels; ++c) {
        b.servos[std::size_t(c)].position = std::uint16_t(at);
        b.parameters[maestro::home_parameter(c)] = home;
        b.parameters[maestro::min_parameter(c)] = 62;   // 992 us
        b.parameters[maestro::max_parameter(c)] = 125;  // 2000 us
    }
}

/// A line of the log.
inline void note(const MaestroModel& b, int channel, int value) {
    if (!b.log) return;
    std::fprintf(b.log, "%.6f %d %d %d\n",
                 std::chrono::duration<double>(std::chrono::steady_clock::now() - b.start).count(), b.number, channel,
                 value);
    std::fflush(b.log);
}

/// Servos go home: off, or to a place, or nowhere.
inline void bite(MaestroModel& b) {
    b.errors |= maestro::serial_timeout;
    b.fed = false;
    for (int c = 0; c < b.channels; ++c)
        if (const int home = b.parameters[maestro::home_parameter(c)]; home != maestro::home_ignore)
            b.servos[std::size_t(c)].position = b.servos[std::size_t(c)].target = std::uint16_t(home);
    note(b, watchdog_bit, 0);
}

inline void put(std::vector<std::uint8_t>& out, int value) {
    out.push_back(std::uint8_t(value));
    out.push_back(std::uint8_t(value >> 8));
}

inline std::vector<std::uint8_t> settings_reply(const MaestroModel& b) {
    std::vector<std::uint8_t> out;
    for (const MaestroModel::Servo& s : b.servos) {
        put(out, s.position), put(out, s.target), put(out, s.speed);
        out.push_back(s.acceleration);
    }
    return out;
}

/// What a vendor request changes.
inline bool obey(MaestroModel& b, int request, int value, int index) {
    if (request == 0x85 || request == 0x86) b.fed = true, b.last_fed = std::chrono::steady_clock::now();
    if (request == 0x85) {
        if (index >= b.channels || (b.deaf && index == 1)) return false;
        b.told = true;
        b.servos[std::size_t(index)].target = b.servos[std::size_t(index)].position = std::uint16_t(value);
        return note(b, index, value), true;
    }
    if (request == 0x84) {
        if ((index & 0x7f) >= b.channels) return false;
        MaestroModel::Servo& servo = b.servos[std::size_t(index & 0x7f)];
        if (index & 0x80) return servo.acceleration = std::uint8_t(value), true;
        servo.speed = std::uint16_t(b.keeps_speed ? value : 0);
        return note(b, speed_of_channel_0 - index, value), true;
    }
    if (request == 0x86) return b.errors = 0, true;
    if (request == 0x82) return b.parameters[index & 0xff] = value, true;
    return request == 0x90;
}

/// The answer to a vendor request; false: it stalls.
inline bool answer(MaestroModel& b, int type, int request, int value, int index, std::vector<std::uint8_t>& reply) {
    if (b.channels == 0) return false;
    if (type == 0x40) return obey(b, request, value, index);
    if (type != 0xC0) return false;
    if (request == 0x81) {
        const int v = b.parameters[index];
        reply = {std::uint8_t(v), std::uint8_t(v >> 8)};
        return true;
    }
    if (request == 0x87) return b.channels > 6 ? (reply = settings_reply(b), true) : false;
    if (request != 0x83) return false;
    reply.assign(b.channels == 6 ? 98 : 8, 0);
    if (b.sticky) b.errors |= 1 << 4;
    reply[2] = std::uint8_t(b.errors), reply[3] = std::uint8_t(b.errors >> 8);
    reply[b.channels == 6 ? 96 : 6] = 1;
    if (b.channels == 6)
        for (std::uint8_t byte : settings_reply(b)) reply.push_back(byte);
    return true;
}

}  // namespace palpate::testing
