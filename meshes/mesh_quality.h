#pragma once
// How good tetrahedra are, what is wrong with them, and their boundary.

#include "meshes/tet_mesh.h"

namespace palpate {

/// Quality of a mesh; dihedral angles in degrees, radius ratio 1 for the regular tetrahedron.
struct MeshQuality {
    int fixed = 0;                                           ///< elements with no node out of the bone
    double volume = 0;                                       ///< [m^3]
    double worst_dihedral_deg = 0, median_dihedral_deg = 0;  ///< of each element's smallest angle
    double worst_radius_ratio = 0, median_radius_ratio = 0;
    double worst_volume_ratio = 0;  ///< smallest element volume over the mean
};
/// `fixed_too`: shapes of elements that nothing deforms count, too.
MeshQuality measure_quality(const TetMesh& mesh, bool fixed_too = true);

/// Boundary triangles of tetrahedra, outward.
std::vector<std::array<int, 3>> boundary(const std::vector<std::array<int, 4>>& tets);

/// Sentences about elements that cannot be simulated, with index and quality: inverted, flat, indices
/// out of range, nodes of no element. Empty if none.
std::vector<std::string> check_tets(const TetMesh& mesh);

}  // namespace palpate
