#include "devices/drivers/servo.h"

#include <algorithm>
#include <cmath>

#include "meshes/plain_numbers.h"

namespace palpate {

std::vector<std::string> ServoCalibration::validate() const {
    std::vector<std::string> wrong;
    auto text = [](double x) { return plain_to_string(x).substr(0, plain_to_string(x).find('.') + 3); };
    check(std::abs(units_per_rad), servo_bounds::units_per_rad, "a servo's units per radian, either way,", "", wrong);
    const bool inside = servo_bounds::units.holds(min) && servo_bounds::units.holds(max);
    if (!inside || !(min < max))
        wrong.push_back("a servo's range must lie between 64 and 16000 units, found " + text(min) + " to " + text(max));
    if (!(zero >= min && zero <= max))
        wrong.push_back("a servo's zero must lie in its range, found " + text(zero) + " outside " + text(min) + " to " +
                        text(max));
    check(torque_per_Nm, servo_bounds::torque_per_Nm, "a servo's torque limit per N m", " units", wrong);
    check(torque_max, servo_bounds::torque_max, "a servo's largest torque limit", " units", wrong);
    return wrong;
}

namespace {

double lowest(const ServoCalibration& servo, double steps_per_unit) { return std::ceil(servo.min * steps_per_unit); }
double highest(const ServoCalibration& servo, double steps_per_unit) { return std::floor(servo.max * steps_per_unit); }

}  // namespace

WireValue wire_value(const ServoCalibration& servo, double steps_per_unit, double angle) {
    if (!std::isfinite(angle)) return no_pulse;
    const double value = std::round((servo.zero + servo.units_per_rad * angle) * steps_per_unit);
    return WireValue(std::clamp(value, lowest(servo, steps_per_unit), highest(servo, steps_per_unit)));
}

double cut_off(const ServoCalibration& servo, double angle) {
    const double value = servo.zero + servo.units_per_rad * angle,
                 beyond = std::max(servo.min - value, value - servo.max);
    return beyond < 1 ? 0 : beyond;
}

WireValue torque_value(const ServoCalibration& servo, double torque) {
    if (!(servo.torque_per_Nm > 0) || !(servo.torque_max >= 0)) return no_torque_limit;
    const double most = std::min(std::floor(servo.torque_max), 32000.0);
    const double value = std::isfinite(torque) ? std::round(torque * servo.torque_per_Nm) : 0;
    return WireValue(std::clamp(value, 0.0, most));
}

WireLimits wire_limits(const ServoCalibration& servo, double steps_per_unit, double speed_rad_per_s) {
    return {WireValue(lowest(servo, steps_per_unit)),
            WireValue(highest(servo, steps_per_unit)),
            std::abs(servo.units_per_rad) * steps_per_unit * speed_rad_per_s,
            0,
            0,
            0};
}

namespace {

constexpr double longest_credit = 0.03;  ///< time that a pause counts for at most [s]
constexpr double standing_after = 0.05;  ///< a servo that was told nothing for this long stands [s]

double credit(double elapsed) { return std::isfinite(elapsed) ? std::clamp(elapsed, 0.0, longest_credit) : 0; }

/// The velocity that it was told, unless that is too long ago.
double lasting(const Told& told, double elapsed) {
    return elapsed + told.took <= standing_after && std::isfinite(told.velocity) ? told.velocity : 0;
}

/// Whole values that one step may move by, from a speed in its direction: one at least, once the limits have left time
/// for it.
double largest_step(double speed, const WireLimits& limits, double elapsed) {
    const double limit = std::isfinite(limits.speed) ? std::max(0.0, limits.speed) : 0, time = credit(elapsed);
    auto reached = [&](double gain) {
        return limits.acceleration > 0 ? std::min(limit, std::max(0.0, speed) + gain) : limit;
    };
    const double step = std::floor(reached(limits.acceleration * time) * time);
    const double waited = std::isfinite(elapsed) ? std::clamp(elapsed, 0.0, 1.0) : 0;
    const bool due = reached(0.5 * limits.acceleration * waited) * waited >= 1;
    return std::max(step, due ? 1.0 : 0.0);
}

}  // namespace

WireValue limit_wire(WireValue wanted, const Told& told, const WireLimits& limits, double elapsed) {
    if (limits.max == 0 || limits.min > limits.max || wanted == no_pulse) return no_pulse;
    double value = std::clamp(wanted, limits.min, limits.max);
    if (told.low != no_pulse && told.low <= told.high) {
        const double velocity = lasting(told, elapsed);
        // Within a step of wherever it may be; where no value is, as near to both ends as can be.
        const double low = told.high - largest_step(-velocity, limits, elapsed),
                     high = told.low + largest_step(velocity, limits, elapsed), middle = std::floor(0.5 * (low + high));
        value = low <= high ? std::clamp(value, low, high) : middle;
        // One that stands out of range comes back by steps, too, and goes no farther out.
        value = std::clamp<double>(value, std::min(limits.min, told.low), std::max(limits.max, told.high));
    }
    return WireValue(value);
}

Told told_after(const Told& before, WireValue value, bool arrived, const WireLimits& limits, double elapsed, double now,
                double apart) {
    if (before.low == no_pulse) return {value, value, now, 0};
    // It may have arrived, all the same.
    if (!arrived) return {std::min(before.low, value), std::max(before.high, value), now, 0};
    const double time = credit(elapsed), moved = double(value) - 0.5 * (double(before.low) + double(before.high));
    // A step is known to one value, which in next to no time is no speed: a servo goes no faster than limits let it.
    double speed = time > 0 ? (std::abs(moved) + 1) / std::max(time, apart) : 0;
    if (limits.acceleration > 0)
        speed = std::min(
            speed, std::max(0.0, std::copysign(1.0, moved) * lasting(before, elapsed)) + limits.acceleration * time);
    return {value, value, now, std::copysign(speed, moved)};
}

WireValue limit_torque_wire(WireValue wanted, WireValue sent, const WireLimits& limits, double elapsed) {
    if (wanted == no_torque_limit || !(limits.torque_rate > 0)) return wanted;
    const double from = sent == no_torque_limit ? 0 : sent;
    return WireValue(std::min(double(wanted), from + std::max(1.0, std::floor(limits.torque_rate * credit(elapsed)))));
}

double angle_of(const ServoCalibration& servo, double steps_per_unit, WireValue value) {
    return (value / steps_per_unit - servo.zero) / servo.units_per_rad;
}

}  // namespace palpate
