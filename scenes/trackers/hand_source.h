#pragma once
// Where live hands come from.

#include <memory>
#include <vector>

#include "scenes/trackers/hand_mailbox.h"

namespace palpate {

/// Something that fills a mailbox until it is destroyed.
class HandSourceThread {
  public:
    virtual ~HandSourceThread() = default;
    /// What is expected from where, for a person: "UDP port 9000".
    virtual std::string about() const = 0;
    /// Port it listens on; 0 where it connects.
    virtual int port() const { return 0; }
};

/// The sources there are.
struct TrackerSource {
    const char* form;   ///< of its name: "udp:PORT"
    const char* about;  ///< for a person
};
const std::vector<TrackerSource>& tracker_sources();

/// What is wrong with the name of a source; empty if nothing is.
std::string tracker_problem(const std::string& source);

/// Opens a source by its name. Throws InputError with what is wrong.
std::unique_ptr<HandSourceThread> open_tracker(const std::string& source, HandMailbox& mailbox, bool any_address);

/// A source and the hands that have come from it.
struct LiveHands {
    HandMailbox mailbox;
    std::unique_ptr<HandSourceThread> source;  ///< ends first
    explicit LiveHands(const std::string& name, bool any_address = false, HandMailbox::Listener listener = {})
        : mailbox(std::move(listener)), source(open_tracker(name, mailbox, any_address)) {}
};

/// What has arrived, in a line.
std::string to_text(const HandCounts& counts);

}  // namespace palpate
