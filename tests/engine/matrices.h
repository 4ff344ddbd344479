#pragma once
// Random 3x3 matrices, and what Eigen knows of them.

#include <Eigen/Dense>
#include <random>

#include "engine/math/linear_algebra.h"

namespace palpate::testing {

inline Mat3<double> random_matrix(std::mt19937& random) {
    std::normal_distribution<double> n;
    Mat3<double> m;
    for (int i = 0; i < 9; ++i) m.m[i / 3][i % 3] = n(random);
    return m;
}

inline Eigen::Matrix3d eigen(const Mat3<double>& m) {
    Eigen::Matrix3d e;
    for (int i = 0; i < 9; ++i) e(i / 3, i % 3) = m.m[i / 3][i % 3];
    return e;
}

}  // namespace palpate::testing
