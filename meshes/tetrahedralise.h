#pragma once
// From a closed surface to tetrahedra, by TetGen in a guarded child process.

#include <string>

#include "meshes/surface.h"

namespace palpate {

struct TetrahedraliseSettings {
    int elements = 347;              ///< wanted count; the result is near it
    double time_limit_s = 20;        ///< per TetGen run
    double memory_limit_MiB = 2048;  ///< per TetGen run
};

/// Quality of a mesh; dihedral angles in degrees, radius ratio 1 for the regular tetrahedron.
struct MeshQuality {
    double volume = 0;                                       ///< [m^3]
    double worst_dihedral_deg = 0, median_dihedral_deg = 0;  ///< of each element's smallest angle
    double worst_radius_ratio = 0, median_radius_ratio = 0;
    double worst_volume_ratio = 0;  ///< smallest element volume over the mean
};
MeshQuality measure_quality(const TetMesh& mesh);

/// Remeshes the surface to several resolutions and keeps the tetrahedra nearest to the wanted count.
/// Bone and pad nodes are left empty. Throws InputError when no resolution gives a sound mesh.
TetMesh tetrahedralise(const Surface& surface, const TetrahedraliseSettings& settings);

/// One TetGen run in the helper process, surface kept as it is. Throws InputError with what happened:
/// refused surface, crash, time or memory limit.
TetMesh run_tetgen(const Surface& surface, const std::string& switches, const TetrahedraliseSettings& settings);

/// Boundary triangles of tetrahedra, outward.
std::vector<std::array<int, 3>> boundary(const std::vector<std::array<int, 4>>& tets);

/// Sentences about elements that cannot be simulated, with index and quality: inverted, flat, indices
/// out of range, nodes of no element. Empty if none.
std::vector<std::string> check_tets(const TetMesh& mesh);

}  // namespace palpate
