#pragma once
// Where contact ends between the samples of a pad. Touching is decided at samples, millimetres apart; what presses is a
// field over the faces between them, and its edge lies where pressure ends: between a sample that bears a force and one
// that has a gap. Area, outlines and comparisons of pressure fields all read the same parts of faces.

#include "engine/world.h"

namespace palpate {

/// How much of an edge between two samples is in contact, from the one that bears `pressure` [Pa] towards the one that
/// has a `gap` [m]; `length` [m], `modulus` E / (1 - nu^2) [Pa]. At the edge of a smooth contact pressure goes as
/// A sqrt(s) at s within, and the gap as 4 A / (3 E*) t^(3/2) at t beyond (Johnson, Contact Mechanics, 1985, chapters 4
/// and 5): both ends of the mesh's edge together say where that is. 0 where the first bears nothing, 1 where the second
/// has no gap.
double reach_along_edge(double pressure, double gap, double length, double modulus);

/// A part of a pad's face that is in contact: corners as shares of the face's three samples.
struct PressedTriangle {
    int face;
    std::array<std::array<double, 3>, 3> corner;
};

/// The parts of a face that are in contact, two at most.
struct PressedFace {
    int count = 0;
    std::array<PressedTriangle, 2> part;
    std::array<std::array<double, 3>, 2> edge;  ///< where contact ends within the face; of use where has_edge
    bool has_edge = false;
};
PressedFace pressed_part(const ContactSurface& surface, int face);

/// A point of a face, by shares of its samples, in the finger's frame [m].
Vec3<double> face_point(const ContactSurface& surface, int face, const std::array<double, 3>& share);

/// Area of the pad that is in contact, as it is deformed [m^2]; of a pad without faces that of its touching samples.
double area_in_contact(const ContactSurface& surface);

/// Where contact ends: pairs of points, the finger's frame [m].
std::vector<Vec3<double>> contact_outline(const ContactSurface& surface);

/// Marks samples that do not touch, and have neighbours that do, with a gap below 0: those whose gap counts.
void mark_wanted_gaps(ContactSurface& surface);

}  // namespace palpate
