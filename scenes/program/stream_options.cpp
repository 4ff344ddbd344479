#include "scenes/program/stream_options.h"

#include <cstdio>

#include "scenes/stream/stream.h"

namespace palpate {

void add_stream_options(const Command& c, StreamSettings& stream) {
    c.option(
        "--stream", stream.target,
        "tell other programs what is felt, a line of JSON a step: udp:HOST:PORT or websocket:PORT, whose answers are "
        "commands (pause, poses), or - for standard output");
    c.option("--stream-rate", stream.rate, "lines per simulated second at most (default: one a step)").range(1e-3, 1e5);
    c.flag("--stream-samples", stream.samples, "lines with places and forces of every sample");
    c.option("--stream-token", stream.token, "that a WebSocket must know (default: one that is made, and printed)");
    c.flag("--stream-wait", stream.waits, "with websocket: begin once somebody has connected");
}

void tell_address(const Stream& stream) {
    if (!stream.address().empty()) std::fprintf(stderr, "stream: %s\n", stream.address().c_str());
}

}  // namespace palpate
