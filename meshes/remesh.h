#pragma once
// Remeshing of a closed surface.

#include <functional>

#include "meshes/triangle_tree.h"

namespace palpate {

/// Triangles with edges near `edge_length` [m] whose vertices lie near the reference surface: split,
/// collapse, flip, smooth, project (Botsch & Kobbelt 2004), then an offset that restores the volume.
Surface remesh(const TriangleTree& reference, double edge_length);

/// Wanted edge length at a place [m].
using SizeField = std::function<double(const Eigen::Vector3d&)>;
/// The same with edges as long as the field says where they lie, and vertices on the reference surface: no offset.
Surface remesh(const TriangleTree& reference, const SizeField& size);

}  // namespace palpate
