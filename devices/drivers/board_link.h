#pragma once
// What speaks to one kind of servo controller. To add one, write a class like maestro.h's or serial_bus.h's, and name
// it in scenes/run/hardware.cpp.

#include <span>
#include <string>

#include "devices/drivers/fault.h"
#include "devices/drivers/servo.h"

namespace palpate {

inline constexpr int max_channels = 32;

/// While servos make their first move after open(), their controller's own speed limit is this share of the usual one.
inline constexpr double first_move_share = 1.0 / 6;

/// After so long without a word to the controller it is asked how it is before it is told anything: no watchdog that is
/// accepted bites earlier [s].
inline constexpr double ask_first_after = 0.09;

struct ChannelTarget {
    int channel;
    WireValue value;
};

/// When a target was on its way [s of device_clock].
struct Transfer {
    double sent = 0;     ///< no earlier than this did it arrive
    double arrived = 0;  ///< no later than this; 0: it did not
};

/// Called by the board's thread alone, but for write_in_signal. No call may wait longer than 300 ms, but for open().
/// Between open() and activate(), and after deactivate(), nothing may move.
class BoardLink {
  public:
    virtual ~BoardLink() = default;
    /// Finds the controller, locks it against other programs, and reads back every setting that safety rests on.
    /// Returns what is wrong, or nothing. `positions` [max_channels] become where its servos are, or what they were
    /// told last; no_pulse where that is unknown. Leaves the servos' own speed limit at first_move_share.
    virtual std::string open(std::span<WireValue> positions) = 0;
    virtual void close() = 0;
    /// From now on servos follow targets, from where they are: torque on, where that can be switched.
    virtual LinkProblem activate() { return {}; }
    /// Lets go of the servos, where they can let go: the last word as a fault latches. Problems change nothing.
    virtual void deactivate() {}
    /// Sends targets, and says of each when. Where it is held up for longer than ask_first_after between two of them,
    /// as in a stopped process, the rest stays unsent, which is a problem.
    virtual LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) = 0;
    /// What servos hold, after transfers to them of which nobody knows whether they arrived: their newest target
    /// [max_channels], no_pulse for one that was told nothing. Only where `recalls`.
    virtual LinkProblem recall(std::span<const int> /*channels*/, std::span<WireValue> /*held*/) { return {}; }
    /// Sends torque limits, where the servos have them.
    virtual LinkProblem write_torques(std::span<const ChannelTarget> /*limits*/) { return {}; }
    /// Keeps the controller's watchdog from biting, and asks how it is, and whether the watchdog has bitten.
    virtual LinkProblem feed() = 0;
    /// Positions as measured, where servos report them; leaves alone those of servos that did not answer.
    virtual LinkProblem read(std::span<const int> /*channels*/, std::span<WireValue> /*positions*/) { return {}; }
    /// The servos' own speed limit, as a share of the usual one.
    virtual LinkProblem limit_speed(double /*share*/) { return {}; }
    /// Sends targets from a signal handler, whatever the other threads are at: no allocation, no locks. False where
    /// that cannot be done.
    virtual bool write_in_signal(std::span<const ChannelTarget> /*targets*/) noexcept { return false; }
    double steps_per_unit = 4;  ///< wire values per unit of the calibration
    bool measures = false;      ///< read() returns measured positions
    bool recalls = false;       ///< recall() returns what was told
};

}  // namespace palpate
