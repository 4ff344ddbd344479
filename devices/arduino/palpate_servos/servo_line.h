// The board's side of palpate's text protocol: lines in, servo pulses out. Plain C++11 without a library, so that it is
// tested on a computer, too. devices/drivers/text_protocol.h describes the protocol.
//
// What it promises, whatever comes in:
// - a servo gets pulses between its own min_us and max_us, and nothing before the board was armed;
// - pulses change no faster than its speed limit;
// - without a good line for the watchdog's time, servos go home slowly, and stay there until the board is armed anew.
#pragma once

#include <stdint.h>
#include <string.h>

struct ServoConfig {
    uint8_t pin;              // of the board, or the channel of a PCA9685
    uint16_t min_us, max_us;  // what the servo may ever be sent
    uint16_t home_us;         // where it goes when nobody commands it any more; 0: its pulses end, and it lets go
};

// What the sketch provides.
void write_pulse(uint8_t channel, uint16_t us);  // 0: no pulse
uint16_t measured_pulse(uint8_t channel);        // where the servo is; 0: it cannot tell
void write_text(const char* text);

enum BoardState { board_idle, board_armed, board_home };

struct ServoChannel {
    uint32_t at;         // pulse now [us / 256]; 0: none
    uint16_t target_us;  // 0: none
    uint16_t speed;      // [us/s]
};

const uint8_t most_servos = 16;
const uint8_t longest_line = 180;
const uint16_t slow_us_per_s = 400;  // until a limit was set, and on the way home

struct ServoBoard {
    const ServoConfig* config;
    uint8_t count;
    ServoChannel channel[most_servos];
    BoardState state;
    uint16_t watchdog_ms;
    uint32_t fed_at, moved_at;  // [ms]
    char line[longest_line + 1];
    uint8_t length;
    bool too_long;
};

inline void begin_board(ServoBoard& b, const ServoConfig* config, uint8_t count, uint32_t now) {
    memset(&b, 0, sizeof b);
    b.config = config;
    b.count = count < most_servos ? count : most_servos;
    b.state = board_idle;
    b.watchdog_ms = 200;
    b.fed_at = b.moved_at = now;
    for (uint8_t c = 0; c < b.count; ++c) b.channel[c].speed = slow_us_per_s;
}

