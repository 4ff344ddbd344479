#pragma once
// A text protocol for servo controllers that one builds oneself (Arduino, ESP32, ...): 115,200 baud, one line per
// command, one line per answer. The reference for boards is devices/arduino/palpate_servos.
//
//   line    = NUMBER " " WORDS "*" CHECKSUM "\n"      at most 180 bytes; "\r" is ignored
//   NUMBER  = 1 to 60000, which the answer repeats; 0 answers a line that could not be read
//   CHECKSUM = four hexadecimal digits in capitals: CRC-16/CCITT-FALSE of all that stands before the "*"
//
//   command                  answer                                          what it does
//   hello                    ok palpate=1 channels=6 watchdog=200 state=idle
//   about 3                  ok min=900 max=2100 home=0 at=0 speed=400 measured=0
//                                                    of one channel: range and home [us], pulse now (0: none), speed
//                                                    limit [us/s], where the servo is as measured (0: unknown)
//   watchdog 200             ok                      from now on [ms], 50 to 1000
//   speed 0=600 1=600        ok                      pulses change no faster than this [us/s]
//   arm                      ok                      from now on servos follow, from where they are
//   set 0=1500 1=1620        ok                      targets [us]; all or none
//   feed                     ok state=armed 0=1498   nothing but the watchdog; measured places, where there are any
//   rest                     ok                      servos go home slowly, and stay
//   (anything)               err REASON              checksum, syntax, channel, range, idle (not armed), watchdog
//
// Without a good line for the watchdog's time, an armed board sends its servos home by itself, refuses `set` with
// "err watchdog", and says state=home, until it is armed anew.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "devices/drivers/board_link.h"

namespace palpate::text {

inline constexpr std::size_t longest_line = 180;
inline constexpr std::size_t most_targets = 16;  ///< of a line
inline constexpr int protocol = 1;

/// CRC-16/CCITT-FALSE: polynomial 0x1021, from 0xFFFF.
std::uint16_t checksum(std::string_view text) noexcept;

/// A whole line, end included. Throws std::invalid_argument where it would be too long.
std::string line_of(unsigned number, std::string_view words);

/// "set" or "speed" of at most 16 channels, as line_of, without allocating: for signal handlers, too. Returns its size;
/// 0 where it does not fit.
std::size_t encode_targets(unsigned number, std::string_view verb, std::span<const ChannelTarget> targets,
                           std::span<char> out) noexcept;

struct Reply {
    unsigned number = 0;
    bool ok = false;
    std::string words;  ///< behind "ok" or "err"
    /// The number behind "key="; nothing where there is none.
    std::optional<int> value(std::string_view key) const;
    /// The word behind "key="; empty where there is none.
    std::string_view word(std::string_view key) const;
};

/// Replies from bytes in any pieces; what is no whole line with the right checksum is dropped. Keeps no more than one
/// line.
class ReplyReader {
  public:
    void add(std::span<const std::uint8_t> bytes) { waiting_.append(bytes.begin(), bytes.end()); }
    std::optional<Reply> next();
    void clear() { waiting_.clear(); }
    std::int64_t dropped = 0;  ///< lines

  private:
    std::string waiting_;
};

}  // namespace palpate::text
