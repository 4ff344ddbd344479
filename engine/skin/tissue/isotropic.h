#pragma once
// Isotropic energy densities of the deformation gradient, in the frame of its singular value
// decomposition: elasticity, and the augmented Lagrangian of the strain limits. Value, gradient and
// curvature stand side by side; elements.h turns any of them into nodal forces and stiffness.

#include <limits>

#include "engine/math/svd3.h"

namespace palpate {

/// How curvature is given: exact (what finite differences see) or with its negative eigenvalues
/// removed, so that the Newton matrix is positive definite.
enum class Curvature { exact, positive };

/// Derivatives of an isotropic energy density Psi(F) with respect to the principal stretches.
template <class R>
struct PrincipalTerms {
    R energy;           ///< Psi [J/m^3]
    Vec3<R> stress;     ///< p_i = dPsi/dsigma_i [Pa]
    Mat3<R> curvature;  ///< d2Psi/dsigma_i dsigma_j [Pa]
    Vec3<R> flip;       ///< (p_i - p_j) / (sigma_i - sigma_j) for the pair opposite axis k [Pa]
    Vec3<R> twist;      ///< (p_i + p_j) / (sigma_i + sigma_j) for the pair opposite axis k [Pa]
};

/// The two axes of the pair opposite axis k.
inline constexpr int pair_of[3][2] = {{1, 2}, {2, 0}, {0, 1}};

/// Psi = mu |S - I|^2 + lambda/2 tr(S - I)^2 with F = R S (Mueller & Gross 2004). sigma is signed
/// (svd3.h), so that inverted elements are pushed back through their flattest direction.
/// `pressure` is added to its stress, as of a volume term that it has a part in [Pa].
template <Curvature mode, class R>
inline PrincipalTerms<R> corotational(const Vec3<R>& sigma, const R& mu, const R& lambda, const R& pressure) {
    const R one(1), two(2);
    const Vec3<R> e{sigma.x - one, sigma.y - one, sigma.z - one};
    const R trace = e.x + e.y + e.z;
    PrincipalTerms<R> t;
    t.energy = mu * dot(e, e) + R(ScalarOf<R>(0.5)) * lambda * trace * trace;
    for (int i = 0; i < 3; ++i) {
        t.stress[i] = two * mu * e[i] + pressure;
        for (int j = 0; j < 3; ++j) t.curvature[i][j] = i == j ? two * mu + lambda : lambda;
        t.flip[i] = two * mu;
    }
    constexpr ScalarOf<R> floor = std::numeric_limits<ScalarOf<R>>::epsilon() * 8;
    for (int k = 0; k < 3; ++k) {
        const int i = pair_of[k][0], j = pair_of[k][1];
        t.twist[k] = (t.stress[i] + t.stress[j]) / maximum(sigma[i] + sigma[j], R(floor));
        if (mode == Curvature::positive) t.twist[k] = maximum(t.twist[k], R(0));
    }
    return t;
}
template <Curvature mode, class R>
inline PrincipalTerms<R> corotational(const Vec3<R>& sigma, const R& mu, const R& lambda) {
    const R one(1);
    return corotational<mode>(sigma, mu, lambda, lambda * ((sigma.x - one) + (sigma.y - one) + (sigma.z - one)));
}

/// Psi = mu |E|^2 + lambda/2 tr(E)^2 with E = (F^T F - I) / 2 (St. Venant-Kirchhoff). It softens under strong
/// compression and does not resist inversion: a material to compare with, not to feel with.
template <Curvature mode, class R>
inline PrincipalTerms<R> saint_venant_kirchhoff(const Vec3<R>& sigma, const R& mu, const R& lambda) {
    const R half(ScalarOf<R>(0.5)), one(1), three(3), zero(0);
    const Vec3<R> squared{sigma.x * sigma.x, sigma.y * sigma.y, sigma.z * sigma.z};
    const Vec3<R> E{half * (squared.x - one), half * (squared.y - one), half * (squared.z - one)};
    const R trace = E.x + E.y + E.z, pressure = lambda * trace;
    auto bounded = [&](const R& a) { return mode == Curvature::positive ? maximum(a, zero) : a; };
    PrincipalTerms<R> t;
    t.energy = mu * dot(E, E) + half * lambda * trace * trace;
    for (int i = 0; i < 3; ++i) {
        t.stress[i] = sigma[i] * (mu * (squared[i] - one) + pressure);
        for (int j = 0; j < 3; ++j) t.curvature[i][j] = lambda * sigma[i] * sigma[j];
        t.curvature[i][i] += bounded(mu * (three * squared[i] - one) + pressure);
    }
    for (int k = 0; k < 3; ++k) {
        const int i = pair_of[k][0], j = pair_of[k][1];
        const R even = mu * (squared[i] + squared[j] - one) + pressure, odd = mu * sigma[i] * sigma[j];
        t.flip[k] = bounded(even + odd);
        t.twist[k] = bounded(even - odd);
    }
    return t;
}

namespace detail {

/// J^(-2/3) and its first two derivatives; below J = 0.2, where it would run off to infinity, its expansion to second
/// order, which goes on to push towards larger J: elements that are flat or inverted feel a finite, restoring force.
template <class R>
inline Vec3<R> volume_factor(const R& J) {
    using T = ScalarOf<R>;
    const R start(T(0.2));
    const R inside = maximum(J, start), inverse = R(1) / inside;
    R root;
    for (int l = 0; l < lane_width<R>; ++l) set_lane(root, l, std::cbrt(lane(inverse, l)));
    const R g = root * root, slope = R(T(-2.0 / 3)) * g * inverse, bend = R(T(-5.0 / 3)) * slope * inverse;
    const R beyond = minimum(J - start, R(0));
    return {g + beyond * (slope + R(T(0.5)) * beyond * bend), slope + beyond * bend, bend};
}

/// Symmetric A without its negative eigenvalues: (A + |A|) / 2, |A| = V |sigma| V^T.
template <class R>
inline Mat3<R> positive_part(const Mat3<R>& A) {
    const SignedSvd<R> svd = signed_svd(A);
    Mat3<R> VS = svd.V;
    for (int i = 0; i < 9; ++i) VS.m[i / 3][i % 3] *= absolute(svd.sigma[i % 3]);
    return R(ScalarOf<R>(0.5)) * (A + times_transposed(VS, svd.V));
}

}  // namespace detail

/// Psi = mu/2 (J^(-2/3) tr(F^T F) - 3) + kappa/2 (J - 1)^2, kappa = lambda + 2 mu / 3: compressible neo-Hookean as
/// CalculiX writes it, extended to flat and inverted elements (volume_factor).
template <Curvature mode, class R>
inline PrincipalTerms<R> neo_hookean(const Vec3<R>& sigma, const R& mu, const R& lambda) {
    using T = ScalarOf<R>;
    const R half(T(0.5)), one(1);
    const R kappa = lambda + R(T(2.0 / 3)) * mu;
    const R J = sigma.x * sigma.y * sigma.z, I = dot(sigma, sigma);
    const Vec3<R> dJ{sigma.y * sigma.z, sigma.z * sigma.x, sigma.x * sigma.y};
    const Vec3<R> g = detail::volume_factor(J);
    const R pressure = half * mu * g[1] * I + kappa * (J - one), bulk = half * mu * g[2] * I + kappa;
    PrincipalTerms<R> t;
    t.energy = half * mu * (g[0] * I - R(3)) + half * kappa * (J - one) * (J - one);
    for (int i = 0; i < 3; ++i) {
        t.stress[i] = mu * g[0] * sigma[i] + pressure * dJ[i];
        for (int j = 0; j < 3; ++j)
            t.curvature[i][j] = mu * g[1] * (dJ[i] * sigma[j] + sigma[i] * dJ[j]) + bulk * dJ[i] * dJ[j] +
                                (i == j ? mu * g[0] : pressure * sigma[3 - i - j]);
    }
    for (int k = 0; k < 3; ++k) {
        t.flip[k] = mu * g[0] - pressure * sigma[k];
        t.twist[k] = mu * g[0] + pressure * sigma[k];
    }
    if constexpr (mode == Curvature::positive) {
        t.curvature = detail::positive_part(t.curvature);
        for (int k = 0; k < 3; ++k) {
            t.flip[k] = maximum(t.flip[k], R(0));
            t.twist[k] = maximum(t.twist[k], R(0));
        }
    }
    return t;
}

/// Bounds on the principal stretches as an augmented Lagrangian in the shifted deformation gradient
/// T = F + Lambda/k (multiplier Lambda [Pa], penalty k [Pa]): Psi = k/2 dist(T, K)^2 with
/// K = {T : low <= tau_i <= high}. It is isotropic in T, so the arguments are T's singular values.
/// dPsi/dF = k (T - projection of T onto K), which is also the updated multiplier.
template <Curvature mode, class R>
inline PrincipalTerms<R> strain_limit(const Vec3<R>& tau, const R& low, const R& high, const R& k) {
    constexpr ScalarOf<R> half(ScalarOf<R>(0.5));
    PrincipalTerms<R> t;
    Vec3<R> active{R(0), R(0), R(0)};
    t.energy = R(0);
    t.curvature = Mat3<R>::zero();
    for (int i = 0; i < 3; ++i) {
        const R excess = tau[i] - clamp(tau[i], low, high);
        t.stress[i] = k * excess;
        active[i] = select(absolute(excess) > R(0), k, R(0));
        t.curvature[i][i] = active[i];
        t.energy += R(half) * k * excess * excess;
    }
    constexpr ScalarOf<R> eps = std::numeric_limits<ScalarOf<R>>::epsilon() * 64;
    for (int a = 0; a < 3; ++a) {
        const int i = pair_of[a][0], j = pair_of[a][1];
        const R difference = tau[i] - tau[j];
        const MaskOf<R> equal = absolute(difference) < R(eps);
        t.flip[a] = select(equal, R(half) * (active[i] + active[j]),
                           (t.stress[i] - t.stress[j]) / select(equal, R(1), difference));
        t.twist[a] = (t.stress[i] + t.stress[j]) / maximum(tau[i] + tau[j], R(eps));
        if (mode == Curvature::positive) t.twist[a] = clamp(t.twist[a], R(0), k);
    }
    return t;
}

/// Curvature between positive semidefinite (share 0) and exact (share 1).
template <class R>
inline PrincipalTerms<R> blend_curvature(const PrincipalTerms<R>& exact, const PrincipalTerms<R>& positive,
                                         const R& share) {
    PrincipalTerms<R> t = positive;
    for (int k = 0; k < 3; ++k) t.twist[k] = positive.twist[k] + share * (exact.twist[k] - positive.twist[k]);
    return t;
}

/// The same where stretching and flip terms differ between the two, too.
template <class R>
inline PrincipalTerms<R> blend_all_curvature(const PrincipalTerms<R>& exact, const PrincipalTerms<R>& positive,
                                             const R& share) {
    PrincipalTerms<R> t = blend_curvature(exact, positive, share);
    for (int i = 0; i < 3; ++i) {
        t.flip[i] = positive.flip[i] + share * (exact.flip[i] - positive.flip[i]);
        for (int j = 0; j < 3; ++j)
            t.curvature[i][j] = positive.curvature[i][j] + share * (exact.curvature[i][j] - positive.curvature[i][j]);
    }
    return t;
}

/// First Piola-Kirchhoff stress of an isotropic energy: P = U diag(p) V^T [Pa].
template <class R>
inline Mat3<R> principal_to_matrix(const SignedSvd<R>& svd, const Vec3<R>& p) {
    Mat3<R> UP = svd.U;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) UP.m[i][j] *= p[j];
    return times_transposed(UP, svd.V);
}

