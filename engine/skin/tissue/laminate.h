#pragma once
// Skin that is thinner than the elements it lies in. Layers that lie on each other share their strain along the skin
// and their stress across it: an element that holds several is as stiff along the skin as their mean, across it and in
// transverse shear as soft as they are in series (Voigt's and Reuss's means; Jones 1999, Mechanics of Composite
// Materials, 4). The element itself has the latter; what it lacks along the skin is a membrane, smeared over its
// volume: Psi = mu |S - I|^2 + lambda/2 tr(S - I)^2 in plane stress, with F T = R S for its two tangents T. Flat
// triangles that keep their stretches one by one are too stiff to be bent into another shape (membrane locking: they
// are more than a mesh has freedom), so that patches of skin have one S, the mean of their elements'.

#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// F T and what follows of it. R = (a + b x n, b + n x a) / (sigma_1 + sigma_2): the polar factor of a 3x2 matrix.
template <class R>
struct MembraneState {
    Vec3<R> a, b;    ///< columns of F T
    Vec3<R> ra, rb;  ///< of its rotation
    Vec3<R> normal;  ///< of the plane that they span
    R trace;         ///< sigma_1 + sigma_2
    R S[3];          ///< R^T F T: 11, 12, 22
};

template <class R>
inline MembraneState<R> membrane_state(const Vec3<R>& a, const Vec3<R>& b) {
    using T = ScalarOf<R>;
    MembraneState<R> s;
    s.a = a, s.b = b;
    const Vec3<R> across = cross(a, b);
    // Flattened to a line, a membrane has no normal; limits keep tissue far from there.
    const R area = maximum(norm(across), R(T(1e-4)));
    s.normal = (R(1) / area) * across;
    s.trace = square_root(dot(a, a) + dot(b, b) + R(2) * area);
    const R inverse = R(1) / s.trace;
    s.ra = inverse * (a + cross(b, s.normal));
    s.rb = inverse * (b + cross(s.normal, a));
    s.S[0] = dot(s.ra, a), s.S[1] = R(T(0.5)) * (dot(s.ra, b) + dot(s.rb, a)), s.S[2] = dot(s.rb, b);
    return s;
}

/// A symmetric 2x2 matrix (11, 12, 22) without its negative eigenvalues.
template <class R>
inline void keep_positive_part(R m[3]) {
    using T = ScalarOf<R>;
    const R half(T(0.5)), zero(0);
    const R mean = half * (m[0] + m[2]), difference = half * (m[0] - m[2]);
    const R radius = square_root(difference * difference + m[1] * m[1]);
    const R above = maximum(mean + radius, zero), below = maximum(mean - radius, zero);
    const R scale = half * (above - below) / maximum(radius, R(std::numeric_limits<T>::min()));
    const R middle = half * (above + below);
    m[0] = middle + scale * difference;
    m[1] = scale * m[1];
    m[2] = middle - scale * difference;
}

/// X of S X + X S = M, symmetric 2x2 matrices (11, 12, 22), for M = (1, 0, 0), (0, 1/2, 0) and (0, 0, 1):
/// M : dS = 2 X : F_T^T dF_T, with F_T = F T and S^2 = F_T^T F_T.
template <class R>
inline void stretch_slopes(const R S[3], R X[3][3]) {
    using T = ScalarOf<R>;
    const R determinant = maximum(S[0] * S[2] - S[1] * S[1], R(T(1e-4)));
    const R scale = R(T(0.5)) / ((S[0] + S[2]) * determinant);  // X = scale (det M + adj(S) M adj(S))
    const R a = S[2], b = -S[1], c = S[0];                      // adj(S)
    X[0][0] = scale * (determinant + a * a), X[0][1] = scale * (a * b), X[0][2] = scale * (b * b);
    X[1][0] = scale * (a * b), X[1][1] = scale * (R(T(0.5)) * (determinant + a * c + b * b)), X[1][2] = scale * (b * c);
    X[2][0] = scale * (b * b), X[2][1] = scale * (b * c), X[2][2] = scale * (determinant + c * c);
}

