#pragma once
// The yardstick for many fingers: one elastic step of eight fingers, one per float of a register. Linear corotational
// elements, rotations by three polar iterations, forces, assembly, block Cholesky, one solve; bone nodes fixed. No
// limits, contact, bodies or line search, and no check of convergence: what the arithmetic alone costs.

#include "meshes/tet_mesh.h"

namespace palpate {

struct BatchedBaseline {
    double us_per_finger;   ///< median of repeated steps: B0
    double solve_residual;  ///< |K dx - f| / |f| of its last linear solve: that it solves what it says
    int elements, free_nodes;
};

BatchedBaseline time_batched_baseline(const TetMesh& mesh);

}  // namespace palpate
