#pragma once
// Which elements share one change of volume.

#include "meshes/tet_mesh.h"

namespace palpate {

/// Groups elements into connected, compact patches of about `size`, so that nearly incompressible tissue does not lock:
/// sets mesh.patches. Elements with bone nodes alone, which do not deform, are in none of them (-1).
void make_patches(TetMesh& mesh, int size);

}  // namespace palpate
