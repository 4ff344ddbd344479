#pragma once
// Isotropic remeshing of a closed surface.

#include "meshes/triangle_tree.h"

namespace palpate {

/// Triangles with edges near `edge_length` [m] whose vertices lie near the reference surface: split,
/// collapse, flip, smooth, project (Botsch & Kobbelt 2004), then an offset that restores the volume.
Surface remesh(const TriangleTree& reference, double edge_length);

}  // namespace palpate
