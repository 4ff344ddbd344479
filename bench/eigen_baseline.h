#pragma once
// The yardstick: one elastic step of one finger written plainly with Eigen. Linear corotational elements,
// polar decomposition by Newton's iteration, rotated stiffness, SimplicialLLT with its pattern analysed once.

#include "meshes/tet_mesh.h"

namespace palpate {

struct EigenBaseline {
    double all_nodes_us;   ///< all nodes unknown, as where springs tie the skin to the bone: T0
    double free_nodes_us;  ///< bone nodes fixed
};

/// Medians over repeated steps.
EigenBaseline time_eigen_baseline(const TetMesh& mesh);

}  // namespace palpate
