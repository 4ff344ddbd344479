#pragma once
// A simulation's parts as triangles, coloured.

#include "scenes/picture/hand.h"
#include "scenes/picture/raster.h"

namespace palpate {

/// Pressure on each node of a finger's mesh [Pa].
std::vector<double> node_pressures(const World& world, EntityId finger);
/// Where a finger's contact forces act on average, and their sum; false where nothing presses.
bool centre_of_pressure(const World& world, EntityId finger, Eigen::Vector3d& place, Eigen::Vector3d& force);

/// Skin drawn smoothly between the nodes of its mesh (Phong tessellation, as viewer/skin.js), coloured by pressure up
/// to `most` [Pa]; in the bone's frame where asked for.
Triangles finger_triangles(const World& world, EntityId finger, double most, bool in_bone_frame = false);
/// An object where it is, with dents where skin presses into one that gives way; one of tissue as it is deformed,
/// coloured by pressure up to `most` [Pa]. A plane has none: see floor().
Triangles object_triangles(const World& world, const VirtualObject& object, Colour colour, double most = 1e4);
/// Edges of an object beyond an angle, pairs of points.
std::vector<Eigen::Vector3d> sharp_edges(const Triangles& t, double angle_deg);
Triangles hand_triangles(const HandParts& parts, const HandBones& bones, Colour colour);
/// A thimble's platform, frames, cranks and links, world frame.
Triangles thimble_triangles(const World& world, const Matching& matching);
/// An arrow of a force that ends at `tip`.
Triangles arrow_triangles(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius, Colour colour);

}  // namespace palpate
