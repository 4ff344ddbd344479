// Linear systems of a device's few unknowns, held against Eigen's.

#include "devices/matching/small_systems.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

namespace palpate {
namespace {

TEST(SmallSystems, SolveWhatEigenSolves) {
    std::srand(3);
    for (int n = 1; n <= max_device_dimension; ++n)
        for (int trial = 0; trial < 20; ++trial) {
            const DeviceJacobian A = DeviceJacobian::Random(n, n);
            const Coordinates b = Coordinates::Random(n);
            EXPECT_LT((A * solve_square(A, b) - b).norm(), 1e-12 * (1 + solve_square(A, b).norm())) << n;

            const DeviceJacobian H = A * A.transpose() + 0.1 * DeviceJacobian::Identity(n, n);
            const SmallCholesky factor(H);
            ASSERT_EQ(factor.n, n);
            Coordinates x = b, y = b;
            factor.solve(x.data());
            EXPECT_LT((H * x - b).norm(), 1e-12) << n;
            factor.solve_transposed(y.data());
            const Eigen::MatrixXd whitened = Eigen::MatrixXd(H).llt().matrixU().solve(Eigen::VectorXd(b));
            EXPECT_LT((y - whitened).norm(), 1e-12 * (1 + y.norm())) << n;
        }
}

TEST(SmallSystems, SayWhereNothingIsToBeSolved) {
    // Two joints that do the same: the solution is one of many, and moves no more joints than it must.
    DeviceJacobian twice(3, 3);
    twice << 1, 1, 0, 2, 2, 0, 0, 0, 3;
    Coordinates b(3);
    b << 1, 2, 6;
    const Coordinates x = solve_square(twice, b);
    EXPECT_LT((twice * x - b).norm(), 1e-14);
    EXPECT_EQ((x.array() == 0).count(), 1);
    EXPECT_EQ(solve_square(DeviceJacobian::Zero(2, 2), Coordinates::Ones(2)).norm(), 0);
    EXPECT_EQ(SmallCholesky(DeviceJacobian(twice * -1)).n, 0);
    EXPECT_EQ(SmallCholesky(DeviceJacobian::Constant(2, 2, std::nan(""))).n, 0);
}

}  // namespace
}  // namespace palpate
