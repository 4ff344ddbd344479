#pragma once
// Which way a scanned fingertip lies: where its tip points, and where its nail is.

#include "meshes/surface.h"

namespace palpate {

/// Directions in a file's axes; of any length, and not parallel.
struct FingerOrientation {
    Point tip{1, 0, 0}, dorsal{0, 0, 1};
};

struct OrientationGuess {
    FingerOrientation orientation;  ///< unit vectors, at a right angle
    /// 0: might as well lie otherwise; 1: no part of the surface speaks against it. The smallest of the three
    /// decisions': which axis is the long one, which of its ends is the tip, which way the nail faces.
    double confidence = 0;
    std::string doubt;  ///< the decision that is least sure
};

/// Below this the guess is not used.
inline constexpr double least_orientation_confidence = 0.5;

/// The tip is the end of the longest principal axis that is round rather than cut; the nail is where the whole surface
/// votes for: towards it the tip rises, the surface is flatter, closes later, and has the shorter tail of heights.
OrientationGuess guess_orientation(const Surface& surface);

/// The surface in the finger frame (x to the tip, z to the nail, centred on its bounds). Throws InputError where the
/// two directions are zero or parallel.
Surface turn_to_finger_frame(const Surface& surface, const FingerOrientation& orientation);

/// What was guessed, in words.
std::string describe(const OrientationGuess& guess);

/// The surface from the side and from above, with the axes of a guess or a given orientation in colours, as SVG: red to
/// the tip, green across, blue to the nail; what faces the pad's way is orange.
std::string orientation_picture(const Surface& surface, const FingerOrientation& orientation, const std::string& title);

}  // namespace palpate
