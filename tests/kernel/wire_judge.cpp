// Says "safe", or what is wrong: wire-judge WIRE_LOG PROGRAM_OUTPUT.

#include <sstream>

#include "devices/device.h"
#include "devices/drivers/servo.h"
#include "tests/emulator/wire_log.h"

int main(int argc, char** argv) {
    using namespace palpate;
    using namespace palpate::testing;
    if (argc < 3) return 2;
    const auto events = read_wire_log(argv[1]);
    std::stringstream text;
    text << std::ifstream(argv[2]).rdbuf();
    const std::string out = text.str();
    std::string wrong = unsafe(events) + told_after_a_latch(events, 0.4, false);
    if (events.size() < 20) wrong += "hardly anything was told; ";
    const bool unknown = out.find("is not known to be in its rest pose") != std::string::npos;
    if (out.find(unknown ? "EXIT 1" : "EXIT 0") == std::string::npos) wrong += "the program did not end well; ";
    bool lost = false;
    for (const WireEvent& e : events) lost |= e.channel == unplugged || e.channel == watchdog_bit;
    const bool claims = out.find("thimbles are in their rest pose") != std::string::npos;
    if (claims && lost) wrong += "says that thimbles are at rest, on a board that was lost; ";
    if (!claims && !unknown) wrong += "nothing is said of the rest pose; ";
    const DeviceModel m = find_kind("chinello-3rrs")->defaults();
    const Coordinates rest = m.kind->joints(m, m.rest).q;
    for (const auto& [channel, value] : newest_targets(events))
        if (claims && value != wire_value({}, 4, rest[channel % 3])) wrong += "a servo is not at rest; ";
    std::printf("%s (%zu lines)\n", wrong.empty() ? "safe" : wrong.c_str(), events.size());
    return wrong.empty() ? 0 : 1;
}
