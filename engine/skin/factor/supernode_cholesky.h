#pragma once
// Numeric supernodal Cholesky of one finger alone: rows of a panel side by side in a register. Every number goes
// through the same operations in the same order as in block_cholesky.h, so that a finger is the same bits alone or
// beside others.

#include <algorithm>

#include "engine/skin/factor/block_cholesky.h"
#include "engine/skin/factor/supernodes.h"

namespace palpate {

namespace detail {

/// C columns of the target (one block column, or two), `rows` scalars each, minus the products of `columns` block
/// columns of the source with the transposed blocks in their rows from `block_row` on.
template <class V, int C, class T>
inline void subtract_products(T* target, std::size_t target_stride, const T* source, std::size_t source_stride,
                              int columns, int rows, int block_row = 0) {
    constexpr int W = lane_width<V>;
    auto strip = [&](int row, auto count) {
        constexpr int N = decltype(count)::value;
        V S[N][C];
        for (int n = 0; n < N; ++n)
            for (int c = 0; c < C; ++c) S[n][c] = load<V>(target + std::size_t(c) * target_stride + row + n * W);
        const T* a = source;
        for (int k = 0; k < columns; ++k, a += 3 * source_stride) {
            for (int m = 0; m < 3; ++m) {  // one at a time: sixteen registers hold no more than what this needs
                const T* column = a + std::size_t(m) * source_stride;
                V A[N];
                for (int n = 0; n < N; ++n) A[n] = load<V>(column + row + n * W);
                for (int c = 0; c < C; ++c) {
                    const V b(column[block_row + c]);
                    for (int n = 0; n < N; ++n) S[n][c] = less_product(S[n][c], A[n], b);
                }
            }
        }
        for (int n = 0; n < N; ++n)
            for (int c = 0; c < C; ++c) store(target + std::size_t(c) * target_stride + row + n * W, S[n][c]);
    };
    // Sums of a register wait for each other: nine of them, or twelve, keep a processor busy.
    constexpr int high = C == 3 ? 3 : 2;
    int row = 0;
    for (; row + (high - 1) * W < rows; row += high * W) strip(row, std::integral_constant<int, high>{});
    if (high == 3 && row + W < rows) return strip(row, std::integral_constant<int, 2>{});
    if (row < rows) strip(row, std::integral_constant<int, 1>{});
}

/// Whether two block columns, two registers of rows high, fit the registers: 32 of them, of 64 bytes.
template <class V>
inline constexpr bool many_registers = sizeof(V) == 64;

/// Applies one update to the target's panel by way of `work`, where the target's rows lie as the source has them. All
/// columns are gathered before the first is used: a register cannot be loaded at once from what was just stored in
/// parts. Where there are registers enough, two block columns are updated at once: the source, which need not fit the
/// nearest cache, is read half as often.
template <class V, class T>
inline void apply_update(const SupernodeFactor& f, const SupernodeUpdate& u, const Supernode& target, T* panels,
                         T* work) {
    constexpr int W = lane_width<V>;
    const Supernode& source = f.supernodes[u.source];
    const int* place = &f.target_rows[u.first_target_row];
    const RowRun *first = &f.runs[u.first_run], *last = first + u.run_count;
    const int count = source.row_count - u.begin, columns = u.end - u.begin;
    const std::size_t width = target.stride, stride = std::size_t(3 * count + 2 * 16);
    // What lies together in one column does so in all.
    auto for_each_column = [&](const RowRun& r, auto copy) {
        T* in_panel = panels + target.panel + 3 * r.target;
        T* in_work = work + 3 * r.source;
        for (int t = 0; t < columns; ++t) {
            T *p = in_panel + std::size_t(3 * place[t]) * width, *w = in_work + std::size_t(3 * t) * stride;
            copy(p, w), copy(p + width, w + stride), copy(p + 2 * width, w + 2 * stride);
        }
    };
    for (const RowRun* r = first; r != last; ++r) {  // what is copied past the end of a run the next overwrites
        const int scalars = 3 * r->count;
        if (scalars <= W)
            for_each_column(*r, [](const T* p, T* w) { store(w, load<V>(p)); });
        else
            for_each_column(*r, [=](const T* p, T* w) {
                for (int i = 0; i < scalars; i += W) store(w + i, load<V>(p + i));
            });
    }
    for (int t = 0; t < columns;) {
        T* to = work + std::size_t(3 * t) * stride + 3 * t;
        const T* from = panels + source.panel + 3 * (u.begin + t);
        if (many_registers<V> && t + 1 < columns) {  // what the second has above its diagonal is never read
            subtract_products<V, 6>(to, stride, from, source.stride, source.column_count, 3 * (count - t));
            t += 2;
        } else {
            subtract_products<V, 3>(to, stride, from, source.stride, source.column_count, 3 * (count - t));
            t += 1;
        }
    }
    for (const RowRun* r = first; r != last; ++r) {
        const int scalars = 3 * r->count;
        if (scalars < W)
            for_each_column(*r, [=](T* p, const T* w) { copy_triples<V>(p, w, scalars); });
        else
            for_each_column(*r, [=](T* p, const T* w) {
                for (int i = 0; i + W < scalars; i += W) store(p + i, load<V>(w + i));
                store(p + scalars - W, load<V>(w + scalars - W));
            });
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
    auto divide = [&](int j) {
        const int first = 3 * j / W * W;
        T* column = panel + std::size_t(3 * j) * stride;
        Mat3<R> S;
        for (int i = 0; i < 9; ++i) S.m[i / 3][i % 3] = R(column[std::size_t(i % 3) * stride + 3 * j + i / 3]);
        const Mat3<R> L = factor_diagonal(S, bad_pivots);
        const V l00(lane(L[0][0], 0)), l10(lane(L[1][0], 0)), l11(lane(L[1][1], 0)), l20(lane(L[2][0], 0)),
            l21(lane(L[2][1], 0)), l22(lane(L[2][2], 0));
        for (int i = first; i < rows; i += W) {
            const V x0 = load<V>(column + i) * l00;
            const V x1 = less_product(load<V>(column + stride + i), x0, l10) * l11;
            const V x2 = less_product(less_product(load<V>(column + 2 * stride + i), x0, l20), x1, l21) * l22;
            store(column + i, x0);
            store(column + stride + i, x1);
            store(column + 2 * stride + i, x2);
        }
        for (int i = 0; i < 9; ++i) column[std::size_t(i % 3) * stride + 3 * j + i / 3] = lane(L.m[i / 3][i % 3], 0);
    };
    // Column j minus the products of columns from `from` on.
    auto subtract = [&](auto count, int j, int from) {
        const int first = 3 * j / W * W;
        subtract_products<V, decltype(count)::value>(panel + std::size_t(3 * j) * stride + first, stride,
                                                     panel + std::size_t(3 * from) * stride + first, stride, j - from,
                                                     rows - first, 3 * j - first);
    };
    for (int j = 0; j < s.column_count; ++j) {
        if (many_registers<V> && j + 1 < s.column_count) {
            subtract(std::integral_constant<int, 6>{}, j, 0);
            divide(j);
            subtract(std::integral_constant<int, 3>{}, j + 1, j);
            ++j;
        } else {
            subtract(std::integral_constant<int, 3>{}, j, 0);
        }
        divide(j);
    }
}

/// Whether a column of a supernode is marked.
inline bool is_changed(const Supernode& s, const unsigned char* changed) {
    if (!changed) return true;
    const unsigned char* first = changed + s.first_column;
    return std::any_of(first, first + s.column_count, [](unsigned char mark) { return mark != 0; });
}

/// Factors one supernode; wait(source) is called before what an earlier one holds is read.
template <class R, class Wait>
inline void factor_supernode(const SupernodeFactor& f, const BlockPattern& p, const Supernode& s,
                             const ScalarOf<R>* blocks, ScalarOf<R>* panels, ScalarOf<R>* work, R& bad_pivots,
                             const Wait& wait) {
    using T = ScalarOf<R>;
    using V = typename RowLanes<R>::type;
    T* panel = panels + s.panel;
    std::fill(panel, panel + std::size_t(3 * s.column_count) * s.stride, T(0));
    for (int b = p.column_start[s.first_column]; b < p.column_start[s.first_column + s.column_count]; ++b) {
        if (!p.in_matrix(b)) continue;
        const T* from = blocks + 9 * std::size_t(b);
        T* to = panels + f.block_offset[b];
        for (int i = 0; i < 9; ++i) to[std::size_t(i % 3) * s.stride + i / 3] = from[i];
    }
    for (int u = s.first_update; u < s.first_update + s.update_count; ++u) {
        wait(f.updates[u].source);
        apply_update<V>(f, f.updates[u], s, panels, work);
    }
    factor_panel<V, R>(s, panel, bad_pivots);
}

}  // namespace detail

/// Factors the blocks of `p` into `panels` (panel_scalars), as factor_blocks does: where no column of a supernode is
/// marked, it stays.
template <class R>
inline R factor_supernodes(const SupernodeFactor& f, const BlockPattern& p, const ScalarOf<R>* blocks,
                           ScalarOf<R>* panels, ScalarOf<R>* work, const unsigned char* changed = nullptr) {
    R bad_pivots(0);
    for (const Supernode& s : f.supernodes)
        if (detail::is_changed(s, changed))
            detail::factor_supernode<R>(f, p, s, blocks, panels, work, bad_pivots, [](int) {});
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
            Vec3<R> own{R(y[0]), R(y[1]), R(y[2])};
            const R o(0);
            detail::solve_lower(Mat3<R>{{{R(c0[3 * j]), o, o},
                                         {R(c0[3 * j + 1]), R(c1[3 * j + 1]), o},
                                         {R(c0[3 * j + 2]), R(c1[3 * j + 2]), R(c2[3 * j + 2])}}},
                                own);
            y[0] = lane(own.x, 0), y[1] = lane(own.y, 0), y[2] = lane(own.z, 0);
            const V y0(y[0]), y1(y[1]), y2(y[2]);
            for (int i = 3 * (j + 1); i < 3 * s.row_count; i += W)
                store(work + i, less_product(less_product(less_product(load<V>(work + i), load<V>(c0 + i), y0),
                                                          load<V>(c1 + i), y1),
                                             load<V>(c2 + i), y2));
        }
        for (int i = 0; i < s.row_count; ++i)
            std::memcpy(b + 3 * std::size_t(f.rows[s.first_row + i]), work + 3 * i, 3 * sizeof(T));
    }
}

