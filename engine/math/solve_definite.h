#pragma once
// Dense linear systems: one factorisation for all of them, since each type of matrix has its own to compile.

#include <Eigen/Core>

namespace palpate {

/// Solves A x = b for a symmetric positive definite A (Cholesky): b becomes x, and A its factor. False where A is not
/// definite; b is then what it was. No allocation.
bool solve_definite(Eigen::Ref<Eigen::MatrixXd> A, Eigen::Ref<Eigen::VectorXd> b);

}  // namespace palpate
