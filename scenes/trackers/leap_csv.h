#pragma once
// Recordings of Leap Motion as CSV: one row per hand and frame, lengths in mm, times in us.

#include "scenes/trackers/hand_recording.h"

namespace palpate {

/// Columns t_us, hand ("left" or "right"), and of thumb to pinky FINGER_dip_x, _y, _z and FINGER_tip_x, ...; others may
/// be there. The bones' bases are FINGER_distalbasis_00 ... _22 (rows are axes); where a finger has none, they follow
/// from its joints FINGER_mcp, _pip (it bends in one plane) and palmN and dir, or the knuckles and palm:
/// HandRecording's note says so. Throws InputError with file and line.
HandRecording read_leap_csv(const std::filesystem::path& path, const std::string& hand);

}  // namespace palpate
