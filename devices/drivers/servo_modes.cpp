#include "devices/drivers/servo_modes.h"

#include "devices/drivers/serial_protocol.h"

namespace palpate {

namespace {

/// Bits of a Dynamixel's drive mode. That it turns the other way (bit 0) a calibration holds.
constexpr int time_based = 1 << 2, torque_by_goal = 1 << 3;

const char* dynamixel_mode_name(int mode) {
    switch (mode) {
        case 0:
            return "current";
        case 1:
            return "velocity: it turns without end";
        case 4:
            return "extended position: it may turn more than once round";
        case 5:
            return "current-based position";
        case 16:
            return "PWM: it turns without end";
        default:
            return "unknown";
    }
}

const char* feetech_mode_name(int mode) {
    switch (mode) {
        case 1:
            return "wheel: it turns without end";
        case 2:
            return "PWM: it turns without end";
        case 3:
            return "steps: a target is a way, not a place";
        default:
            return "unknown";
    }
}

}  // namespace

std::string dynamixel_mode_problem(int mode) {
    if (mode == int(dynamixel::plain_position)) return "";
    return "operating mode " + std::to_string(mode) + " (" + dynamixel_mode_name(mode) +
           "); expected 3 (position): set register 11 to 3, with its torque off (Dynamixel Wizard does)";
}

std::string dynamixel_drive_problem(int mode) {
    const std::string found = "drive mode " + std::to_string(mode);
    const auto cleared = [&](int bit) {
        return ": set register 10 to " + std::to_string(mode & ~bit) + ", with its torque off (Dynamixel Wizard does)";
    };
    if (mode & time_based)
        return found + " (bit 2: profiles are times, and a speed limit would be milliseconds); expected bit 2 to be 0" +
               cleared(time_based);
    if (mode & torque_by_goal)
        return found + " (bit 3: whatever it is told switches its torque on); expected bit 3 to be 0" +
               cleared(torque_by_goal);
    return "";
}

std::string feetech_mode_problem(int mode) {
    if (mode == feetech::plain_position) return "";
    return "mode " + std::to_string(mode) + " (" + feetech_mode_name(mode) +
           "); expected 0 (position): set register 33 to 0, with its lock (register 55) 0 meanwhile (Feetech's FD "
           "does)";
}

}  // namespace palpate
