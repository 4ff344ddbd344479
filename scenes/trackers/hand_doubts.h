#pragma once
// What is likely a mistake of whoever sends hands: a clock that stands or counts otherwise, two senders, rotations.

#include <string>
#include <vector>

#include "scenes/trackers/hand_mailbox.h"

namespace palpate {

struct HandDoubt {
    const char* key;   ///< one per kind: what was said once need not be said again
    std::string text;  ///< for a person, with numbers so far
};

/// Of all that has come so far; nothing where all is well.
std::vector<HandDoubt> hand_doubts(const HandMailbox& mailbox);

/// What is likely wrong with a recording's times; empty where nothing is.
std::string recorded_time_problem(const HandRecording& recording);

/// Tells each kind of doubt once, as it comes up.
class DoubtTeller {
  public:
    /// Those that were not told yet; looks once a second of the device clock.
    std::vector<std::string> news(const HandMailbox& mailbox);

  private:
    double next_ = 0;
    std::vector<std::string> told_;
};

}  // namespace palpate
