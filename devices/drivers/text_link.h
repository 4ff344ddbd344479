#pragma once
// Servo controllers that one builds oneself, by the text protocol (text_protocol.h).

#include <memory>
#include <vector>

#include "devices/drivers/board_link.h"

namespace palpate {

struct TextLinkSettings {
    std::string port;           ///< for example /dev/ttyACM0
    std::vector<int> channels;  ///< that are used
    double speed_us_per_s = 0;  ///< the board's own speed limit
    bool need_watchdog = true;  ///< refuse a board whose watchdog does not read back as it was set
    double wake_s = 4;          ///< that a board has to answer in at first: many start anew as their port is opened
};

std::unique_ptr<BoardLink> make_text_link(const TextLinkSettings& settings);

}  // namespace palpate