namespace detail {

/// (v[k] + v[k+1]) + v[k+2] in every lane k but the last two.
template <class V>
inline V sums_of_threes(const V& v) {
    return [&]<std::size_t... k>(std::index_sequence<k...>) {
        constexpr int W = sizeof...(k);
        const V next(__builtin_shufflevector(v.v, v.v, int(k + 1) % W...));
        const V last(__builtin_shufflevector(v.v, v.v, int(k + 2) % W...));
        return v + next + last;
    }
    (std::make_index_sequence<std::size_t(lane_width<V>)>{});
}

/// y[c] minus the products of column c of a panel with x, in `rows` block rows. As many rows as a register takes are
/// multiplied and added up at once; what is subtracted is so in the order of the rows.
template <class V, class T>
inline void subtract_column_products(T* y, const T* column, std::size_t stride, const T* x, int rows) {
    constexpr int W = lane_width<V>, together = W / 3;
    if constexpr (together < 2) {
        for (int i = 0; i < 3 * rows; i += 3)
            for (int c = 0; c < 3; ++c) {
                const T* a = column + std::size_t(c) * stride + i;
                y[c] -= a[0] * x[i] + a[1] * x[i + 1] + a[2] * x[i + 2];
            }
    } else {
        alignas(64) T sums[3][W];
        T y0 = y[0], y1 = y[1], y2 = y[2];
        for (int row = 0; row < rows; row += together) {
            const V of_x = load<V>(x + 3 * row);
            for (int c = 0; c < 3; ++c)
                store(sums[c], sums_of_threes(load<V>(column + std::size_t(c) * stride + 3 * row) * of_x));
            auto subtract = [&](int k) { y0 -= sums[0][3 * k], y1 -= sums[1][3 * k], y2 -= sums[2][3 * k]; };
            if (rows - row >= together) {
                for (int k = 0; k < together; ++k) subtract(k);
            } else {
                for (int k = 0; k < rows - row; ++k) subtract(k);
            }
        }
        y[0] = y0, y[1] = y1, y[2] = y2;
    }
}

}  // namespace detail

/// Solves L^T y = b in place.
template <class R>
inline void solve_supernodes_backward(const SupernodeFactor& f, const ScalarOf<R>* panels, ScalarOf<R>* b,
                                      ScalarOf<R>* work) {
    using T = ScalarOf<R>;
    using V = typename RowLanes<R>::type;
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
            // The supernode's own rows have just been stored one by one: a register cannot be loaded from them at once.
            const int own = s->column_count - j - 1, below = s->row_count - s->column_count;
            detail::subtract_column_products<Lanes<T, 1, 0>>(y, c0 + 3 * (j + 1), s->stride, y + 3, own);
            const int first = 3 * s->column_count;
            detail::subtract_column_products<V>(y, c0 + first, s->stride, work + first, below);
            const R y2 = R(y[2]) * R(c2[3 * j + 2]);
            const R y1 = less_product(R(y[1]), R(c1[3 * j + 2]), y2) * R(c1[3 * j + 1]);
            const R y0 = less_product(less_product(R(y[0]), R(c0[3 * j + 1]), y1), R(c0[3 * j + 2]), y2) * R(c0[3 * j]);
            y[0] = lane(y0, 0), y[1] = lane(y1, 0), y[2] = lane(y2, 0);
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
