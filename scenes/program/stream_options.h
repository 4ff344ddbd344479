#pragma once

#include "scenes/program/options.h"
#include "scenes/stream/stream_settings.h"

namespace palpate {

class Stream;

/// --stream and what belongs to it.
void add_stream_options(const Command& command, StreamSettings& stream);
/// Says where WebSockets connect.
void tell_address(const Stream& stream);

}  // namespace palpate
