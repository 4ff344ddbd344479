#pragma once
// The outer loop of a thimble: 50 times a second it takes the newest configuration from its mailbox and
// sends joint angles that are finite, in range and slew-limited, whatever came in.

#include <atomic>
#include <cstdint>
#include <memory>

#include "devices/drivers/driver.h"
#include "devices/loop/command.h"
#include "devices/loop/histogram.h"
#include "devices/loop/pose_stamps.h"
#include "devices/range.h"

namespace palpate {

struct SlewLimits {
    double velocity = 6.0;        ///< [rad/s]; a hobby servo does 60 degrees in 0.1 to 0.2 s
    double acceleration = 200.0;  ///< [rad/s^2]
    std::vector<std::string> validate() const;
    bool operator==(const SlewLimits&) const = default;
};

/// Bounds of these; validate() and readers of files hold to them alone.
namespace slew_bounds {
inline constexpr Range velocity{0.011, 50}, acceleration{0.11, 10000};
}

/// The last function before the wire. From the angles and speeds sent last, one period of dt towards
/// `target`: always finite, inside [min, max] or on the way back there, inside the limits, and able to stop in time.
/// Returns the number of joints whose target had to be altered for range or was not finite.
int limit_command(const Coordinates& target, const Coordinates& min, const Coordinates& max, const SlewLimits& limits,
                  double dt, Coordinates& q, Coordinates& velocity);

struct ThimbleLoopSettings {
    double period = 0.020;         ///< [s]
    double command_wait = 0.0004;  ///< from the end of a step to the tick that takes its command [s]
    double hold_after = 0.060;     ///< no valid solve for this long: hold [s]
    double rest_after = 0.120;     ///< then slew to the rest configuration [s]
    double rest_within = 0.500;    ///< time allowed to reach it, or what its limits ask for [s]
    double first_velocity = 1.0;   ///< of the first move after (re-)arming [rad/s]
    double touch_velocity = 0;     ///< of the approach to a first contact [rad/s]; 0: as always
    SlewLimits limits;
    bool operator==(const ThimbleLoopSettings&) const = default;
};

enum class ThimbleMode { following, holding, resting, fault };
const char* name(ThimbleMode mode);

struct ThimbleStatus {
    ThimbleMode mode = ThimbleMode::resting;
    std::int64_t ticks = 0, misses = 0, altered = 0, faults = 0, stale = 0;
    double worst_lateness = 0;  ///< [s]
    double age = 0;             ///< since the newest valid command came [s]
};

/// What a loop tells those that watch it, in every tick.
struct ThimbleReport {
    Coordinates sent, actual;  ///< [rad]
    ThimbleStatus status;
    Coordinates torque = {};  ///< limits sent [N m]; empty in position mode
    double command_age = -1;  ///< of the tracked pose when the newest angles had reached the servos [s]; unknown: < 0
};

/// State of one thimble's loop. Plain data; `tick` advances it.
struct ThimbleLoop {
    DeviceModel model;
    ThimbleLoopSettings settings;
    std::unique_ptr<Driver> driver;
    ThimbleMailbox mailbox;
    Mailbox<ThimbleReport> reports;  ///< for one reader
    PoseStamps pose_stamps;          ///< filled by the simulation, in real time
    ThimbleCommand newest, incoming;
    bool has_come = false;                      ///< incoming is there, and is not taken yet
    double awaited = 0, commands_every = 0;     ///< how long this tick waits for it; as poses go [s]
    double step_takes = 0.002;                  ///< nearly all steps take no longer, from their poses on [s]
    double pose_at = 0;                         ///< when the tracked pose behind it had come; 0: unknown [s]
    double newest_at = 0;                       ///< when it came [s]
    Coordinates q, velocity;                    ///< sent last [rad], [rad/s]
    Coordinates rest_q;                         ///< joint angles of the rest configuration
    Coordinates torque;                         ///< limits sent last [N m]; empty in position mode
    Coordinates largest_torque, moving_torque;  ///< in force mode: ever, and where nothing is touched [N m]
    double next_tick = 0;                       ///< [s]
    double resting_since = -1;
    double easing_since = -1;  ///< the first move after (re-)arming goes on since [s]; negative: it is over
    double rearm_until = -1;   ///< until then a latched fault is cleared, if its cause is gone [s]
    bool in_contact = false, touching_down = false, was_let_go = false;
    std::atomic<bool> parked = false;       ///< shutting down: rest pose whatever comes in
    std::atomic<bool> let_go = false;       ///< the dead-man's switch is not held: commands count as none
    std::atomic<bool> rearm_asked = false;  ///< the next ticks clear a latched fault, if its cause is gone
    ThimbleStatus status;
    LatencyHistogram latency;  ///< from tracked pose to driver, where commands carry it
};

/// Starts at rest. Throws std::invalid_argument with sentences where the device or the settings are wrong.
void initialise(ThimbleLoop& loop, const DeviceModel& model, const ThimbleLoopSettings& settings,
                std::unique_ptr<Driver> driver);

/// From the next tick on, joints push with limited torque. False where the driver's servos cannot.
bool use_force_mode(ThimbleLoop& loop);

/// Runs the loop up to time `now` [s]: at most one tick, and missed ones are counted, not caught up.
/// Returns true if it ticked.
bool tick(ThimbleLoop& loop, double now);

/// From now on the rest pose is commanded.
void park(ThimbleLoop& loop);

/// Longest time that the way to the rest pose takes, from anywhere in range and from where the joints are, within the
/// limits of a first move [s]. Called by the thread that ticks.
double time_to_rest(const ThimbleLoop& loop);

/// Starts from the driver's actual angles, at rest, slowly, and clears a latched fault if its cause is gone: the only
/// way out of `fault`. Called by the thread that ticks; others set rearm_asked.
bool rearm(ThimbleLoop& loop, double now);

/// Whether the rest pose was reached.
bool at_rest(const ThimbleLoop& loop);

}  // namespace palpate
