#pragma once
// Cholesky factorisation of a symmetric matrix of 3x3 blocks, over lanes: every lane is one matrix,
// all with the same pattern. Blocks are [block][row][column][lane]. Left-looking by block columns (George and Liu,
// Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 5).

#include <limits>

#include "engine/math/linear_algebra.h"
#include "engine/skin/chunks/topology.h"

namespace palpate {

namespace detail {

/// Lower Cholesky factor of a 3x3 block; the diagonal holds reciprocals. A pivot that is not
/// positive is replaced by a tiny one and counted.
template <class R>
inline Mat3<R> factor_diagonal(const Mat3<R>& S, R& bad_pivots) {
    using T = ScalarOf<R>;
    Mat3<R> L = Mat3<R>::zero();
    const R floor = R(std::numeric_limits<T>::epsilon()) * (absolute(S[0][0]) + absolute(S[1][1]) + absolute(S[2][2])) +
                    R(std::numeric_limits<T>::min() * T(1e10));
    for (int j = 0; j < 3; ++j) {
        R pivot = S[j][j];
        for (int k = 0; k < j; ++k) pivot = less_product(pivot, L[j][k], L[j][k]);
        const MaskOf<R> good = pivot > floor;
        bad_pivots += select(good, R(0), R(1));
        L[j][j] = R(1) / square_root(select(good, pivot, floor));
        for (int i = j + 1; i < 3; ++i) {
            R s = S[i][j];
            for (int k = 0; k < j; ++k) s = less_product(s, L[i][k], L[j][k]);
            L[i][j] = s * L[j][j];
        }
    }
    return L;
}

/// X with X L^T = S, for the factored diagonal block L.
template <class R>
inline Mat3<R> solve_right_transposed(const Mat3<R>& S, const Mat3<R>& L) {
    Mat3<R> X;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            R s = S[i][j];
            for (int k = 0; k < j; ++k) s = less_product(s, X[i][k], L[j][k]);
            X[i][j] = s * L[j][j];
        }
    return X;
}

}  // namespace detail

namespace detail {

/// S -= A B^T for blocks of memory: S and what one product of a column and a row needs fit into sixteen registers, and
/// each number is loaded once. Sums are those of subtract_products (supernode_cholesky.h). Of a diagonal block, what is
/// above it is left out.
template <bool diagonal, class R>
inline void subtract_product_transposed(R (&S)[9], const ScalarOf<R>* A, const ScalarOf<R>* B) {
    constexpr int W = lane_width<R>;
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k) {
        const R a[3] = {load<R>(A + k * W), load<R>(A + (3 + k) * W), load<R>(A + (6 + k) * W)};
#pragma GCC unroll 3
        for (int j = 0; j < 3; ++j) {
            const R b = load<R>(B + (3 * j + k) * W);
#pragma GCC unroll 3
            for (int i = diagonal ? j : 0; i < 3; ++i) S[3 * i + j] = less_product(S[3 * i + j], a[i], b);
        }
    }
}

/// Block b of the matrix minus its updates by the factor so far.
template <bool diagonal, class R>
inline Mat3<R> updated_block(const BlockPattern& p, const ScalarOf<R>* blocks, const ScalarOf<R>* factor, int b) {
    constexpr int W = lane_width<R>;
    R S[9];
    const bool in_matrix = p.in_matrix(b);
#pragma GCC unroll 9
    for (int i = 0; i < 9; ++i) S[i] = in_matrix ? load<R>(blocks + (9 * static_cast<std::size_t>(b) + i) * W) : R(0);
    for (int u = p.update_start[b]; u < p.update_start[b + 1]; ++u)
        subtract_product_transposed<diagonal, R>(S, factor + static_cast<std::size_t>(p.update_a[u]) * 9 * W,
                                                 factor + static_cast<std::size_t>(p.update_b[u]) * 9 * W);
    return {{{S[0], S[1], S[2]}, {S[3], S[4], S[5]}, {S[6], S[7], S[8]}}};
}

}  // namespace detail

/// Marks the columns of a factor that change with those that are marked: all that they are eliminated into, which
/// are their ancestors in the elimination tree.
inline void mark_ancestors(const BlockPattern& p, unsigned char* changed) {
    for (int j = 0; j < p.columns; ++j)
        if (changed[j] != 0 && p.column_start[j] + 1 < p.column_start[j + 1]) changed[p.row[p.column_start[j] + 1]] = 1;
}

/// Factors `blocks` into `factor`. Left-looking: each block gathers its updates in registers and is written once.
/// `changed`: the columns that are not what they were in the last factorisation (mark_ancestors); null: all.
/// Returns per lane the number of pivots that had to be replaced in the columns that it has factored.
template <class R>
inline R factor_blocks(const BlockPattern& p, const ScalarOf<R>* blocks, ScalarOf<R>* factor,
                       const unsigned char* changed = nullptr) {
    constexpr int W9 = 9 * lane_width<R>;
    R bad_pivots(0);
    for (int j = 0; j < p.columns; ++j) {
        if (changed && changed[j] == 0) continue;
        const int first = p.column_start[j];
        const Mat3<R> diagonal =
            detail::factor_diagonal(detail::updated_block<true, R>(p, blocks, factor, first), bad_pivots);
        store_mat3<R>(factor + static_cast<std::size_t>(first) * W9, diagonal);
        for (int b = first + 1; b < p.column_start[j + 1]; ++b) {
            const Mat3<R> S = detail::updated_block<false, R>(p, blocks, factor, b);
            store_mat3<R>(factor + static_cast<std::size_t>(b) * W9, detail::solve_right_transposed(S, diagonal));
        }
    }
    return bad_pivots;
}

