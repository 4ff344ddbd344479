#pragma once
// A servo per joint: pulse quantisation, frame delay and slew rate, without hardware. It reaches whatever its joint may
// do: what a real servo's range cuts off is the calibration's, and warned of where that is loaded.

#include <array>
#include <memory>

#include "devices/drivers/driver.h"
#include "devices/drivers/servo.h"
#include "devices/range.h"

namespace palpate {

struct ServoModel {
    double pulse_step_us = 0.25;  ///< resolution of the pulse
    double us_per_rad = 636.62;   ///< 1000 us for 90 degrees
    double delay_s = 0.020;       ///< the pulse that is read is one frame old
    double slew_rad_per_s = 8.7;  ///< 60 degrees in 0.12 s
    std::vector<std::string> validate() const;
    bool operator==(const ServoModel&) const = default;
};

/// Bounds of these; validate() and readers of files hold to them alone.
namespace servo_model_bounds {
inline constexpr Range pulse_step_us{0.01, 50}, delay_s{0, 0.999}, slew_rad_per_s{0.11, 99};
}

std::unique_ptr<Driver> make_simulated_driver(const ServoModel& servo, const Coordinates& start);

}  // namespace palpate
