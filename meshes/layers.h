#pragma once
// Layers of tissue by depth below the skin.

#include "meshes/tet_mesh.h"

namespace palpate {

struct LayerShares {
    std::vector<std::vector<double>> shares;  ///< [element][layer], then of the tissue below the last layer
    std::vector<Point> normals;               ///< [element] of the skin nearest to it, outwards
};

/// Share of each element's volume in each layer, from the skin inwards with the given thicknesses [m]. Depth is the
/// distance to the nearest surface triangle that has a pad node; measured at 20 points per element.
LayerShares layer_shares(const TetMesh& mesh, const std::vector<double>& thicknesses);

}  // namespace palpate
