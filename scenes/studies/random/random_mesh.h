#pragma once
// Meshes that random scenes hold and pile up: text of OBJ files, in mm.

#include <array>
#include <string>

namespace palpate {

/// A box about the origin, each face cut into `cuts` times `cuts` squares of two triangles.
std::string box_mesh(const std::array<double, 3>& size, int cuts);

/// An upright prism about the origin, whose ends are regular polygons of so many sides.
std::string prism_mesh(int sides, double radius, double height);

}  // namespace palpate
