#include "engine/math/solve_definite.h"

#include <Eigen/Cholesky>

namespace palpate {

bool solve_definite(Eigen::Ref<Eigen::MatrixXd> A, Eigen::Ref<Eigen::VectorXd> b) {
    Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(A);
    if (factor.info() != Eigen::Success) return false;
    factor.solveInPlace(b);
    return true;
}

}  // namespace palpate