/// Shape functions' gradients of an element's corners, along its tangents.
template <class R>
struct MembraneSlopes {
    R of_corner[4][2];
};
/// F T and what follows of it; corner a is at position(a), `number(i)` are those of SkinRest::membrane_slopes.
template <int corners, class R, class Position, class Number>
inline MembraneState<R> deformed_membrane(Position position, Number number, MembraneSlopes<R>& slopes) {
    Vec3<R> x[corners], along[2];
    for (int a = 0; a < corners; ++a) x[a] = position(a);
    for (int k = 0; k < 2; ++k) {
        R sum(0);
        for (int a = 1; a < corners; ++a) {
            const R p = slopes.of_corner[a][k] = number(2 * (a - 1) + k);
            along[k] = a == 1 ? p * (x[1] - x[0]) : along[k] + p * (x[a] - x[0]);
            sum = a == 1 ? p : sum + p;
        }
        slopes.of_corner[0][k] = -sum;
    }
    return membrane_state(along[0], along[1]);
}

/// What a group's mean stretch costs: mu |S - I|^2 + lambda/2 tr(S - I)^2, moduli times volumes [N m].
template <class R>
struct MeanMembrane {
    R mu, lambda, over_mu;
    R strain[3];
    R stress[3];  ///< dE/dS: 11, 12, 22
};
template <class R>
inline MeanMembrane<R> begin_mean() {
    return {R(0), R(0), R(0), {R(0), R(0), R(0)}, {R(0), R(0), R(0)}};
}
/// Of all its elements' moduli and strains; returns the energy.
template <class R>
inline R finish_mean(MeanMembrane<R>& mean) {
    using T = ScalarOf<R>;
    const R one(1), two(2), half(T(0.5));
    mean.over_mu = one / maximum(mean.mu, R(T(1e-30)));  // a finger without, beside fingers with membranes
    R* strain = mean.strain;
    for (int k = 0; k < 3; ++k) strain[k] = mean.over_mu * strain[k];
    const R stretch = strain[0] + strain[2];
    for (int k = 0; k < 3; ++k) mean.stress[k] = two * mean.mu * strain[k] + (k == 1 ? R(0) : mean.lambda * stretch);
    return mean.mu * (strain[0] * strain[0] + two * strain[1] * strain[1] + strain[2] * strain[2]) +
           half * mean.lambda * stretch * stretch;
}

