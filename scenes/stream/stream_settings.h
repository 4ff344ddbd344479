#pragma once
// What a stream is asked for.

#include <string>

namespace palpate {

struct StreamSettings {
    std::string target;        ///< "udp:HOST:PORT", "websocket:PORT" (0: any free one), or "-": standard output
    std::string token;         ///< that a WebSocket must know; empty: one is made
    double rate = 0;           ///< lines per simulated second at most; 0: one a step
    bool samples = false;      ///< with places and forces of every sample
    bool any_address = false;  ///< WebSockets of other machines, too
    bool waits = false;        ///< the first step waits until a WebSocket is there
    bool takes_settings = false;
};

}  // namespace palpate
