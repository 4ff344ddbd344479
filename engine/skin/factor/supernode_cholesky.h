#pragma once
// Numeric supernodal Cholesky of one finger alone: rows of a panel side by side in a register. Every number goes
// through the same operations in the same order as in block_cholesky.h, so that a finger is the same bits alone or
// beside others.

#include <algorithm>

#include "engine/skin/factor/block_cholesky.h"
#include "engine/skin/factor/supernodes.h"

namespace palpate {

namespace detail {

/// Three columns of the target, `rows` scalars each, minus the products of `columns` block columns of the source with
/// the transposed 3x3 blocks in their rows from `block_row` on.
template <class V, class T>
inline void subtract_products(T* target, std::size_t target_stride, const T* source, std::size_t source_stride,
                              int columns, int rows, int block_row = 0) {
    constexpr int W = lane_width<V>;
    auto strip = [&](int row, auto count) {
        constexpr int N = decltype(count)::value;
        V S[N][3];
        for (int n = 0; n < N; ++n)
            for (int c = 0; c < 3; ++c) S[n][c] = load<V>(target + std::size_t(c) * target_stride + row + n * W);
        const T* a = source;
        for (int k = 0; k < columns; ++k, a += 3 * source_stride) {
            V A[N][3];
            for (int n = 0; n < N; ++n)
                for (int m = 0; m < 3; ++m) A[n][m] = load<V>(a + std::size_t(m) * source_stride + row + n * W);
            for (int c = 0; c < 3; ++c) {
                const T* b = a + block_row + c;
                const V b0(b[0]), b1(b[source_stride]), b2(b[2 * source_stride]);
                for (int n = 0; n < N; ++n) S[n][c] -= A[n][0] * b0 + A[n][1] * b1 + A[n][2] * b2;
            }
        }
        for (int n = 0; n < N; ++n)
            for (int c = 0; c < 3; ++c) store(target + std::size_t(c) * target_stride + row + n * W, S[n][c]);
    };
    int row = 0;
    for (; row + W < rows; row += 2 * W) strip(row, std::integral_constant<int, 2>{});
    if (row < rows) strip(row, std::integral_constant<int, 1>{});
}

/// Applies one update to the target's panel by way of `work`, where the target's rows lie as the source has them. All
/// columns are gathered before the first is used: a register cannot be loaded at once from what was just stored in
/// parts.
template <class V, class T>
inline void apply_update(const SupernodeFactor& f, const SupernodeUpdate& u, const Supernode& target, T* panels,
                         T* work) {
    const Supernode& source = f.supernodes[u.source];
    const int* place = &f.target_rows[u.first_target_row];
    const int count = source.row_count - u.begin;
    const std::size_t width = target.stride, stride = std::size_t(3 * count + 2 * 16);
    auto column = [&](int t) { return panels + target.panel + std::size_t(3 * place[t - u.begin]) * width; };
    for (int t = u.begin; t < u.end; ++t)
        for (int c = 0; c < 3; ++c) {
            const T* from = column(t) + c * width;
            T* to = work + std::size_t(3 * (t - u.begin) + c) * stride;
            for (int i = t - u.begin; i < count; ++i) std::memcpy(to + 3 * i, from + 3 * place[i], 3 * sizeof(T));
        }
    for (int t = u.begin; t < u.end; ++t)
        subtract_products<V>(work + std::size_t(3 * (t - u.begin)) * stride + 3 * (t - u.begin), stride,
                             panels + source.panel + 3 * t, source.stride, source.column_count,
                             3 * (source.row_count - t));
    for (int t = u.begin; t < u.end; ++t)
        for (int c = 0; c < 3; ++c) {
            const T* from = work + std::size_t(3 * (t - u.begin) + c) * stride;
            T* to = column(t) + c * width;
            for (int i = t - u.begin; i < count; ++i) std::memcpy(to + 3 * place[i], from + 3 * i, 3 * sizeof(T));
        }
}

/// Factors the panel of a supernode that has got all its updates. Registers cover the same rows in every column, from
/// above the diagonal if need be: what lies there is never read.
template <class V, class R>
inline void factor_panel(const Supernode& s, ScalarOf<R>* panel, R& bad_pivots) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<V>;
    const std::size_t stride = s.stride;
    const int rows = 3 * s.row_count;
    for (int j = 0; j < s.column_count; ++j) {
        T* column = panel + std::size_t(3 * j) * stride;
        const int first = 3 * j / W * W;
        subtract_products<V>(column + first, stride, panel + first, stride, j, rows - first, 3 * j - first);
        Mat3<R> S;
        for (int i = 0; i < 9; ++i) S.m[i / 3][i % 3] = R(column[std::size_t(i % 3) * stride + 3 * j + i / 3]);
        const Mat3<R> L = factor_diagonal(S, bad_pivots);
        const V l00(lane(L[0][0], 0)), l10(lane(L[1][0], 0)), l11(lane(L[1][1], 0)), l20(lane(L[2][0], 0)),
            l21(lane(L[2][1], 0)), l22(lane(L[2][2], 0));
        for (int i = first; i < rows; i += W) {
            const V x0 = load<V>(column + i) * l00;
            const V x1 = (load<V>(column + stride + i) - x0 * l10) * l11;
            const V x2 = (load<V>(column + 2 * stride + i) - x0 * l20 - x1 * l21) * l22;
            store(column + i, x0);
            store(column + stride + i, x1);
            store(column + 2 * stride + i, x2);
        }
        for (int i = 0; i < 9; ++i) column[std::size_t(i % 3) * stride + 3 * j + i / 3] = lane(L.m[i / 3][i % 3], 0);
    }
}

}  // namespace detail

