#pragma once
// From a joint angle to what a servo controller understands, and back.

#include <cstdint>
#include <string>
#include <vector>

#include "devices/range.h"

namespace palpate {

/// How one servo sits in its thimble. Units are the controller's: microseconds of pulse, or ticks of a bus servo.
struct ServoCalibration {
    double zero = 1500;             ///< at joint angle 0 [units]
    double units_per_rad = 636.62;  ///< negative where the servo turns the other way; 1000 us for 90 degrees
    double min = 992, max = 2000;   ///< what may ever be sent [units]
    double torque_per_Nm = 0;       ///< torque limit of 1 N m [the servo's units]; 0: it has none
    double torque_max = 0;          ///< what may ever be sent as torque limit [the servo's units]
    std::vector<std::string> validate() const;
    bool operator==(const ServoCalibration&) const = default;
};

/// Bounds of these in the controller's units; validate() and readers of files hold to them alone.
namespace servo_bounds {
inline constexpr Range units{64, 16000};         ///< of zero, min and max
inline constexpr Range units_per_rad{50, 5000};  ///< in either direction
inline constexpr Range torque_per_Nm{0, 1e5}, torque_max{0, 32000};
}  // namespace servo_bounds

/// What a value on the wire counts: quarter microseconds, or ticks.
using WireValue = std::uint16_t;
inline constexpr WireValue no_pulse = 0;  ///< "no target": no controller here drives a servo with it

/// The value for an angle [rad], inside the calibration's range; no_pulse for an angle that is not finite.
WireValue wire_value(const ServoCalibration& servo, double steps_per_unit, double angle);
/// How far out of the calibration's range an angle lies [units]: what wire_value() cuts off; 0: nothing, but for less
/// than one.
double cut_off(const ServoCalibration& servo, double angle);
/// Angle that a value on the wire means [rad].
double angle_of(const ServoCalibration& servo, double steps_per_unit, WireValue value);

inline constexpr WireValue no_torque_limit = 0xFFFF;  ///< nothing is to be sent
/// The last function before the wire for a torque limit [N m]: 0 to torque_max whatever comes in, 0 for what is not
/// finite; no_torque_limit where the servo has none.
WireValue torque_value(const ServoCalibration& servo, double torque);

/// What a channel may ever be sent.
struct WireLimits {
    WireValue min = 0, max = 0;  ///< max = 0: nothing at all
    double speed = 0;            ///< [wire values per second]
    double acceleration = 0;     ///< [wire values per second^2]; 0: none
    double following = 0;        ///< farthest that a servo may be from where it was told to be [wire values]; 0: any
    double torque_rate = 0;      ///< of torque limits that rise [values per second]; 0: any
};

WireLimits wire_limits(const ServoCalibration& servo, double steps_per_unit, double speed_rad_per_s);

/// What a servo was told last: one value, or, where a transfer's fate is unknown, anything between two. Nothing is
/// known of it where low is no_pulse.
struct Told {
    WireValue low = no_pulse, high = no_pulse;
    double at = 0;        ///< when [s]
    double velocity = 0;  ///< with which it was told to move then [wire values per second]
    double took = 0;      ///< how long telling it took, so that it may have stood since before `at` [s]
    double sent = 0;      ///< no earlier than this did it arrive [s]
};

/// The last function before the wire: towards `wanted` from what the servo was told `elapsed` seconds ago, whatever of
/// it arrived. Inside the range and the speed limit whatever comes in, and where a servo stands out of range, on its
/// way back, no farther out than it stands, inside the speed limit; speed rises and turns round by the acceleration
/// limit (stopping is always allowed); a pause of more than 0.03 s earns no larger step. Where nothing is known, the
/// first value is sent as it is. no_pulse: nothing is to be sent.
WireValue limit_wire(WireValue wanted, const Told& told, const WireLimits& limits, double elapsed);

/// What a servo has been told once `value` was sent `elapsed` seconds after `before`; `arrived` says whether it surely
/// was. `apart`: so long may lie between both arrivals, where a transfer was held up; it was as slow as that.
Told told_after(const Told& before, WireValue value, bool arrived, const WireLimits& limits, double elapsed, double now,
                double apart = 0);

/// The last function before the wire for a torque limit on its way to `wanted`: it rises slowly, and falls at once.
WireValue limit_torque_wire(WireValue wanted, WireValue sent, const WireLimits& limits, double elapsed);

}  // namespace palpate