// CRC-16/CCITT-FALSE: polynomial 0x1021 from 0xFFFF.
inline uint16_t crc_of(const char* text, uint8_t size) {
    uint16_t crc = 0xFFFF;
    for (uint8_t i = 0; i < size; ++i) {
        crc ^= uint16_t(uint8_t(text[i])) << 8;
        for (uint8_t k = 0; k < 8; ++k) crc = uint16_t(crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

// A reply as it is put together.
struct Reply {
    char text[longest_line + 8];
    uint8_t length;
};
inline void put(Reply& r, const char* text) {
    while (*text && r.length < longest_line - 6) r.text[r.length++] = *text++;
}
inline void put_number(Reply& r, uint16_t n) {
    char digits[6];
    uint8_t at = 5;
    digits[5] = 0;
    do digits[--at] = char('0' + n % 10), n /= 10;
    while (n);
    put(r, digits + at);
}
inline void put_pair(Reply& r, const char* key, uint16_t n) {
    put(r, " ");
    put(r, key);
    put(r, "=");
    put_number(r, n);
}
inline void send_reply(Reply& r) {
    uint16_t crc = crc_of(r.text, r.length);
    r.text[r.length++] = '*';
    for (int8_t shift = 12; shift >= 0; shift -= 4) r.text[r.length++] = "0123456789ABCDEF"[crc >> shift & 15];
    r.text[r.length++] = '\n';
    r.text[r.length] = 0;
    write_text(r.text);
}
inline void answer(uint16_t number, const char* word) {
    Reply r;
    r.length = 0;
    put_number(r, number);
    put(r, " ");
    put(r, word);
    send_reply(r);
}

// A number at `text`, moved behind it; false where there is none, or more than 65535.
inline bool take_number(const char*& text, uint16_t& n) {
    uint32_t value = 0;
    const char* begin = text;
    while (*text >= '0' && *text <= '9' && text - begin < 6) value = 10 * value + uint32_t(*text++ - '0');
    n = uint16_t(value);
    return text > begin && value <= 65535 && !(*text >= '0' && *text <= '9');
}
inline bool take_space(const char*& text) {
    if (*text != ' ') return false;
    ++text;
    return true;
}
inline bool take_word(const char*& text, const char* word) {
    uint8_t n = uint8_t(strlen(word));
    if (strncmp(text, word, n) != 0 || (text[n] != ' ' && text[n] != 0)) return false;
    text += n;
    return true;
}
// " 0=1500 1=1600" to the end of the line: all of it is good, or none of it counts.
inline bool take_pairs(const ServoBoard& b, const char* text, uint16_t low, uint16_t high, uint16_t* values,
                       const char*& wrong) {
    for (uint8_t c = 0; c < b.count; ++c) values[c] = 0;
    wrong = "err syntax";
    if (!*text) return false;
    while (*text) {
        uint16_t c, v;
        if (!take_space(text) || !take_number(text, c) || *text++ != '=' || !take_number(text, v)) return false;
        if (c >= b.count) return wrong = "err channel", false;
        if (values[c]) return false;  // twice
        if (v < low || v > high || v == 0) return wrong = "err range", false;
        values[c] = v;
    }
    return true;
}

inline void go_home(ServoBoard& b) {
    b.state = board_home;
    for (uint8_t c = 0; c < b.count; ++c) {
        ServoChannel& s = b.channel[c];
        if (s.at == 0) continue;  // it never got a pulse
        s.target_us = b.config[c].home_us;
        s.speed = slow_us_per_s;
        if (s.target_us == 0) s.at = 0, write_pulse(c, 0);
    }
}

inline const char* state_name(BoardState s) { return s == board_idle ? "idle" : s == board_armed ? "armed" : "home"; }

inline void set_targets(ServoBoard& b, uint16_t number, const char* text) {
    uint16_t values[most_servos];
    const char* wrong;
    if (b.state != board_armed) return answer(number, b.state == board_home ? "err watchdog" : "err idle");
    if (!take_pairs(b, text, 1, 65535, values, wrong)) return answer(number, wrong);
    for (uint8_t c = 0; c < b.count; ++c)
        if (values[c] && (values[c] < b.config[c].min_us || values[c] > b.config[c].max_us))
            return answer(number, "err range");
    for (uint8_t c = 0; c < b.count; ++c) {
        if (!values[c]) continue;
        ServoChannel& s = b.channel[c];
        s.target_us = values[c];
        // Nothing is known of a servo without pulses: it is where it was parked, or anywhere.
        if (s.at == 0) s.at = uint32_t(b.config[c].home_us ? b.config[c].home_us : values[c]) << 8;
    }
    answer(number, "ok");
}

inline void tell_state(ServoBoard& b, uint16_t number, bool about_all) {
    Reply r;
    r.length = 0;
    put_number(r, number);
    put(r, about_all ? " ok palpate=1" : " ok");
    if (about_all) put_pair(r, "channels", b.count);
    if (about_all) put_pair(r, "watchdog", b.watchdog_ms);
    put(r, " state=");
    put(r, state_name(b.state));
    for (uint8_t c = 0; c < b.count && !about_all; ++c) {
        uint16_t at = measured_pulse(c);
        char key[3] = {char('0' + c / 10), char('0' + c % 10), 0};
        if (at) put_pair(r, c < 10 ? key + 1 : key, at);
    }
    send_reply(r);
}

inline void tell_channel(ServoBoard& b, uint16_t number, const char* text) {
    uint16_t c;
    if (!take_space(text) || !take_number(text, c) || *text) return answer(number, "err syntax");
    if (c >= b.count) return answer(number, "err channel");
    Reply r;
    r.length = 0;
    put_number(r, number);
    put(r, " ok");
    put_pair(r, "min", b.config[c].min_us);
    put_pair(r, "max", b.config[c].max_us);
    put_pair(r, "home", b.config[c].home_us);
    put_pair(r, "at", uint16_t(b.channel[c].at >> 8));
    put_pair(r, "speed", b.channel[c].speed);
    put_pair(r, "measured", measured_pulse(uint8_t(c)));
    send_reply(r);
}

inline void set_watchdog(ServoBoard& b, uint16_t number, const char* text) {
    uint16_t ms;
    if (!take_space(text) || !take_number(text, ms) || *text) return answer(number, "err syntax");
    if (ms < 50 || ms > 1000) return answer(number, "err range");
    b.watchdog_ms = ms;
    answer(number, "ok");
}

inline void set_speeds(ServoBoard& b, uint16_t number, const char* text) {
    uint16_t values[most_servos];
    const char* wrong;
    if (!take_pairs(b, text, 1, 20000, values, wrong)) return answer(number, wrong);
    for (uint8_t c = 0; c < b.count; ++c)
        if (values[c]) b.channel[c].speed = values[c];
    answer(number, "ok");
}

inline void obey(ServoBoard& b, uint16_t number, const char* text) {
    if (take_word(text, "set")) return set_targets(b, number, text);
    if (take_word(text, "about")) return tell_channel(b, number, text);
    if (take_word(text, "watchdog")) return set_watchdog(b, number, text);
    if (take_word(text, "speed")) return set_speeds(b, number, text);
    if (take_word(text, "feed") && !*text) return tell_state(b, number, false);
    if (take_word(text, "hello") && !*text) return tell_state(b, number, true);
    if (take_word(text, "rest") && !*text) {
        if (b.state == board_armed) go_home(b);
        return answer(number, "ok");
    }
    if (take_word(text, "arm") && !*text) {
        for (uint8_t c = 0; c < b.count; ++c) b.channel[c].target_us = uint16_t(b.channel[c].at >> 8);  // it stays
        b.state = board_armed;
        return answer(number, "ok");
    }
    answer(number, "err syntax");
}

// A whole line without its end.
inline void take_line(ServoBoard& b, uint32_t now) {
    const char* text = b.line;
    uint16_t number;
    if (b.length < 6 || b.line[b.length - 5] != '*') return answer(0, "err checksum");
    uint16_t expected = crc_of(b.line, uint8_t(b.length - 5)), found = 0;
    for (uint8_t i = uint8_t(b.length - 4); i < b.length; ++i) {
        char d = b.line[i];
        uint8_t value = d >= '0' && d <= '9' ? uint8_t(d - '0') : d >= 'A' && d <= 'F' ? uint8_t(d - 'A' + 10) : 255;
        if (value == 255) return answer(0, "err checksum");
        found = uint16_t(found << 4 | value);
    }
    b.line[b.length - 5] = 0;
    if (found != expected) return answer(0, "err checksum");
    if (strlen(b.line) + 5 != b.length || !take_number(text, number) || number > 60000 || !take_space(text))
        return answer(0, "err syntax");
    b.fed_at = now;
    obey(b, number, text);
}

inline void receive_byte(ServoBoard& b, char c, uint32_t now) {
    if (c == '\r') return;
    if (c != '\n') {
        if (b.length < longest_line)
            b.line[b.length++] = c;
        else
            b.too_long = true;
        return;
    }
    b.line[b.length] = 0;
    if (b.too_long)
        answer(0, "err checksum");
    else if (b.length > 0)
        take_line(b, now);
    b.length = 0;
    b.too_long = false;
}

// Moves servos towards their targets, and home if nobody commands them. As often as can be.
inline void tick_board(ServoBoard& b, uint32_t now) {
    if (b.state == board_armed && now - b.fed_at > b.watchdog_ms) go_home(b);
    uint32_t passed = now - b.moved_at;
    if (passed == 0) return;
    b.moved_at = now;
    if (passed > 50) passed = 50;  // a pause earns no larger step
    for (uint8_t c = 0; c < b.count; ++c) {
        ServoChannel& s = b.channel[c];
        if (s.at == 0 || s.target_us == 0) continue;
        uint32_t target = uint32_t(s.target_us) << 8, step = (uint32_t(s.speed) * passed << 8) / 1000;
        if (s.at < target)
            s.at = target - s.at > step ? s.at + step : target;
        else
            s.at = s.at - target > step ? s.at - step : target;
        write_pulse(c, uint16_t(s.at >> 8));
    }
}
