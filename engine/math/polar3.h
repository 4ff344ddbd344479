#pragma once
// Polar decomposition of 3x3 matrices and the positive part of symmetric ones, over lanes, by iterations that divide
// once or not at all: cheaper than a singular value decomposition, whose operations wait for each other.

#include <limits>

#include "engine/math/svd3.h"

namespace palpate {

/// A symmetric 3x3 matrix.
template <class R>
struct Symmetric3 {
    R xx, xy, yy, xz, yz, zz;

    friend Symmetric3 operator+(const Symmetric3& a, const Symmetric3& b) {
        return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy, a.xz + b.xz, a.yz + b.yz, a.zz + b.zz};
    }
    friend Symmetric3 operator-(const Symmetric3& a, const Symmetric3& b) {
        return {a.xx - b.xx, a.xy - b.xy, a.yy - b.yy, a.xz - b.xz, a.yz - b.yz, a.zz - b.zz};
    }
    friend Symmetric3 operator*(const R& s, const Symmetric3& a) {
        return {s * a.xx, s * a.xy, s * a.yy, s * a.xz, s * a.yz, s * a.zz};
    }
};

template <class R>
inline Symmetric3<R> select(MaskOf<R> m, const Symmetric3<R>& a, const Symmetric3<R>& b) {
    return {select(m, a.xx, b.xx), select(m, a.xy, b.xy), select(m, a.yy, b.yy),
            select(m, a.xz, b.xz), select(m, a.yz, b.yz), select(m, a.zz, b.zz)};
}
/// s I + a.
template <class R>
inline Symmetric3<R> plus_diagonal(const R& s, const Symmetric3<R>& a) {
    return {s + a.xx, a.xy, s + a.yy, a.xz, a.yz, s + a.zz};
}
template <class R>
inline R trace(const Symmetric3<R>& a) {
    return a.xx + a.yy + a.zz;
}
/// a b where the two commute, so that the product is symmetric, too.
template <class R>
inline Symmetric3<R> commuting_product(const Symmetric3<R>& a, const Symmetric3<R>& b) {
    const Vec3<R> ax{a.xx, a.xy, a.xz}, ay{a.xy, a.yy, a.yz}, az{a.xz, a.yz, a.zz}, bx{b.xx, b.xy, b.xz},
        by{b.xy, b.yy, b.yz}, bz{b.xz, b.yz, b.zz};
    return {dot(ax, bx), dot(ay, bx), dot(ay, by), dot(az, bx), dot(az, by), dot(az, bz)};
}

/// Whether a is positive definite (Sylvester's criterion).
template <class R>
inline MaskOf<R> positive_definite(const Symmetric3<R>& a) {
    const R zero(0), second = product_less(a.xx, a.yy, a.xy * a.xy);
    const R p = product_less(a.xz, a.yy, a.xy * a.yz), q = product_less(a.xx, a.yz, a.xy * a.xz);
    const R determinant = less_product(less_product(second * a.zz, q, a.yz), p, a.xz);
    return (a.xx > zero) & (second > zero) & (determinant > zero);
}

/// The inverse of a matrix whose determinant is positive: of one that is below `least`, as if it were that.
template <class R>
inline Symmetric3<R> inverse_of_positive(const Symmetric3<R>& a, const R& least) {
    const Symmetric3<R> cofactors{product_less(a.yy, a.zz, a.yz * a.yz), product_less(a.xz, a.yz, a.xy * a.zz),
                                  product_less(a.xx, a.zz, a.xz * a.xz), product_less(a.xy, a.yz, a.xz * a.yy),
                                  product_less(a.xy, a.xz, a.xx * a.yz), product_less(a.xx, a.yy, a.xy * a.xy)};
    const R determinant = plus_product(plus_product(a.xx * cofactors.xx, a.xy, cofactors.xy), a.xz, cofactors.xz);
    return (R(1) / maximum(determinant, least)) * cofactors;
}

