#pragma once
// Thimbles on real controllers: opened, driven in real time, brought to rest.

#include <filesystem>
#include <map>

#include "devices/drivers/last_resort.h"
#include "devices/loop/device_thread.h"
#include "devices/loop/rest_outcome.h"
#include "scenes/run/simulation.h"

namespace palpate {

struct ArmSettings {
    bool need_watchdog = true;  ///< refuse controllers that would not let go if this program were killed
    /// Where maestro-dry writes its transfers, and boards what they were sent before a fault.
    std::filesystem::path folder = ".";
    bool need_calibration = true;  ///< refuse servos of which nobody knows how they sit in their thimble
};

struct Hardware {
    std::map<std::string, std::shared_ptr<Board>> boards;  ///< by controller
    std::vector<ThimbleReport> seen;                       ///< per thimble, the newest report
    std::vector<ThimbleLoop*> loops;                       ///< per thimble
    std::vector<RestOutcome> rest;                         ///< per thimble, once disarmed
    std::vector<std::unique_ptr<RestOnDeath>> on_death;    ///< per controller that can be spoken to by a dying program
    std::unique_ptr<DeviceThread> thread;                  ///< ends first
};

/// Key of the controller that drives a thimble: "maestro 00123456", "dynamixel /dev/ttyUSB0"; empty if simulated.
std::string controller_of(const DriverSpec& driver);

/// Whether any thimble has a controller.
bool drives_hardware(const Scene& scene);

/// Opens the controllers of a scene's thimbles. Throws InputError with everything that is wrong.
std::map<std::string, std::shared_ptr<Board>> open_boards(const Scene& scene, const ArmSettings& settings);

/// From now on the simulation's thimbles are driven in real time. Throws InputError with everything that stands against
/// it.
void arm(Simulation& simulation, const ArmSettings& settings);
/// Brings the thimbles to their rest pose, which takes as long as their slew limits ask for, and lets go of the thread.
void disarm(Simulation& simulation);

/// Angles that a thimble's servos were told last, as far as that surely arrived, and NaN where nobody knows [rad]; of a
/// simulated one, what its loop sent.
Coordinates sent_angles(const Simulation& simulation, std::size_t thimble);

/// The newest that a thimble's loop has told.
const ThimbleReport& newest_report(Hardware& hardware, int thimble);
/// Sleeps until the next step is due.
void wait_for_real_time(RealTimePace& pace, double dt);

/// Whether two devices have the same joints, limits and lengths.
bool same_device(const DeviceModel& a, const DeviceModel& b);
/// Whether two scenes' thimbles are driven alike: by the same controllers, within the same limits.
bool same_thimbles(const Simulation& a, const Simulation& b);

/// Hands armed thimbles from one simulation to another of the same thimbles, on the same controllers: faults stay as
/// they are. False, and nothing has changed, where they are not the same, or not armed.
bool keep_armed(Simulation& from, Simulation& to);

/// What is known of the rest pose after disarm, in lines for a terminal. `all`: whether all are in it.
std::string rest_report(const Simulation& simulation, bool& all);

/// Ages of commands above this are warned of: a finger feels them as lag [s].
inline constexpr double longest_command_age = 0.030;

/// How old tracked poses were, since they had come from the tracker, as the values that follow from them had reached a
/// thimble's servos; of its slowest servo. All zero where it is simulated.
struct CommandAge {
    std::int64_t count = 0;
    double median_ms = 0, p99_ms = 0, worst_ms = 0;
};
CommandAge command_age(const Simulation& simulation, std::size_t thimble);

/// What armed thimbles went through, in lines for a terminal.
std::string hardware_report(const Simulation& simulation);

}  // namespace palpate
