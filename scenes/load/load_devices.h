#pragma once
// The thimbles of a scene file: kind, matching, driver, calibration.

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

/// What `driver` of a device may be.
struct NamedDriver {
    const char *name, *about;
};
const std::vector<NamedDriver>& drivers();

/// device = { kind, method, driver, ... } of a finger, seated on its mesh. Files are relative to `folder`.
void read_device(Section s, int finger, const TetMesh& mesh, const std::filesystem::path& folder, Scene& scene);

/// Whether the driver's servos count ticks; otherwise microseconds of pulse.
bool counts_ticks(const DriverSpec& driver);

/// A servo whose calibration, from `file`, cuts off its joint's rest angle is refused, one that cuts off others is
/// warned of.
void check_ranges(Section& s, const std::string& file, const DeviceModel& model, const DriverSpec& driver);
/// Which part of its joint's range a servo's calibration cuts off, and how much, in words; empty where none.
std::string lost_range(const DriverSpec& driver, std::size_t joint, const DeviceModel& model);

/// Refuses thimbles that share channels of a board, or name one board in two ways; warns of those without calibration.
void check_boards(const Scene& scene, Problems& problems);

/// [thimbles]: what all device loops share, and simulated servos.
void read_thimble_loop(Section s, Scene& scene);

/// A turn is 4,096 ticks. Torque limits, as its maker gives the stall torque: XL330-M288, 0.52 N m at 1,470 mA, and
/// 800 mA at most here.
inline constexpr ServoCalibration dynamixel_calibration{2048, 651.9, 1024, 3072, 2827, 800};

/// A calibration file: one [[servo]] per joint, in the order of the joints, with its channel. Throws InputError.
struct ThimbleCalibration {
    std::string serial;
    std::vector<int> channels;
    std::vector<ServoCalibration> servos;
    bool ticks = false;          ///< of bus servos; otherwise microseconds of pulse
    bool says_channels = false;  ///< they stand in the file
};
ThimbleCalibration read_calibration(const std::filesystem::path& file);
/// All that may stand in such a file.
KeyInfo calibration_keys();
void write_calibration(const std::filesystem::path& file, const ThimbleCalibration& calibration,
                       const std::string& unit);

}  // namespace palpate