/// A matrix that is not less than the positive part of a (its negative eigenvalues made zero), and more by at most
/// `positive_part_excess` times a's largest row sum r: (a + r/2)^2 / 2r. For max(x, 0) = (x + |x|) / 2, and x^2 + 1/8
/// is the parabola nearest to |x| on [-1, 1], within 1/8 of it.
inline constexpr double positive_part_excess = 0.125;
template <class R>
inline Symmetric3<R> positive_part_bound(const Symmetric3<R>& a) {
    using T = ScalarOf<R>;
    const R xy = absolute(a.xy), xz = absolute(a.xz), yz = absolute(a.yz), half = R(T(0.5));
    const R size = maximum(maximum(absolute(a.xx) + xy + xz, absolute(a.yy) + xy + yz), absolute(a.zz) + xz + yz);
    const R inverse = R(1) / maximum(size, R(std::numeric_limits<T>::min() * T(1e10)));
    const Symmetric3<R> shifted = plus_diagonal(half, inverse * a);
    return (half * size) * commuting_product(shifted, shifted);
}

namespace detail {

/// Where Newton's iterations towards a nearest rotation (Higham 1986) stand.
template <class R>
struct RotationSearch {
    MaskOf<R> upright = R(0) <= R(0), running = upright;
};

/// Iteration k: next = (Q + Q^-T) / 2; both may be one. From the second on no singular value is below one, and the
/// determinant says how far they are from it. Lanes that are done are not touched, so that none depends on its
/// neighbours.
template <class R>
inline void search_on(RotationSearch<R>& s, int k, const Mat3<R>& Q, Mat3<R>& next) {
    using T = ScalarOf<R>;
    constexpr int unchecked = 2;
    const R half = R(T(0.5)), done_below = R(std::is_same_v<T, double> ? T(2e-8) : T(5e-4));
    Mat3<R> C;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int p = (i + 1) % 3, q = (i + 2) % 3, u = (j + 1) % 3, v = (j + 2) % 3;
            C.m[i][j] = product_less(Q.m[p][u], Q.m[q][v], Q.m[p][v] * Q.m[q][u]);
        }
    const R determinant = plus_product(plus_product(Q.m[0][0] * C.m[0][0], Q.m[0][1], C.m[0][1]), Q.m[0][2], C.m[0][2]);
    if (k == 0) s.upright = determinant > R(T(0.05));
    const R inverse = half / determinant;
    for (int i = 0; i < 9; ++i) {
        const R of_Q = Q.m[i / 3][i % 3], of_next = plus_product(half * of_Q, inverse, C.m[i / 3][i % 3]);
        next.m[i / 3][i % 3] = k <= unchecked ? of_next : select(s.running, of_next, of_Q);
    }
    if (k >= unchecked) s.running = s.running & s.upright & !MaskOf<R>(determinant - R(1) <= done_below);
}

}  // namespace detail

inline constexpr int rotations_at_once = 4;

/// The rotations out(e) nearest to up to four matrices F(e), U V^T of their signed singular value decompositions; what
/// is flat or inverted is decomposed. Operations of one search wait for each other: those of others go between.
/// (Matrices stay where they are: copied whole, they would be copied by a function of the library's.)
template <class R, class From, class To>
inline void nearest_rotations(int count, From F, To out) {
    constexpr int most = 10;
    detail::RotationSearch<R> search[rotations_at_once];
    bool busy = true;
    for (int k = 0; k < most && busy; ++k) {
        busy = false;
        for (int e = 0; e < count; ++e) {
            if (k > 0 && !any(search[e].running)) continue;
            detail::search_on<R>(search[e], k, k == 0 ? F(e) : out(e), out(e));
            busy = busy || any(search[e].running);
        }
    }
    for (int e = 0; e < count; ++e) {
        const MaskOf<R> decomposed = search[e].running | !search[e].upright;
        if (!any(decomposed)) continue;
        const SignedSvd<R> svd = signed_svd(F(e));
        out(e) = select(decomposed, times_transposed(svd.U, svd.V), out(e));
    }
}
template <class R>
inline Mat3<R> nearest_rotation(const Mat3<R>& F) {
    Mat3<R> rotation;
    nearest_rotations<R>(
        1, [&](int) -> const Mat3<R>& { return F; }, [&](int) -> Mat3<R>& { return rotation; });
    return rotation;
}

}  // namespace palpate
