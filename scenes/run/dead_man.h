#pragma once
// A switch that a person holds while thimbles may move.

#include <memory>
#include <string>

#include "scenes/run/simulation.h"

namespace palpate {

/// What a switch was like, since it was obeyed first.
struct HoldCounts {
    double watched = 0, held = 0;  ///< [s]
    std::int64_t foreign = 0;      ///< messages that say neither that it is held nor that it is let go
    bool foreign_told = false;
    double obeyed_at = -1;  ///< the last time [s]
    bool was_held = false;  ///< then
};

/// What is held: a key of the terminal, a button of a joystick (a foot switch is one), or a heartbeat.
class DeadMan {
  public:
    virtual ~DeadMan() = default;
    /// Whether it is held now. Never waits. Enter on a terminal that is listened to is remembered.
    virtual bool held() = 0;
    bool take_enter() { return std::exchange(enter_, false); }
    bool uses_terminal = false;
    std::string source;  ///< as it was asked for
    HoldCounts counts;

  protected:
    bool enter_ = false;
};

/// `source`: "key" (any key but Enter, on the terminal), "joystick:/dev/input/js0" with ":BUTTON" where it is to be
/// that one alone, or "heartbeat:PORT" (a datagram to this machine's UDP port that begins with "1", ten a second; "0"
/// lets go, and so does any other, which is counted). Throws InputError where it is none of these, or cannot be opened.
std::unique_ptr<DeadMan> make_dead_man(const std::string& source);

/// Throws InputError where somebody would hold a switch for thimbles that do not move anyway.
void refuse_to_hold_unarmed(const std::string& source, bool armed);

/// Lets thimbles follow while the switch is held; else they hold, and then go to their rest pose.
void obey_dead_man(DeadMan& dead_man, Simulation& simulation);

/// What its user should know now, once: that messages come which mean nothing. Empty: nothing.
std::string take_news(DeadMan& dead_man);

/// How long it was held, in a line for a terminal.
std::string hold_report(const DeadMan& dead_man);

}  // namespace palpate
