// Corotational tissue without singular values: polar decomposition, the definite part of its stiffness.

#include <gtest/gtest.h>

#include "engine/skin/tissue/corotational.h"
#include "tests/engine/matrices.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eigen;
using testing::Modes;
using testing::random_matrix;
using testing::symmetric_modes;

TEST(Polar, GivesTheRotationOfTheSingularVectors) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> stretch(0.1, 2.5);
    auto check = [](const Mat3<double>& F) {
        const SignedSvd<double> svd = signed_svd(F);
        if (svd.sigma.y + svd.sigma.z < 0.02) return;  // where it is not unique
        const Eigen::Matrix3d Q = eigen(nearest_rotation(F));
        EXPECT_LT((Q - eigen(svd.U) * eigen(svd.V).transpose()).norm(), 1e-11);
        EXPECT_LT((Q.transpose() * Q - Eigen::Matrix3d::Identity()).norm(), 1e-14);
        Mat3<float> single;
        for (int i = 0; i < 9; ++i) single.m[i / 3][i % 3] = float(F.m[i / 3][i % 3]);
        const Mat3<float> q = nearest_rotation(single);
        for (int i = 0; i < 9; ++i) EXPECT_NEAR(q.m[i / 3][i % 3], Q(i / 3, i % 3), 2e-5);
    };
    for (int i = 0; i < 5000; ++i) {
        check(random_matrix(random));  // of both signs
        const auto a = signed_svd(random_matrix(random));
        check(principal_to_matrix(a, {stretch(random), stretch(random), stretch(random)}));
    }
    check(Mat3<double>::identity());
    const Mat3<double> flat = nearest_rotation(Mat3<double>::zero());
    EXPECT_NEAR(eigen(flat).determinant(), 1, 1e-12);
}

TEST(Polar, ThePositivePartIsBoundedFromAbove) {
    std::mt19937 random(6);
    auto full = [](const Symmetric3<double>& a) {
        return Eigen::Matrix3d{{a.xx, a.xy, a.xz}, {a.xy, a.yy, a.yz}, {a.xz, a.yz, a.zz}};
    };
    for (int i = 0; i < 20000; ++i) {
        const Mat3<double> m = random_matrix(random);
        const double shift = i % 3 - 1.0;
        const Symmetric3<double> a{m[0][0] + shift, m[0][1], m[1][1] + shift, m[0][2], m[1][2], m[2][2] + shift};
        const Modes modes = symmetric_modes(full(a));
        const Eigen::Matrix3d exact = modes.vectors * modes.values.cwiseMax(0).asDiagonal() * modes.vectors.transpose();
        const Eigen::VectorXd above = symmetric_modes(full(positive_part_bound(a)) - exact).values;
        const double size = full(a).cwiseAbs().rowwise().sum().maxCoeff();
        EXPECT_GT(above.minCoeff(), -1e-12 * size);
        EXPECT_LT(above.maxCoeff(), (positive_part_excess + 1e-12) * size);
        EXPECT_EQ(positive_definite(a), modes.values.minCoeff() > 0);
        if (!positive_definite(a)) continue;
        EXPECT_LT((full(inverse_of_positive(a, 1e-300)) * full(a) - Eigen::Matrix3d::Identity()).norm(),
                  1e-12 * size / modes.values.minCoeff());
    }
}

/// A lane's rotation does not depend on its neighbour, which needs more iterations, or a decomposition.
TEST(Polar, LanesAgreeWithScalarBitForBit) {
    using R = Lanes<double, 2>;
    std::mt19937 random(7);
    for (int i = 0; i < 2000; ++i) {
        const Mat3<double> a = Mat3<double>::identity() + 0.1 * random_matrix(random), b = random_matrix(random);
        Mat3<R> both;
        for (int k = 0; k < 9; ++k)
            set_lane(both.m[k / 3][k % 3], 0, a.m[k / 3][k % 3]), set_lane(both.m[k / 3][k % 3], 1, b.m[k / 3][k % 3]);
        const Mat3<R> lanes = nearest_rotation(both);
        const Mat3<double> qa = nearest_rotation(a), qb = nearest_rotation(b);
        for (int k = 0; k < 9; ++k) {
            EXPECT_EQ(lane(lanes.m[k / 3][k % 3], 0), qa.m[k / 3][k % 3]);
            EXPECT_EQ(lane(lanes.m[k / 3][k % 3], 1), qb.m[k / 3][k % 3]);
        }
    }
}

Eigen::Matrix<double, 12, 12> matrix_of(const Mat3<double> block[10]) {
    Eigen::Matrix<double, 12, 12> H;
    for (int k = 0; k < 10; ++k)
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                H(3 * block_pair[k][0] + i, 3 * block_pair[k][1] + j) =
                    H(3 * block_pair[k][1] + j, 3 * block_pair[k][0] + i) = block[k][i][j];
    return H;
}

/// The unit corner tetrahedron, whose shape gradients are the unit vectors.
constexpr double volume = 1.0 / 6;

/// It in corotational tissue, turned back, and its stiffness for an exactness of the curvature.
template <class T>
struct TurnedBack {
    detail::Corotated<T> s;
    Vec3<T> r[3];

