#include "scenes/program/stream_options.h"

namespace palpate {

void add_stream_options(const Command& c, StreamSettings& stream) {
    c.option(
        "--stream", stream.target,
        "tell other programs what is felt, a line of JSON a step: udp:HOST:PORT, whose answers are commands (pause, "
        "poses), or - for standard output");
    c.option("--stream-rate", stream.rate, "lines per simulated second at most (default: one a step)").range(1e-3, 1e5);
    c.flag("--stream-samples", stream.samples, "lines with places and forces of every sample");
}

}  // namespace palpate
