#pragma once
// Singular value decomposition of 3x3 matrices, over lanes.

#include <limits>
#include <utility>

#include "engine/math/linear_algebra.h"

namespace palpate {

/// F = U diag(sigma) V^T with U and V rotations (determinant +1), |sigma[0]| >= |sigma[1]| >= |sigma[2]|;
/// only sigma[2] may be negative, exactly when det F < 0. R = U V^T is then the rotation nearest to F.
template <class R>
struct SignedSvd {
    Mat3<R> U, V;
    Vec3<R> sigma;
};

namespace detail {

/// Rotates columns p and q of B and V so that B's become orthogonal (one-sided Jacobi).
template <class R>
inline void orthogonalise_columns(Mat3<R>& B, Mat3<R>& V, int p, int q, MaskOf<R>& converged) {
    const Vec3<R> bp = B.column(p), bq = B.column(q);
    const R app = dot(bp, bp), aqq = dot(bq, bq), apq = dot(bp, bq);
    constexpr ScalarOf<R> eps = std::numeric_limits<ScalarOf<R>>::epsilon();
    const MaskOf<R> rotate = (apq * apq > R(16 * eps * eps) * app * aqq) & (app * aqq > R(0));
    if (!any(rotate)) return;
    converged = converged & !rotate;
    // The smaller rotation angle that zeroes apq: tan = b / (|d| + hypot(d, b)), with the sign of d.
    const R d = aqq - app, b = R(2) * apq;
    const R long_side = absolute(d) + square_root(plus_product(d * d, b, b));
    const R scale = R(1) / select(rotate, square_root(plus_product(long_side * long_side, b, b)), R(1));
    const R c = select(rotate, scale * long_side, R(1));
    const R s = select(rotate, scale * select(d < R(0), -b, b), R(0));
    for (Mat3<R>* A : {&B, &V})
        for (int i = 0; i < 3; ++i) {
            const R ap = A->m[i][p], aq = A->m[i][q];
            A->m[i][p] = product_less(c, ap, s * aq);
            A->m[i][q] = plus_product(s * ap, c, aq);
        }
}

/// Swaps columns p and q where the second is longer; one column changes sign so that det V stays +1.
template <class R>
inline void order_columns(Mat3<R>& B, Mat3<R>& V, int p, int q) {
    const Vec3<R> bp = B.column(p), bq = B.column(q);
    const MaskOf<R> swap = dot(bp, bp) < dot(bq, bq);
    if (!any(swap)) return;
    for (Mat3<R>* A : {&B, &V})
        for (int i = 0; i < 3; ++i) {
            const R ap = A->m[i][p], aq = A->m[i][q];
            A->m[i][p] = select(swap, aq, ap);
            A->m[i][q] = select(swap, -ap, aq);
        }
}

/// A unit vector orthogonal to the unit vector a.
template <class R>
inline Vec3<R> any_orthogonal(const Vec3<R>& a) {
    const MaskOf<R> x_small = absolute(a.x) < R(ScalarOf<R>(0.6));
    const Vec3<R> e = select(x_small, Vec3<R>{R(1), R(0), R(0)}, Vec3<R>{R(0), R(1), R(0)});
    const Vec3<R> c = cross(a, e);
    return (R(1) / norm(c)) * c;
}

}  // namespace detail

/// One-sided Jacobi. Accurate for every F, of any rank and condition; `V_guess` (a rotation, for
/// example the V of the last step) only saves sweeps. Converged lanes are not touched by further
/// sweeps, so a lane's result does not depend on its neighbours.
template <class R>
inline SignedSvd<R> signed_svd(const Mat3<R>& F, const Mat3<R>& V_guess) {
    using S = ScalarOf<R>;
    // Scaled to a largest entry of 1: squares neither overflow nor vanish.
    R scale(0);
    for (int i = 0; i < 9; ++i) scale = maximum(absolute(F.m[i / 3][i % 3]), scale);
    const R safe_scale = select(scale > R(std::numeric_limits<S>::min() * S(1e10)), scale, R(1));
    // One Newton step towards orthogonality keeps a guess that is carried over many steps a rotation.
    Mat3<R> VtV = transpose(V_guess) * V_guess;
    Mat3<R> V = R(ScalarOf<R>(0.5)) * (V_guess * (R(3) * Mat3<R>::identity() - VtV));
    Mat3<R> B = ((R(1) / safe_scale) * F) * V;
    for (int sweep = 0; sweep < 12; ++sweep) {
        MaskOf<R> converged = R(0) <= R(0);
        detail::orthogonalise_columns(B, V, 0, 1, converged);
        detail::orthogonalise_columns(B, V, 0, 2, converged);
        detail::orthogonalise_columns(B, V, 1, 2, converged);
        if (all(converged)) break;
    }
    detail::order_columns(B, V, 0, 1);
    detail::order_columns(B, V, 0, 2);
    detail::order_columns(B, V, 1, 2);

    const R tiny(std::numeric_limits<S>::min() * S(1e10));
    const Vec3<R> b0 = B.column(0), b1 = B.column(1), b2 = B.column(2);
    const R n0 = norm(b0);
    const MaskOf<R> has0 = n0 > tiny;
    const Vec3<R> u0 = select(has0, (R(1) / select(has0, n0, R(1))) * b0, Vec3<R>{R(1), R(0), R(0)});
    const Vec3<R> b1_clean = b1 - dot(u0, b1) * u0;
    const R n1 = norm(b1_clean);
    const MaskOf<R> has1 = n1 > tiny;
    Vec3<R> u1 = select(has1, (R(1) / select(has1, n1, R(1))) * b1_clean, detail::any_orthogonal(u0));
    // What was left of b1 beside u0 may be mostly rounding: clean it once more.
    const MaskOf<R> doubtful = n1 < R(ScalarOf<R>(0.1)) * n0;
    if (any(doubtful)) {
        const Vec3<R> again = u1 - dot(u0, u1) * u0;
        u1 = select(doubtful, (R(1) / norm(again)) * again, u1);
    }
    const Vec3<R> u2 = cross(u0, u1);

    SignedSvd<R> svd;
    svd.U.set_column(0, u0);
    svd.U.set_column(1, u1);
    svd.U.set_column(2, u2);
    svd.V = V;
    svd.sigma = safe_scale * Vec3<R>{n0, dot(u1, b1), dot(u2, b2)};
    return svd;
}

template <class R>
inline SignedSvd<R> signed_svd(const Mat3<R>& F) {
    return signed_svd(F, Mat3<R>::identity());
}

/// The same for as many matrices as share one register, bit for bit.
template <class R>
inline void signed_svds(const Mat3<R>* F, const Mat3<R>* V_guess, int count, SignedSvd<R>* out) {
    using Whole = typename WholeRegister<R>::type;
    Mat3<Whole> packed = Mat3<Whole>::identity(), guess = Mat3<Whole>::identity();
    for (int e = 0; e < count; ++e)
        for (int i = 0; i < 9; ++i) {
            set_part(packed.m[i / 3][i % 3], e, F[e].m[i / 3][i % 3]);
            set_part(guess.m[i / 3][i % 3], e, V_guess[e].m[i / 3][i % 3]);
        }
    const SignedSvd<Whole> svd = signed_svd(packed, guess);
    for (int e = 0; e < count; ++e) {
        for (int i = 0; i < 9; ++i) {
            out[e].U.m[i / 3][i % 3] = get_part<R>(svd.U.m[i / 3][i % 3], e);
            out[e].V.m[i / 3][i % 3] = get_part<R>(svd.V.m[i / 3][i % 3], e);
        }
        for (int i = 0; i < 3; ++i) out[e].sigma[i] = get_part<R>(svd.sigma[i], e);
    }
}

}  // namespace palpate
