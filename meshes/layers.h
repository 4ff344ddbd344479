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

/// What skin is beyond the tissue below it: how stiff along the skin, and how spread over depth.
struct SkinExcess {
    std::vector<double> of_element;  ///< [element] modulus along the skin over that of the tissue below [Pa], >= 0
    double variance;                 ///< of the depth of what layers have so, about its mean [m^2]
};

/// Excess of layers of the moduli [Pa] and thicknesses [m] over a modulus below them, by elements' shares.
SkinExcess skin_excess(const std::vector<std::vector<double>>& shares, const std::vector<double>& thicknesses,
                       const std::vector<double>& moduli, double below);

/// Moves membranes (modulus [Pa] per element, smeared over its volume) from where they bend too stiffly to the elements
/// that have a face in the skin. A linear tetrahedron of the skin stretches as one of its own faces or edges does,
/// which lies at the skin or an element's height below it; skin that is thinner than that is spread over both, and
/// bends as if it were as thick as an element. A share is moved, from node to node of the skin, by which the depth of
/// what stretches varies as that of the layers does: none where elements are smaller than the skin, nearly all where
/// they are larger. Their sum over volumes stays.
void lift_membranes(const TetMesh& mesh, const std::vector<Point>& normals, const SkinExcess& excess,
                    std::vector<double>& membranes);

}  // namespace palpate