/// Forces on an element's corners, force(a, dE/dx_a), and where wanted its part of the group's dS/dx, slope(a, k, v),
/// and the stiffness that is its own, block(a, b, K) of b <= a. `weight` is its share of the group's mean.
template <Want want, int corners, class R, class Force, class Slope, class Block>
inline void membrane_terms(const MembraneState<R>& s, const MembraneSlopes<R>& slopes, const R stress[3],
                           const R& weight, const R& exactness, Force force, Slope slope, Block block) {
    const R two(2), half(ScalarOf<R>(0.5)), zero(0);
    const auto& p = slopes.of_corner;
    R X[3][3], x[3];  // of the components of S; of the stress
    stretch_slopes(s.S, X);
    for (int k = 0; k < 3; ++k) x[k] = stress[0] * X[0][k] + two * stress[1] * X[1][k] + stress[2] * X[2][k];
    const R twice = two * weight;
    const Vec3<R> P[2] = {twice * (x[0] * s.a + x[1] * s.b), twice * (x[1] * s.a + x[2] * s.b)};
    for (int a = 0; a < corners; ++a) force(a, p[a][0] * P[0] + p[a][1] * P[1]);
    if constexpr (want != Want::forces_and_matrix) return;
    Vec3<R> own[corners][3];  // dS/dx, of the element
    for (int k = 0; k < 3; ++k) {
        const Vec3<R> Q[2] = {two * (X[k][0] * s.a + X[k][1] * s.b), two * (X[k][1] * s.a + X[k][2] * s.b)};
        for (int a = 0; a < corners; ++a) {
            own[a][k] = p[a][0] * Q[0] + p[a][1] * Q[1];
            slope(a, k, weight * own[a][k]);
        }
    }
    // What the stress adds: out of the plane 2 X; within it, with dF_T = R (dS + w J S), J the quarter turn,
    // w^2 stress : S + 2 w dS : Z, Z = J S X - X S J. Where the matrix is to be positive, without what is not.
    R bend[3] = {two * x[0], two * x[1], two * x[2]}, positive[3] = {bend[0], bend[1], bend[2]};
    keep_positive_part(positive);
    for (int k = 0; k < 3; ++k) bend[k] = weight * (positive[k] + exactness * (bend[k] - positive[k]));
    R turn = stress[0] * s.S[0] + two * stress[1] * s.S[1] + stress[2] * s.S[2];
    turn = weight * (maximum(turn, zero) + exactness * minimum(turn, zero));
    const R u11 = s.S[0] * x[0] + s.S[1] * x[1], u12 = s.S[0] * x[1] + s.S[1] * x[2],
            u21 = s.S[1] * x[0] + s.S[2] * x[1], u22 = s.S[1] * x[1] + s.S[2] * x[2];
    const R mixed = weight * exactness;
    const R z[3] = {mixed * (-two * u21), mixed * (two * (u11 - u22)), mixed * (two * u12)};
    Vec3<R> turned[corners], crossed[corners];
    for (int a = 0; a < corners; ++a) {
        turned[a] = (R(1) / s.trace) * (p[a][0] * s.rb - p[a][1] * s.ra);
        crossed[a] = half * turn * turned[a] + z[0] * own[a][0] + z[1] * own[a][1] + z[2] * own[a][2];
    }
    for (int a = 0; a < corners; ++a) {
        const R bent[2] = {bend[0] * p[a][0] + bend[1] * p[a][1], bend[1] * p[a][0] + bend[2] * p[a][1]};
        for (int b = 0; b <= a; ++b) {
            const Vec3<R> along = (bent[0] * p[b][0] + bent[1] * p[b][1]) * s.normal;
            Mat3<R> K;
            for (int k = 0; k < 3; ++k)
                for (int j = 0; j < 3; ++j)
                    K.m[k][j] = along[k] * s.normal[j] + turned[a][k] * crossed[b][j] + crossed[a][k] * turned[b][j];
            block(a, b, K);
        }
    }
}

/// dS/dx of a group's nodes, as tr S, S11 - S22 and S12, whose moduli are independent.
template <class R>
inline void take_principal_parts(Vec3<R>* slope) {
    const Vec3<R> xx = slope[0], yy = slope[2];
    slope[0] = xx + yy, slope[2] = slope[1], slope[1] = xx - yy;
}
template <class R>
inline std::array<R, 3> principal_moduli(const MeanMembrane<R>& mean) {
    return {mean.mu + mean.lambda, mean.mu, R(4) * mean.mu};
}

/// A membrane that resists its own stretch alone; as membrane_terms, with corners as the element's nodes are. Returns
/// its energy.
template <Want want, class Q, class Position, class Number, class Force, class Block>
inline Q lone_membrane(Position position, Number number, const Q& mu, const Q& lambda, const Q& exactness, Force force,
                       Block block) {
    const Q one(1);
    MembraneSlopes<Q> slopes;
    const MembraneState<Q> s = deformed_membrane<4>(position, number, slopes);
    MeanMembrane<Q> mean{mu, lambda, Q(0), {mu * (s.S[0] - one), mu * s.S[1], mu * (s.S[2] - one)}, {}};
    const Q energy = finish_mean(mean);
    const std::array<Q, 3> moduli = principal_moduli(mean);
    Vec3<Q> slope[4][3], weighted[4][3];
    membrane_terms<want, 4>(
        s, slopes, mean.stress, mean.over_mu * mu, exactness, force,
        [&](int a, int k, const Vec3<Q>& v) {
            slope[a][k] = v;
            if (k < 2) return;
            take_principal_parts(slope[a]);
            for (int i = 0; i < 3; ++i) weighted[a][i] = moduli[std::size_t(i)] * slope[a][i];
        },
        [&](int a, int b, Mat3<Q> K) {
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    K.m[i][j] += weighted[a][0][i] * slope[b][0][j] + weighted[a][1][i] * slope[b][1][j] +
                                 weighted[a][2][i] * slope[b][2][j];
            block(a, b, K);
        });
    return energy;
}

}  // namespace palpate::detail
