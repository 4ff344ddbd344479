#pragma once
// Pololu Maestro boards on USB, through libusb.

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "devices/drivers/board_link.h"

namespace palpate::maestro {

/// A board as the bus shows it.
struct BoardInfo {
    int bus = 0, address = 0;
    int channels = 0;  ///< 0: in its bootloader
    std::string product, serial, firmware;
    std::string problem;  ///< why it could not be asked; permission, for example
    bool denied = false;
    // Asked of the board, where there is no problem:
    int watchdog_ms = 0;  ///< 0: off
    std::string errors;
    struct Channel {
        WireValue position = 0;         ///< [quarter us]
        double min_us = 0, max_us = 0;  ///< the board's own limits
        int home = 0;                   ///< 0: off, 1: ignore, otherwise [quarter us]
    };
    std::vector<Channel> servos;
};

/// All boards, those in their bootloader too. Throws std::runtime_error where USB itself cannot be used.
std::vector<BoardInfo> find_boards();

/// Writes the serial timeout (the board's watchdog), so that servos go home when nothing was heard for this long; home
/// becomes "off" for channels that would be left where they are. Refused while a program drives the board.
/// Returns what is wrong, or nothing.
std::string set_watchdog(const std::string& serial, int timeout_ms);

struct LinkSettings {
    std::string serial;  ///< empty: the only board there is
    struct Limits {
        double speed = 0, acceleration = 0;  ///< the board's own [us/s], [us/s^2]; 0: none
    };
    std::map<int, Limits> limits;  ///< per channel
    bool need_watchdog = true;     ///< refuse a board whose servos would not let go
};

/// Watchdogs that are accepted [ms]: longer ones let a finger be pressed for too long.
inline constexpr int longest_watchdog_ms = 500, usual_watchdog_ms = 200;
/// What a board would do with its servos if the program were killed, where that is not safe: for `channels`, or for
/// none yet. Empty where nothing is wrong.
std::string watchdog_problem(int watchdog_ms, const std::map<int, int>& homes);

std::unique_ptr<BoardLink> make_link(const LinkSettings& settings);

/// Writes the transfers to a file instead, one line each, with the time since it was opened.
std::unique_ptr<BoardLink> make_dry_link(const LinkSettings& settings, const std::filesystem::path& log);

}  // namespace palpate::maestro
