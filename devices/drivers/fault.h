#pragma once
// What can go wrong between the program and a servo, by kind.

#include <string>

namespace palpate {

enum class FaultKind {
    none,
    other,
    unplugged,    ///< the controller, or its port, is gone
    silent,       ///< no answer in time
    refused,      ///< an answer that says no
    bad_reply,    ///< an answer of another length, or with a wrong checksum
    wrong_servo,  ///< a servo answers that was not asked, or twice
    reported,     ///< the controller says that something is wrong with it
    watchdog,     ///< its watchdog has bitten: servos went home, or do not listen any more
    overheated,
    overloaded,
    electrical,  ///< supply voltage, shock, encoder
    blocked,     ///< a servo stands still short of where it was told to be
    off_course,  ///< a servo is not where it was told to be, and moves
};
/// In words, for people.
const char* name(FaultKind kind);

/// What went wrong; nothing where `text` is empty. `lost` latches at once; other problems are tried again, and latch
/// once there was no good answer for a tenth of a second (answer_watch.h).
struct LinkProblem {
    std::string text;
    bool lost = false;
    FaultKind kind = FaultKind::other;
    explicit operator bool() const { return !text.empty(); }
};

}  // namespace palpate
