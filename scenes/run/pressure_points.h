#pragma once
// The field of forces on a pad, between its samples.

#include <vector>

#include "engine/contact/contact_edge.h"

namespace palpate {

/// What a pad's field is read from: its samples, faces, and the parts of them that are in contact.
struct PressedPad {
    std::vector<Vec3<double>> field;        ///< [sample] force [N]
    std::vector<Vec3<double>> place;        ///< [sample] [m]
    std::vector<std::array<int, 3>> faces;  ///< samples
    std::vector<PressedTriangle> pressed;   ///< parts of faces
};
PressedPad pressed_pad(const ContactSurface& contact);

struct PressurePoint {
    Vec3<double> place, force;  ///< [m], [N]
};

/// The forces of samples as pressure on what is in contact of the faces around them, falling linearly to their other
/// corners, at points all over it; where nothing is, as they are. They sum to the samples' forces.
std::vector<PressurePoint> pressure_points(const PressedPad& pad);

}  // namespace palpate
