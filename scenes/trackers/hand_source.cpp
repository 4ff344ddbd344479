#include "scenes/trackers/hand_source.h"

#include <algorithm>
#include <charconv>

#include "meshes/input_error.h"
#include "scenes/trackers/openxr_hand.h"
#include "scenes/trackers/udp_hand.h"
#include "scenes/trackers/ultraleap.h"
#include "scenes/trackers/websocket_hand.h"

namespace palpate {

namespace {

struct SourceName {
    std::string kind, host = "127.0.0.1";
    int port = -1;
};

/// "kind", "kind:PORT" or "kind:HOST:PORT"; the port stays -1 where it is missing or none.
SourceName parse_source(const std::string& source) {
    SourceName s;
    const auto first = source.find(':'), last = source.rfind(':');
    s.kind = source.substr(0, first);
    if (first == std::string::npos) return s;
    if (last != first) s.host = source.substr(first + 1, last - first - 1);
    const std::string port = source.substr(last + 1);
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), s.port);
    if (error != std::errc() || end != port.data() + port.size() || s.port < 0 || s.port > 65535) s.port = -1;
    return s;
}

}  // namespace

const std::vector<TrackerSource>& tracker_sources() {
    static const std::vector<TrackerSource> all{
        {"ultraleap", "the WebSocket of a Leap Motion service on this machine, both hands"},
        {"ultraleap:HOST:PORT", "the same elsewhere"},
        {"udp:PORT", "one JSON object per datagram, 26 joints as in OpenXR"},
        {"websocket:PORT", "the same as messages to ws://127.0.0.1:PORT/hand"},
        {"openxr", "the OpenXR runtime of this machine, both hands"},
    };
    return all;
}

std::string tracker_problem(const std::string& source) {
    const SourceName s = parse_source(source);
    const auto colons = std::count(source.begin(), source.end(), ':');
    if ((s.kind == "udp" || s.kind == "websocket") && colons == 1 && s.port >= 0) return "";
    if (s.kind == "ultraleap" && (colons == 0 || (colons == 2 && s.port > 0 && !s.host.empty()))) return "";
    if (source == "openxr") return "";
    std::string forms;
    for (const TrackerSource& t : tracker_sources())
        forms += (forms.empty() ? "\"" : ", \"") + std::string(t.form) + "\"";
    return "expected one of " + forms + ", found \"" + source + "\"";
}

std::string to_text(const HandCounts& c) {
    std::string text = std::to_string(c.frames[1]) + " frames of the right hand, " + std::to_string(c.frames[0]) +
                       " of the left, " + std::to_string(c.malformed) + " messages that were none";
    if (c.malformed) text += " (the last: " + c.last_problem + ")";
    if (c.backward) text += ", " + std::to_string(c.backward) + " out of order";
    if (c.standing) text += ", " + std::to_string(c.standing) + " whose time stood still";
    if (c.other_sender) text += ", " + std::to_string(c.other_sender) + " of another sender (" + c.refused_sender + ")";
    if (c.other_clock) text += ", " + std::to_string(c.other_clock) + " by another clock";
    if (c.lost) text += ", " + std::to_string(c.lost) + " lost on the way";
    if (c.connections > 1) text += ", connected " + std::to_string(c.connections) + " times";
    return text;
}

std::unique_ptr<HandSourceThread> open_tracker(const std::string& source, HandMailbox& mailbox, bool any_address) {
    if (const std::string wrong = tracker_problem(source); !wrong.empty()) throw InputError("tracker: " + wrong);
    const SourceName s = parse_source(source);
    if (s.kind == "udp") return receive_udp_hands(mailbox, s.port, any_address);
    if (s.kind == "websocket") return receive_websocket_hands(mailbox, s.port, any_address);
    if (s.kind == "openxr") return receive_openxr_hands(mailbox);
    return receive_ultraleap_hands(mailbox, s.host, s.port < 0 ? ultraleap_port : s.port);
}

}  // namespace palpate
