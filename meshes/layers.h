#pragma once
// Layers of tissue by depth below the skin.

#include "meshes/tet_mesh.h"

namespace palpate {

/// Share of each element's volume in each layer: [element][layer], layers from the skin inwards with the given
/// thicknesses [m], then the tissue below the last one. Depth is the distance to the nearest surface triangle that
/// has a pad node; measured at 20 points per element.
std::vector<std::vector<double>> layer_shares(const TetMesh& mesh, const std::vector<double>& thicknesses);

}  // namespace palpate