    TurnedBack(const Mat3<double>& F) {
        for (int a = 0; a < 3; ++a) s.g[a] = {T(a == 0), T(a == 1), T(a == 2)};
        s.volume = T(volume);
        for (int i = 0; i < 9; ++i) s.strained.m[i / 3][i % 3] = T(F.m[i / 3][i % 3]);
        s.rotation = nearest_rotation(s.strained);
        detail::finish_corotated(s);
        for (int a = 0; a < 3; ++a) r[a] = s.rotation * s.g[a];
    }
    Eigen::Matrix<double, 12, 12> stiffness(double mu, double lambda, double pressure, double exactness) const {
        Mat3<double> block[10];
        detail::Corotated<T> weighed = s;
        detail::weigh_turning(weighed, T(mu), T(pressure), T(exactness));
        detail::corotational_stiffness(weighed, r, T(mu), T(lambda),
                                       [&](int k, int i, int j, T entry) { block[k].m[i][j] = entry; });
        return matrix_of(block);
    }
};

Eigen::Matrix<double, 12, 12> principal_stiffness(const SignedSvd<double>& svd, const PrincipalTerms<double>& terms,
                                                  const Vec3<double> g[3]) {
    ElementBlocks<double> blocks;
    for (auto& b : blocks.block) b = Mat3<double>::zero();
    add_stiffness(svd, terms, g, volume, blocks);
    return matrix_of(blocks.block);
}

/// What the solver assembles without singular values, against the same in their frame: forces, the exact stiffness, and
/// the definite one. That is the positive part itself where the pressure is above 2 mu, and elsewhere not below it, and
/// above by no more than the bound of the sign iteration lets it be.
TEST(Corotational, TissueNeedsNoSingularValues) {
    std::mt19937 random(4);
    const double mu = 1e3;
    int inverted = 0, indefinite = 0, pressed = 0;
    double worst = 0, worst_of_tenth = 0;  // of what pressures up to mu leave above the positive part; strained by 10 %
    for (int trial = 0; trial < 6000; ++trial) {
        // With a volume term of its own, and with the pressure of a patch.
        const double lambda = trial % 2 ? 9e3 : 0;
        const double strength = trial % 3 == 0 ? 1.5 : trial % 3 == 1 ? 0.5 : 0.1;
        const Mat3<double> F = Mat3<double>::identity() + strength * random_matrix(random);
        const SignedSvd<double> svd = signed_svd(F);
        if (svd.sigma.y + svd.sigma.z < 0.05) continue;  // where the rotation is hardly known
        const TurnedBack<double> back(F);
        const detail::Corotated<double>& s = back.s;
        Vec3<double> force[4];
        const double pressure = lambda > 0 ? lambda * s.stretch : 5e3 * std::sin(trial);
        const auto exact = corotational<Curvature::exact>(svd.sigma, mu, lambda, pressure),
                   positive = corotational<Curvature::positive>(svd.sigma, mu, lambda, pressure);
        detail::corotational_force(s, mu, pressure, force);
        const Mat3<double> P = principal_to_matrix(svd, exact.stress);
        for (int a = 0; a < 3; ++a) {
            const Vec3<double> expected = volume * (P * s.g[a]);
            for (int d = 0; d < 3; ++d) EXPECT_NEAR(force[a + 1][d], expected[d], 1e-9 * mu) << trial;
        }
        const auto of_exact = principal_stiffness(svd, exact, s.g),
                   of_positive = principal_stiffness(svd, positive, s.g);
        const double size = of_exact.norm();
        EXPECT_LT((back.stiffness(mu, lambda, pressure, 1) - of_exact).norm(), 1e-8 * size) << trial;
        const auto definite = back.stiffness(mu, lambda, pressure, 0);
        const Eigen::VectorXd above = symmetric_modes(definite - of_positive).values,
                              own = symmetric_modes(definite).values;
        const double excess = above.maxCoeff();
        // |kappa| [r]' (1 / floor - 1 / (floor + raised)) [r], where the sum of |r|^2 is 6.
        const double floor = std::max(2 - pressure / mu, 0.0);
        const double raised = positive_part_excess * (std::abs(2 + s.stretch - floor) + 3 * svd.sigma.x + 3);
        EXPECT_GT(above.minCoeff(), -1e-9 * size) << trial;
        EXPECT_LT(excess, 1e-9 * size + (floor > 0 ? 6 * volume * mu * raised / (floor + raised) : 0)) << trial;
        EXPECT_GT(own.minCoeff(), -1e-12 * size) << trial;
        const Eigen::VectorXd single = symmetric_modes(TurnedBack<float>(F).stiffness(mu, lambda, pressure, 0)).values;
        EXPECT_GT(single.minCoeff(), -2e-5 * size) << trial;
        if (pressure <= mu) worst = std::max(worst, excess / size);
        if (pressure <= mu && strength < 0.2) worst_of_tenth = std::max(worst_of_tenth, excess / size);
        inverted += svd.sigma.z < 0;
        indefinite += exact.twist.x < 0 || exact.twist.y < 0 || exact.twist.z < 0;
        pressed += pressure > 2 * mu;
    }
    EXPECT_LT(worst, 0.15);
    EXPECT_LT(worst_of_tenth, 0.03);
    EXPECT_GT(inverted, 200);
    EXPECT_GT(indefinite, 1000);
    EXPECT_GT(pressed, 300);
}

}  // namespace
}  // namespace palpate