/// Stiffness blocks of one element, K_ab = d2(volume Psi)/dx_a dx_b [N/m], for the node pairs
/// (0,0) (1,0) (1,1) (2,0) (2,1) (2,2) (3,0) (3,1) (3,2) (3,3).
template <class R>
struct ElementBlocks {
    Mat3<R> block[10];
};
inline constexpr int block_pair[10][2] = {{0, 0}, {1, 0}, {1, 1}, {2, 0}, {2, 1},
                                          {2, 2}, {3, 0}, {3, 1}, {3, 2}, {3, 3}};

namespace detail {
/// One block in the SVD frame: rows in U, with ga and gb in V.
template <class R>
inline Mat3<R> principal_block(const PrincipalTerms<R>& t, const Vec3<R>& ga, const Vec3<R>& gb) {
    const R half(ScalarOf<R>(0.5));
    Mat3<R> K;
    for (int i = 0; i < 3; ++i) K[i][i] = t.curvature[i][i] * ga[i] * gb[i];
    for (int k = 0; k < 3; ++k) {
        const int i = pair_of[k][0], j = pair_of[k][1];
        const R direct = half * (t.flip[k] + t.twist[k]);   // coefficient of dF_ij^2 and dF_ji^2
        const R crossed = half * (t.flip[k] - t.twist[k]);  // coefficient of dF_ij dF_ji
        K[i][i] += direct * ga[j] * gb[j];
        K[j][j] += direct * ga[i] * gb[i];
        K[i][j] = t.curvature[i][j] * ga[i] * gb[j] + crossed * ga[j] * gb[i];
        K[j][i] = t.curvature[i][j] * ga[j] * gb[i] + crossed * ga[i] * gb[j];
    }
    return K;
}
}  // namespace detail

