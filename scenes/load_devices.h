#pragma once
// The thimbles of a scene file: kind, matching, driver, calibration.

#include "scenes/scene.h"
#include "scenes/section.h"

namespace palpate {

/// device = { kind, method, driver, ... } of a finger. Files are relative to `folder`.
void read_device(Section s, int finger, const std::filesystem::path& folder, Scene& scene);

/// [thimbles]: what all device loops share, and simulated servos.
void read_thimble_loop(Section s, Scene& scene);

/// A calibration file: one [[servo]] per joint, in the order of the joints, with its channel. Throws InputError.
struct ThimbleCalibration {
    std::string serial;
    std::vector<int> channels;
    std::vector<ServoCalibration> servos;
};
ThimbleCalibration read_calibration(const std::filesystem::path& file);
void write_calibration(const std::filesystem::path& file, const ThimbleCalibration& calibration,
                       const std::string& unit);

}  // namespace palpate
