#pragma once
// Thimbles on real controllers: opened, driven in real time, brought to rest.

#include <filesystem>
#include <map>

#include "devices/device_thread.h"
#include "devices/drivers/board.h"
#include "scenes/simulation.h"

namespace palpate {

struct ArmSettings {
    bool need_watchdog = true;               ///< refuse controllers that would not let go if this program were killed
    std::filesystem::path dry_folder = ".";  ///< where maestro-dry writes its transfers
};

struct Hardware {
    std::map<std::string, std::shared_ptr<Board>> boards;  ///< by controller
    std::vector<ThimbleReport> seen;                       ///< per thimble, the newest report
    std::vector<ThimbleLoop*> loops;                       ///< per thimble
    std::unique_ptr<DeviceThread> thread;                  ///< ends first
};

/// Key of the controller that drives a thimble: "maestro 00123456", "dynamixel /dev/ttyUSB0"; empty if simulated.
std::string controller_of(const DriverSpec& driver);

/// Whether any thimble has a controller.
bool drives_hardware(const Scene& scene);

/// Opens the controllers of a scene's thimbles. Throws InputError with everything that is wrong.
std::map<std::string, std::shared_ptr<Board>> open_boards(const Scene& scene, const ArmSettings& settings);

/// From now on the simulation's thimbles are driven in real time.
void arm(Simulation& simulation, const ArmSettings& settings);
/// Brings the thimbles to their rest pose, which takes as long as their slew limits ask for, and lets go of the thread.
void disarm(Simulation& simulation);

/// The newest that a thimble's loop has told.
const ThimbleReport& newest_report(Hardware& hardware, int thimble);
/// Sleeps until the next step is due.
void wait_for_real_time(RealTimePace& pace, double dt);

/// What armed thimbles went through, in lines for a terminal.
std::string hardware_report(const Simulation& simulation);

}  // namespace palpate