/// Adds the stiffness of one energy term to the element's blocks.
/// `g` are the shape gradients of nodes 1..3 [1/m]; node 0's is minus their sum.
template <class R>
inline void add_stiffness(const SignedSvd<R>& svd, const PrincipalTerms<R>& terms, const Vec3<R> g[3], const R& volume,
                          ElementBlocks<R>& out) {
    Vec3<R> ghat[3];
    for (int a = 0; a < 3; ++a) ghat[a] = transposed_times(svd.V, g[a]);
    Mat3<R> K[3][3];
    for (int a = 0; a < 3; ++a)
        for (int b = 0; b <= a; ++b) {
            const Mat3<R> local = detail::principal_block(terms, ghat[a], ghat[b]);
            K[a][b] = volume * times_transposed(svd.U * local, svd.U);
            if (a != b) K[b][a] = transpose(K[a][b]);
        }
    // Rows and columns of the 12x12 matrix sum to zero: rigid translations cost nothing.
    const Mat3<R> row[3] = {K[0][0] + K[0][1] + K[0][2], K[1][0] + K[1][1] + K[1][2], K[2][0] + K[2][1] + K[2][2]};
    Mat3<R>* block = out.block;
    block[0] = block[0] + row[0] + row[1] + row[2];
    block[1] = block[1] - row[0];
    block[2] = block[2] + K[0][0];
    block[3] = block[3] - row[1];
    block[4] = block[4] + K[1][0];
    block[5] = block[5] + K[1][1];
    block[6] = block[6] - row[2];
    block[7] = block[7] + K[2][0];
    block[8] = block[8] + K[2][1];
    block[9] = block[9] + K[2][2];
}

/// Adds dPsi/dx of an element with stress P to the gradients of its four nodes [N].
template <class R>
inline void add_gradient(const Mat3<R>& P, const Vec3<R> g[3], const R& volume, Vec3<R> out[4]) {
    for (int a = 0; a < 3; ++a) {
        const Vec3<R> f = volume * (P * g[a]);
        out[a + 1] += f;
        out[0] -= f;
    }
}

/// F = sum_a (x_a - x_0) g_a^T, shape gradients g of nodes 1..3.
template <class R>
inline void set_deformation_gradient(const Vec3<R> x[4], const Vec3<R> g[3], Mat3<R>& F) {
    const Vec3<R> edge[3] = {x[1] - x[0], x[2] - x[0], x[3] - x[0]};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) F.m[i][j] = edge[0][i] * g[0][j] + edge[1][i] * g[1][j] + edge[2][i] * g[2][j];
}
template <class R>
inline Mat3<R> deformation_gradient(const Vec3<R> x[4], const Vec3<R> g[3]) {
    Mat3<R> F;
    set_deformation_gradient(x, g, F);
    return F;
}

}  // namespace palpate
