#pragma once
// A hobby servo per joint: pulse quantisation, frame delay and slew rate, without hardware.

#include <array>
#include <memory>

#include "devices/drivers/driver.h"
#include "devices/drivers/servo.h"
#include "devices/range.h"

namespace palpate {

struct ServoModel {
    double pulse_step_us = 0.25;  ///< resolution of the pulse
    ServoCalibration calibration;
    double delay_s = 0.020;       ///< the pulse that is read is one frame old
    double slew_rad_per_s = 8.7;  ///< 60 degrees in 0.12 s
    std::vector<std::string> validate() const;
};

/// Bounds of these; validate() and readers of files hold to them alone.
namespace servo_model_bounds {
inline constexpr Range pulse_step_us{0.01, 50}, delay_s{0, 0.999}, slew_rad_per_s{0.11, 99};
}

std::unique_ptr<Driver> make_simulated_driver(const ServoModel& servo, const Coordinates& start);

}  // namespace palpate
