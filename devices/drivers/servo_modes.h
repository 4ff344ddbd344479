#pragma once
// Modes of operation in which bus servos keep what is promised of them: a target is a place, and a speed limit a speed.

#include <string>

namespace palpate {

/// What keeps a servo in its mode of operation from being armed, with what to change; empty where nothing does.
/// Registers as read from the servo: of a Dynamixel operating_mode and drive_mode, of a Feetech servo its mode.
std::string dynamixel_mode_problem(int operating_mode);
std::string dynamixel_drive_problem(int drive_mode);
std::string feetech_mode_problem(int mode);

}  // namespace palpate
