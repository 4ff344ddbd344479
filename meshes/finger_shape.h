#pragma once
// A parametric fingertip.

#include "meshes/surface.h"

namespace palpate {

/// Dimensions of a distal segment. Shape: meshes/README.md.
struct FingerShape {
    double length = 0.025;      ///< cut to tip [m]
    double width = 0.0175;      ///< [m]
    double thickness = 0.0145;  ///< pad to nail side, at the cut [m]
    double pad_bulge = 0.14;    ///< share by which the pad swells at its middle
    double nail_drop = 0.26;    ///< share of the dorsal half height lost towards the tip, over the nail
    double crease = 0;          ///< share of the pad side's height lost towards the cut, as at the joint's crease
    std::vector<std::string> validate() const;
};

/// Bounds of these, by their names, both included; validate() and readers of files hold to them alone.
namespace shape_bounds {
struct Bounds {
    double low, high;
};
inline constexpr Bounds length{0.010, 0.060}, width{0.006, 0.040}, thickness{0.006, 0.035};  // [m]
inline constexpr Bounds pad_bulge{0, 0.5}, nail_drop{0, 0.5}, crease{0, 0.4};
}  // namespace shape_bounds

/// Finger of a median hand: "thumb", "index", "middle", "ring" or "little". Throws InputError otherwise.
FingerShape finger_shape(const std::string& finger);
std::vector<std::string> finger_shape_names();

/// Of built-in fingers with conforming meshes. Without one the cut end is touched, where a finger goes on in truth.
inline constexpr double usual_crease = 0.22;

/// Moves nodes inside a finger of this shape as its pad side comes to have the bulge and the crease of another.
void change_pad(std::vector<Point>& nodes, const FingerShape& shape, const FingerShape& wanted);

/// Dense closed surface in the finger frame (origin at the centre of the segment).
Surface finger_surface(const FingerShape& shape);

}  // namespace palpate
