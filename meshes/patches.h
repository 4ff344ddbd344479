#pragma once
// Which elements share one change of volume, and which one mean deformation that strain limits hold.

#include "meshes/tet_mesh.h"

namespace palpate {

/// Groups elements into connected, compact patches of about `size`, so that nearly incompressible tissue does not lock:
/// sets mesh.patches. Elements with bone nodes alone, which do not deform, are in none of them (-1).
void make_patches(TetMesh& mesh, int size);

/// Groups elements, or the patches there are where they are no larger, into connected, compact patches of at least
/// `fewest` elements, about `count` of them where the mesh is fine enough: sets mesh.limit_patches.
void make_limit_patches(TetMesh& mesh, int count, int fewest);

/// Limit patches of the same finger's coarser mesh, so that what saturates is the same part of it in both: each patch
/// of volume (an element in none) is in the one of the coarser mesh's element that its centre lies in, or nearest to. A
/// patch of the coarser mesh may be left without any.
void take_limit_patches(TetMesh& mesh, const TetMesh& coarse);

/// The same parts of the finger, bounds included: elements that bounds of the coarser mesh's patches cut belong to
/// several, by volume (mesh.limit_shares). What saturates is then as large, and where it was, in every mesh.
void cut_limit_patches(TetMesh& mesh, const TetMesh& coarse);

/// Groups the tetrahedra that have a face in the skin that can touch into connected, compact patches of about `size`
/// (1 to 8): sets mesh.membrane_patches.
void make_membrane_patches(TetMesh& mesh, int size);

}  // namespace palpate