namespace detail {

/// y <- L^-1 y for a factored diagonal block.
template <class R>
inline void solve_lower(const Mat3<R>& L, Vec3<R>& y) {
    y.x = y.x * L[0][0];
    y.y = less_product(y.y, L[1][0], y.x) * L[1][1];
    y.z = less_product(less_product(y.z, L[2][0], y.x), L[2][1], y.y) * L[2][2];
}
/// v - A y, column after column of A.
template <class R>
inline Vec3<R> less_times(Vec3<R> v, const Mat3<R>& A, const Vec3<R>& y) {
    for (int i = 0; i < 3; ++i)
        v[i] = less_product(less_product(less_product(v[i], A[i][0], y.x), A[i][1], y.y), A[i][2], y.z);
    return v;
}
/// A^T v whose products are rounded, as where a register of them is added up across (sums_of_threes).
template <class R>
inline Vec3<R> transposed_times_unfused(const Mat3<R>& A, const Vec3<R>& v) {
    return {A[0][0] * v.x + A[1][0] * v.y + A[2][0] * v.z, A[0][1] * v.x + A[1][1] * v.y + A[2][1] * v.z,
            A[0][2] * v.x + A[1][2] * v.y + A[2][2] * v.z};
}

}  // namespace detail

/// Solves L y = b in place; b is [column][xyz][lane] in elimination order. Rows that are still zero are passed over.
template <class R>
inline void solve_blocks_forward(const BlockPattern& p, const ScalarOf<R>* factor, ScalarOf<R>* b) {
    constexpr int W3 = 3 * lane_width<R>, W9 = 9 * lane_width<R>;
    auto block = [&](int k) { return load_mat3<R>(factor + static_cast<std::size_t>(k) * W9); };
    for (int j = 0; j < p.columns; ++j) {
        Vec3<R> y = load_vec3<R>(b + j * W3);
        if (all((absolute(y.x) <= R(0)) & (absolute(y.y) <= R(0)) & (absolute(y.z) <= R(0)))) continue;
        const Mat3<R> L = block(p.column_start[j]);
        detail::solve_lower(L, y);
        store_vec3<R>(b + j * W3, y);
        for (int k = p.column_start[j] + 1; k < p.column_start[j + 1]; ++k) {
            ScalarOf<R>* target = b + p.row[k] * W3;
            store_vec3<R>(target, detail::less_times(load_vec3<R>(target), block(k), y));
        }
    }
}

/// The same for `count` right-hand sides, `stride` scalars apart, each block read once. Rows that are still zero in
/// every one of them are passed over.
template <int count, class R>
inline void solve_blocks_forward(const BlockPattern& p, const ScalarOf<R>* factor, ScalarOf<R>* b, std::size_t stride) {
    constexpr int W3 = 3 * lane_width<R>, W9 = 9 * lane_width<R>;
    auto block = [&](int k) { return load_mat3<R>(factor + static_cast<std::size_t>(k) * W9); };
    for (int j = 0; j < p.columns; ++j) {
        Vec3<R> y[count];
        R size(0);
        for (int c = 0; c < count; ++c) {
            y[c] = load_vec3<R>(b + c * stride + j * W3);
            size = maximum(size, maximum(absolute(y[c].x), maximum(absolute(y[c].y), absolute(y[c].z))));
        }
        if (!any(size > R(0))) continue;
        const Mat3<R> L = block(p.column_start[j]);
        for (int c = 0; c < count; ++c) {
            detail::solve_lower(L, y[c]);
            store_vec3<R>(b + c * stride + j * W3, y[c]);
        }
        for (int k = p.column_start[j] + 1; k < p.column_start[j + 1]; ++k) {
            const Mat3<R> B = block(k);
            for (int c = 0; c < count; ++c) {
                ScalarOf<R>* target = b + c * stride + p.row[k] * W3;
                store_vec3<R>(target, detail::less_times(load_vec3<R>(target), B, y[c]));
            }
        }
    }
}

/// Solves L^T y = b in place.
template <class R>
inline void solve_blocks_backward(const BlockPattern& p, const ScalarOf<R>* factor, ScalarOf<R>* b) {
    constexpr int W3 = 3 * lane_width<R>, W9 = 9 * lane_width<R>;
    auto block = [&](int k) { return load_mat3<R>(factor + static_cast<std::size_t>(k) * W9); };
    for (int j = p.columns - 1; j >= 0; --j) {
        Vec3<R> y = load_vec3<R>(b + j * W3);
        for (int k = p.column_start[j] + 1; k < p.column_start[j + 1]; ++k)
            y -= detail::transposed_times_unfused(block(k), load_vec3<R>(b + p.row[k] * W3));
        const Mat3<R> L = block(p.column_start[j]);
        y.z = y.z * L[2][2];
        y.y = less_product(y.y, L[2][1], y.z) * L[1][1];
        y.x = less_product(less_product(y.x, L[1][0], y.y), L[2][0], y.z) * L[0][0];
        store_vec3<R>(b + j * W3, y);
    }
}

/// Solves L L^T y = b in place.
template <class R>
inline void solve_blocks(const BlockPattern& p, const ScalarOf<R>* factor, ScalarOf<R>* b) {
    solve_blocks_forward<R>(p, factor, b);
    solve_blocks_backward<R>(p, factor, b);
}

}  // namespace palpate
