#include "devices/drivers/servo.h"

#include <algorithm>
#include <cmath>

namespace palpate {

std::vector<std::string> ServoCalibration::validate() const {
    std::vector<std::string> wrong;
    auto text = [](double x) { return std::to_string(x).substr(0, std::to_string(x).find('.') + 3); };
    if (!(std::abs(units_per_rad) >= 50 && std::abs(units_per_rad) <= 5000))
        wrong.push_back("a servo moves by 50 to 5000 units per radian, found " + text(units_per_rad));
    if (!(min >= 64 && max <= 16000 && min < max))
        wrong.push_back("a servo's range must lie between 64 and 16000 units, found " + text(min) + " to " + text(max));
    if (!(zero >= min && zero <= max))
        wrong.push_back("a servo's zero must lie in its range, found " + text(zero) + " outside " + text(min) + " to " +
                        text(max));
    if (!(torque_per_Nm >= 0 && torque_per_Nm <= 1e5 && torque_max >= 0 && torque_max <= 32000))
        wrong.push_back("a servo's torque limit takes 0 to 100000 units per N m, and 0 to 32000 units at most, found " +
                        text(torque_per_Nm) + " and " + text(torque_max));
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

WireValue torque_value(const ServoCalibration& servo, double torque) {
    if (!(servo.torque_per_Nm > 0) || !(servo.torque_max >= 0)) return no_torque_limit;
    const double most = std::min(std::floor(servo.torque_max), 32000.0);
    const double value = std::isfinite(torque) ? std::round(torque * servo.torque_per_Nm) : 0;
    return WireValue(std::clamp(value, 0.0, most));
}

WireLimits wire_limits(const ServoCalibration& servo, double steps_per_unit, double speed_rad_per_s) {
    return {WireValue(lowest(servo, steps_per_unit)), WireValue(highest(servo, steps_per_unit)),
            std::abs(servo.units_per_rad) * steps_per_unit * speed_rad_per_s};
}

WireValue limit_wire(WireValue wanted, const Told& told, const WireLimits& limits, double elapsed) {
    if (limits.max == 0 || limits.min > limits.max || wanted == no_pulse) return no_pulse;
    double value = std::clamp(double(wanted), double(limits.min), double(limits.max));
    if (told.low >= limits.min && told.high <= limits.max && told.low <= told.high) {
        const double time = std::isfinite(elapsed) ? std::clamp(elapsed, 0.0, 0.1) : 0;
        const double step = std::isfinite(limits.speed) ? std::floor(std::max(0.0, limits.speed) * time) : 0;
        // Within a step of wherever it may be; where no value is, as near to both ends as can be.
        const double low = told.high - step, high = told.low + step, middle = std::floor(0.5 * (low + high));
        value = low <= high ? std::clamp(value, low, high) : middle;
    }
    return WireValue(value);
}

double angle_of(const ServoCalibration& servo, double steps_per_unit, WireValue value) {
    return (value / steps_per_unit - servo.zero) / servo.units_per_rad;
}

}  // namespace palpate