/// Factors the blocks of `p` into `panels` (panel_scalars), as factor_blocks does: where no column of a supernode is
/// marked, it stays.
template <class R>
inline R factor_supernodes(const SupernodeFactor& f, const BlockPattern& p, const ScalarOf<R>* blocks,
                           ScalarOf<R>* panels, ScalarOf<R>* work, const unsigned char* changed = nullptr) {
    using T = ScalarOf<R>;
    using V = typename RowLanes<R>::type;
    R bad_pivots(0);
    for (const Supernode& s : f.supernodes) {
        const unsigned char* first = changed + s.first_column;
        if (changed && std::none_of(first, first + s.column_count, [](unsigned char mark) { return mark != 0; }))
            continue;
        T* panel = panels + s.panel;
        std::fill(panel, panel + std::size_t(3 * s.column_count) * s.stride, T(0));
        for (int b = p.column_start[s.first_column]; b < p.column_start[s.first_column + s.column_count]; ++b) {
            if (!p.in_matrix(b)) continue;
            const T* from = blocks + 9 * std::size_t(b);
            T* to = panels + f.block_offset[b];
            for (int i = 0; i < 9; ++i) to[std::size_t(i % 3) * s.stride + i / 3] = from[i];
        }
        for (int u = s.first_update; u < s.first_update + s.update_count; ++u)
            detail::apply_update<V>(f, f.updates[u], s, panels, work);
        detail::factor_panel<V, R>(s, panel, bad_pivots);
    }
    return bad_pivots;
}

/// Solves L y = b in place; b is [column][xyz] in elimination order.
template <class R>
inline void solve_supernodes_forward(const SupernodeFactor& f, const ScalarOf<R>* panels, ScalarOf<R>* b,
                                     ScalarOf<R>* work) {
    using T = ScalarOf<R>;
    using V = typename RowLanes<R>::type;
    constexpr int W = lane_width<V>;
    auto gather = [&](const Supernode& s) {
        for (int i = 0; i < s.row_count; ++i)
            std::memcpy(work + 3 * i, b + 3 * std::size_t(f.rows[s.first_row + i]), 3 * sizeof(T));
    };
    for (const Supernode& s : f.supernodes) {
        gather(s);
        if (std::all_of(work, work + 3 * s.column_count, [](T y) { return y == T(0); })) continue;
        for (int j = 0; j < s.column_count; ++j) {
            const T* c0 = panels + s.panel + std::size_t(3 * j) * s.stride;
            const T *c1 = c0 + s.stride, *c2 = c1 + s.stride;
            T* y = work + 3 * j;
            y[0] = y[0] * c0[3 * j];
            y[1] = (y[1] - c0[3 * j + 1] * y[0]) * c1[3 * j + 1];
            y[2] = (y[2] - c0[3 * j + 2] * y[0] - c1[3 * j + 2] * y[1]) * c2[3 * j + 2];
            const V y0(y[0]), y1(y[1]), y2(y[2]);
            for (int i = 3 * (j + 1); i < 3 * s.row_count; i += W)
                store(work + i,
                      load<V>(work + i) - (load<V>(c0 + i) * y0 + load<V>(c1 + i) * y1 + load<V>(c2 + i) * y2));
        }
        for (int i = 0; i < s.row_count; ++i)
            std::memcpy(b + 3 * std::size_t(f.rows[s.first_row + i]), work + 3 * i, 3 * sizeof(T));
    }
}

/// Solves L^T y = b in place.
template <class R>
inline void solve_supernodes_backward(const SupernodeFactor& f, const ScalarOf<R>* panels, ScalarOf<R>* b,
                                      ScalarOf<R>* work) {
    using T = ScalarOf<R>;
    auto gather = [&](const Supernode& s) {
        for (int i = 0; i < s.row_count; ++i)
            std::memcpy(work + 3 * i, b + 3 * std::size_t(f.rows[s.first_row + i]), 3 * sizeof(T));
    };
    for (auto s = f.supernodes.rbegin(); s != f.supernodes.rend(); ++s) {
        gather(*s);
        for (int j = s->column_count - 1; j >= 0; --j) {
            const T* c0 = panels + s->panel + std::size_t(3 * j) * s->stride;
            const T *c1 = c0 + s->stride, *c2 = c1 + s->stride;
            T* y = work + 3 * j;
            for (int i = 3 * (j + 1); i < 3 * s->row_count; i += 3) {
                const T *a = c0 + i, *d = c1 + i, *e = c2 + i, *x = work + i;
                y[0] -= a[0] * x[0] + a[1] * x[1] + a[2] * x[2];
                y[1] -= d[0] * x[0] + d[1] * x[1] + d[2] * x[2];
                y[2] -= e[0] * x[0] + e[1] * x[1] + e[2] * x[2];
            }
            y[2] = y[2] * c2[3 * j + 2];
            y[1] = (y[1] - c1[3 * j + 2] * y[2]) * c1[3 * j + 1];
            y[0] = (y[0] - c0[3 * j + 1] * y[1] - c0[3 * j + 2] * y[2]) * c0[3 * j];
        }
        std::memcpy(b + 3 * std::size_t(s->first_column), work, std::size_t(3 * s->column_count) * sizeof(T));
    }
}

/// Solves L L^T y = b in place.
template <class R>
inline void solve_supernodes(const SupernodeFactor& f, const ScalarOf<R>* panels, ScalarOf<R>* b, ScalarOf<R>* work) {
    solve_supernodes_forward<R>(f, panels, b, work);
    solve_supernodes_backward<R>(f, panels, b, work);
}

}  // namespace palpate
