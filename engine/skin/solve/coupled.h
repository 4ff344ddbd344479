#pragma once
// A chunk's part in a solve that its fingers share with bodies (held objects). The bodies' unknowns y are condensed
// (static condensation, Guyan 1965: the Schur complement of the skin): with the Newton matrix [H B; B' C], each lane
// gives C - B' H^-1 B and the like, 6x6 per body that it touches; the bodies are solved on their sum, and the lanes
// then for themselves. engine/bodies/solve_bodies.cpp calls these in turn.

#include "engine/skin/chunks/rigid.h"
#include "engine/skin/solve/kernels.h"
#include "engine/skin/solve/solve_lanes.h"

namespace palpate {

namespace detail {

/// How contact between a sample and a body moves with the body: d(x_s - body) = dx_s + G dy, G = [-I, skew(arm)].
template <class R>
struct BodyMotion {
    Mat3<R> turn;  ///< skew(arm), arm from the body's centre of mass to the sample
    Vec3<R> times(const Vec3<R>& moved, const Vec3<R>& turned) const { return turn * turned - moved; }
};
template <class R>
inline BodyMotion<R> body_motion(const SkinChunk<ScalarOf<R>>& c, int slot, const Vec3<R>& x) {
    constexpr int W = lane_width<R>;
    return {skew(x - load_vec3<R>(&c.exchange.centre[3 * slot * W]))};
}

/// Calls visit(slot) for each slot that a body fills in some lane.
template <class T, class Visit>
inline void for_each_body_slot(const SkinChunk<T>& c, Visit visit) {
    for (int slot = 0; slot < c.contacts.used; ++slot)
        if (c.contacts.slot[std::size_t(slot)].body_lanes != 0) visit(slot);
}

template <class R>
inline R given(const SkinChunk<ScalarOf<R>>& c, double LaneReport::*field) {
    alignas(64) ScalarOf<R> values[lane_width<R>];
    for (int l = 0; l < lane_width<R>; ++l) values[l] = ScalarOf<R>(c.exchange.lanes[l].*field);
    return load<R>(values);
}
template <class R>
inline void report(SkinChunk<ScalarOf<R>>& c, double LaneReport::*field, const R& values) {
    for (int l = 0; l < lane_width<R>; ++l) c.exchange.lanes[l].*field = double(lane(values, l));
}

/// Gradient along the bodies' motions: action and reaction.
template <class R>
inline void add_body_gradients(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    for_each_body_slot(c, [&](int slot) {
        for (int l = 0; l < W; ++l) {
            const LaneContact& o = c.contacts.at(slot, l);
            if (o.object < 0) continue;
            const Vec3<double> centre = transform(o.pose, o.mass_centre);
            for (int d = 0; d < 3; ++d)
                c.exchange.centre[(3 * slot + d) * W + l] = ScalarOf<R>(centre[d] - c.state.origin[d * W + l]);
        }
        Vec3<R> force{R(0), R(0), R(0)}, torque = force;
        for (std::size_t i = 0; i < samples_in_use<R>(c); ++i) {
            const Vec3<R> x = at_sample<R>(t, c.state.position.data(), i);
            const Vec3<R> g = load_vec3<R>(&c.exchange.slot_gradient[3 * (slot * t.sample_count() + i) * W]);
            force -= g;
            torque -= cross(x - load_vec3<R>(&c.exchange.centre[3 * slot * W]), g);
        }
        store_vec3<R>(&c.exchange.body_gradient[6 * slot * W], force);
        store_vec3<R>(&c.exchange.body_gradient[(6 * slot + 3) * W], torque);
    });
}

/// Column k of the coupling block of one sample: K G e_k.
template <class R>
inline Vec3<R> coupling_column(const Mat3<R>& K, const BodyMotion<R>& G, int k) {
    return k < 3 ? -K.column(k) : K * G.turn.column(k - 3);
}

/// The same for those of which some sample touches the body, as fill_columns has found them.
template <class T, class Visit>
inline void for_each_touched_body_slot(const SkinChunk<T>& c, Visit visit) {
    for_each_body_slot(c, [&](int slot) {
        if (c.exchange.idle_columns[std::size_t(slot)] == 0) visit(slot);
    });
}

/// Writes the coupling blocks as right-hand sides, and the bodies' own part C of the matrix.
template <class R>
inline void fill_columns(SkinChunk<ScalarOf<R>>& c) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W;
    const SkinTopology& t = *c.topology;
    const std::size_t stride = t.unknowns.size() * W3;
    const Vec3<R> bone = load_vec3<R>(c.state.bone.data());
    for_each_body_slot(c, [&](int slot) {
        T* columns = &c.exchange.columns[6 * slot * stride];
        std::fill(columns, columns + 6 * stride, T(0));
        unsigned char& idle = c.exchange.idle_columns[std::size_t(slot)] = 1;
        R C[6][6];
        for (auto& row : C)
            for (R& value : row) value = R(0);
        for (std::size_t i = 0; i < samples_in_use<R>(c); ++i) {
            const std::size_t s = slot * t.sample_count() + i;
            const Mat3<R> K = load_mat3<R>(&c.exchange.slot_curvature[9 * s * W]);
            if (!any(K[0][0] + K[1][1] + K[2][2] > R(0))) continue;
            idle = 0;
            const Vec3<R> x = at_sample<R>(t, c.state.position.data(), i);
            const BodyMotion<R> G = body_motion<R>(c, slot, x);
            for (int k = 0; k < 6; ++k) {
                const Vec3<R> column = coupling_column(K, G, k);
                T* to = columns + k * stride;
                if (is_free_sample(t, i)) {
                    add_at_free_sample<R>(t, to, i, column);
                } else {
                    add_vec3<R>(to + t.elimination[t.bone_position] * W3, column);
                    add_vec3<R>(to + t.elimination[t.bone_rotation] * W3, cross(x - bone, column));
                }
                const Vec3<R> turned = transposed_times(G.turn, column);
                for (int d = 0; d < 3; ++d) C[d][k] = C[d][k] - column[d], C[3 + d][k] = C[3 + d][k] + turned[d];
            }
        }
        T* matrix = &c.exchange.body_matrix[36 * std::size_t(slot * c.contacts.capacity + slot) * W];
        for (int k = 0; k < 36; ++k) store<R>(matrix + k * W, C[k / 6][k % 6]);
    });
    // condense() writes the others of those that are touched.
    for_each_body_slot(c, [&](int a) {
        for_each_body_slot(c, [&](int b) {
            if (a >= b || (c.exchange.idle_columns[std::size_t(a)] | c.exchange.idle_columns[std::size_t(b)]) == 0)
                return;
            T* matrix = &c.exchange.body_matrix[36 * std::size_t(a * c.contacts.capacity + b) * W];
            std::fill(matrix, matrix + 36 * W, T(0));
        });
    });
}

/// columns <- L^-1 columns.
template <class R>
inline void solve_columns_forward(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    const std::size_t stride = t.unknowns.size() * W3;
    for_each_touched_body_slot(c, [&](int slot) {
        auto* columns = &c.exchange.columns[6 * slot * stride];
        if constexpr (lane_width<R> == 1) {
            for (int k = 0; k < 6; ++k)
                solve_supernodes_forward<R>(t.supernodes, c.scratch.panels.data(), columns + k * stride,
                                            c.scratch.panel_work.data());
        } else {
            // As many at a time as fit the registers: with AVX-512 there are twice as many, of any width.
            constexpr int at_once = sizeof(FilledRegister<R>) >= 64 ? 6 : 3;
            for (int k = 0; k < 6; k += at_once)
                solve_blocks_forward<at_once, R>(t.pattern, c.scratch.factor.data(), columns + k * stride, stride);
        }
    });
}

/// Products of `rows` columns with `cols` others, `stride` scalars apart, each read once. Rows in which all of `a` are
/// still zero are passed over.
template <int rows, int cols, class R>
inline void column_products(const ScalarOf<R>* a, const ScalarOf<R>* b, std::size_t stride, R (&sum)[rows][cols]) {
    for (auto& row : sum)
        for (R& value : row) value = R(0);
    for (std::size_t n = 0; n < stride; n += lane_width<R>) {
        R x[rows], size(0);
        for (int i = 0; i < rows; ++i) {
            x[i] = load<R>(a + std::size_t(i) * stride + n);
            size = maximum(size, absolute(x[i]));
        }
        if (!any(size > R(0))) continue;
        for (int j = 0; j < cols; ++j) {
            const R y = load<R>(b + std::size_t(j) * stride + n);
            for (int i = 0; i < rows; ++i) sum[i][j] += x[i] * y;
        }
    }
}

/// Takes Y' Y from the bodies' matrix and Y' y from their right-hand side, Y = columns, y = permuted (both behind
/// L^-1).
template <class R>
inline void condense(SkinChunk<ScalarOf<R>>& c, bool with_matrix) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W, half = 3;
    const std::size_t stride = c.topology->unknowns.size() * W3;
    for_each_touched_body_slot(c, [&](int a) {
        const T* of_a = &c.exchange.columns[6 * a * stride];
        R along[6][1];
        column_products<6, 1, R>(of_a, c.scratch.permuted.data(), stride, along);
        for (int k = 0; k < 6; ++k) {
            T* rhs = &c.exchange.body_rhs[(6 * a + k) * W];
            store<R>(rhs, load<R>(rhs) - along[k][0]);
        }
        for_each_touched_body_slot(c, [&](int b) {
            if (b < a || !with_matrix) return;
            const T* of_b = &c.exchange.columns[6 * b * stride];
            T* matrix = &c.exchange.body_matrix[36 * std::size_t(a * c.contacts.capacity + b) * W];
            // By quarters: what fits the registers.
            for (int i = 0; i < 6; i += half)
                for (int j = 0; j < 6; j += half) {
                    if (a == b && j < i) continue;
                    R products[half][half];
                    column_products<half, half, R>(of_a + i * stride, of_b + j * stride, stride, products);
                    for (int k = 0; k < half * half; ++k) {
                        T* value = matrix + (6 * (i + k / half) + j + k % half) * W;
                        const R own = a == b ? load<R>(value) : R(0);
                        store<R>(value, own - products[k / half][k % half]);
                    }
                }
            if (a != b) return;
            for (int k = 0; k < 36; ++k)
                if (const int i = k / 6, j = k % 6; j < i) store<R>(matrix + k * W, load<R>(matrix + (6 * j + i) * W));
        });
    });
}

}  // namespace detail

/// Start of the step, and the first guess.
template <class R>
void coupled_begin(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    detail::begin_step<R>(c, settings, detail::fitted::coasting_share);
    detail::keep_base<R>(c, mask_from_bits<R>(active_lanes(c)));
}

/// Evaluates every lane at its positions and the slots' poses, with a matrix for those that step; reports to
/// exchange.lanes.
template <class R>
void coupled_evaluate(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    place_slots(c);
    unsigned steps = 0;
    for (int lane = 0; lane < lane_width<R>; ++lane)
        if (c.exchange.lanes[std::size_t(lane)].steps) steps |= 1u << lane;
    const R exactness = detail::given<R>(c, &LaneReport::exactness);
    const MaskOf<R> exact = exactness > R(0);
    const MaskOf<R> renew = exact | mask_from_bits<R>(detail::lanes_short_at_limits<R>(c, settings));
    const detail::MatrixRequest<R> matrix{mask_from_bits<R>(steps), renew, !exact,
                                          detail::contact_share_of<R>(c, settings)};
    const Evaluation<R> e = steps != 0 ? detail::evaluate_keeping<R>(c, settings, exactness, matrix)
                                       : evaluate<R, detail::Want::forces>(c, settings, exactness);
    detail::add_body_gradients<R>(c);
    detail::report<R>(c, &LaneReport::energy, e.energy);
    detail::report<R>(c, &LaneReport::residual, e.residual);
    detail::report<R>(c, &LaneReport::pending, e.pending);
    detail::report<R>(c, &LaneReport::violation, e.violation);
    detail::report<R>(c, &LaneReport::penetration, e.penetration);
    detail::report<R>(c, &LaneReport::contact_force, e.contact_force);
    detail::report<R>(c, &LaneReport::coupling_force, e.coupling_force);
    detail::report<R>(c, &LaneReport::limited, e.limited);
    detail::report<R>(c, &LaneReport::rounding, detail::rounding_force(c, e));
}

/// Multiplier update of the lanes.
template <class R>
void coupled_update(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, unsigned lanes) {
    const MaskOf<R> mask = mask_from_bits<R>(lanes);
    Evaluation<R> e;
    e.violation = detail::given<R>(c, &LaneReport::violation);
    e.penetration = detail::given<R>(c, &LaneReport::penetration);
    e.contact_force = detail::given<R>(c, &LaneReport::contact_force);
    // 1e300 is more than float holds.
    const R most(std::numeric_limits<ScalarOf<R>>::max());
    R last_excess = minimum(detail::given<R>(c, &LaneReport::last_excess), most);
    R last_depth = minimum(detail::given<R>(c, &LaneReport::last_depth), most);
    detail::stiffen_slow_lanes(c, settings, e, mask, last_excess, last_depth);
    detail::report<R>(c, &LaneReport::last_excess, last_excess);
    detail::report<R>(c, &LaneReport::last_depth, last_depth);
    detail::update_multipliers<R>(c, mask);
}

/// Factors the lanes' matrices and condenses them for the bodies. Of a given right-hand side, the lanes' part stands in
/// scratch.permuted, and that of the bodies with them: body_rhs begins at zero.
template <class R>
void coupled_condense(SkinChunk<ScalarOf<R>>& c, unsigned lanes, Condense what) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W;
    const SkinTopology& t = *c.topology;
    if (what == Condense::gradient) {
        const R damping = detail::given<R>(c, &LaneReport::damping);
        detail::damp<R>(c, mask_from_bits<R>(lanes), damping);
        detail::forget_matrix<R>(c, mask_from_bits<R>(lanes) & (damping > R(0)));
        for (int i : t.unknowns)
            store_vec3<R>(&c.scratch.permuted[t.elimination[i] * W3], -load_vec3<R>(&c.scratch.gradient[i * W3]));
        detail::for_each_body_slot(c, [&](int slot) {
            for (int k = 0; k < 6; ++k)
                store<R>(&c.exchange.body_rhs[(6 * slot + k) * W],
                         -load<R>(&c.exchange.body_gradient[(6 * slot + k) * W]));
        });
    }
    if (what == Condense::given) std::fill(c.exchange.body_rhs.begin(), c.exchange.body_rhs.end(), T(0));
    const auto& changed = c.scratch.changed_columns;
    const bool same_matrix = what == Condense::given ||
                             (what == Condense::residual &&
                              std::none_of(changed.begin(), changed.end(), [](unsigned char k) { return k != 0; }));
    detail::report<R>(c, &LaneReport::bad_pivots, same_matrix ? R(T(0)) : detail::factor_matrix<R>(c));
    detail::solve_forward<R>(c);
    if (!same_matrix) {
        detail::fill_columns<R>(c);
        detail::solve_columns_forward<R>(c);
    }
    detail::condense<R>(c, !same_matrix);
}

/// With the bodies' step known: the lanes' part of the direction, set by the first call and added to by further ones.
template <class R>
void coupled_direction(SkinChunk<ScalarOf<R>>& c, unsigned lanes, bool first) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, W3 = 3 * W;
    const SkinTopology& t = *c.topology;
    const MaskOf<R> mask = mask_from_bits<R>(lanes);
    const std::size_t stride = t.unknowns.size() * W3;
    detail::for_each_touched_body_slot(c, [&](int slot) {
        R dy[6];
        for (int k = 0; k < 6; ++k) dy[k] = load<R>(&c.exchange.body_step[(6 * slot + k) * W]);
        const T* columns = &c.exchange.columns[6 * slot * stride];
        for (std::size_t i = 0; i < stride; i += W) {
            R sum = load<R>(&c.scratch.permuted[i]);
            for (int k = 0; k < 6; ++k) sum -= load<R>(columns + k * stride + i) * dy[k];
            store<R>(&c.scratch.permuted[i], sum);
        }
    });
    detail::solve_backward<R>(c);
    for (int i : t.unknowns) {
        T *p = &c.scratch.direction[i * W3], *step = &c.scratch.permuted[t.elimination[i] * W3];
        const Vec3<R> old = load_vec3<R>(p), moved = select(mask, load_vec3<R>(step), Vec3<R>{R(0), R(0), R(0)});
        store_vec3<R>(step, moved);
        store_vec3<R>(p, first ? select(mask, moved, old) : old + moved);
    }
    if (first) c.scratch.first_direction = c.scratch.direction;
    detail::report<R>(c, &LaneReport::slope, detail::slope_of<R>(c));
}

/// Gives the lanes back the direction before contacts were followed.
template <class R>
void coupled_restore(SkinChunk<ScalarOf<R>>& c, unsigned lanes) {
    const MaskOf<R> mask = mask_from_bits<R>(lanes);
    for (std::size_t i = 0; i < c.scratch.direction.size(); i += lane_width<R>)
        store<R>(&c.scratch.direction[i],
                 select(mask, load<R>(&c.scratch.first_direction[i]), load<R>(&c.scratch.direction[i])));
}

namespace detail {

/// What contact of a sample does at the end of a direction beyond its linearisation, and by how much its curvature has
/// changed.
template <class R>
struct SampleResidual {
    Vec3<R> residual{R(0), R(0), R(0)}, fixed_gradient{R(0), R(0), R(0)};  ///< `fixed`: of what no body moves
    Mat3<R> change = Mat3<R>::zero(), fixed_curvature = Mat3<R>::zero();
    bool idle = true;  ///< nothing touches, nor did
};

/// Adds what a body does that a slot's lanes touch with sample s, which is at `base` and makes `step`.
template <class R>
inline void add_body_residual(SkinChunk<ScalarOf<R>>& c, int slot, std::size_t s, const Vec3<R>& gradient,
                              const Mat3<R>& curvature, const Vec3<R>& base, const Vec3<R>& step, const R& share,
                              SampleResidual<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const std::size_t i = std::size_t(slot) * c.topology->sample_count() + s;
    T *old_gradient = &c.exchange.slot_gradient[3 * i * W], *old_curvature = &c.exchange.slot_curvature[9 * i * W];
    const Mat3<R> old = load_mat3<R>(old_curvature), now = changed_curvature(curvature, old, share);
    const BodyMotion<R> G = body_motion<R>(c, slot, base);
    const T* dy = &c.exchange.body_step[6 * slot * W];
    const Vec3<R> moved = step + G.times(load_vec3<R>(dy), load_vec3<R>(dy + 3 * W));
    const Vec3<R> r = gradient - load_vec3<R>(old_gradient) - old * moved;
    out.residual += r;
    out.change = out.change + (now - old);
    store_vec3<R>(old_gradient, gradient);
    store_mat3<R>(old_curvature, now);
    add_vec3<R>(&c.exchange.body_rhs[6 * slot * W], r);  // minus G' r, G' = [-I; skew(arm)']
    add_vec3<R>(&c.exchange.body_rhs[(6 * slot + 3) * W], -transposed_times(G.turn, r));
}

/// How many samples are looked at together: each slot is read once for all of them.
template <class R>
inline constexpr int residuals_together = std::max(8, samples_together<R>);

/// The residuals of `count` samples from `first` on, which are at `base` and make `step`, against all slots. Where
/// nothing touches, nor did, they are zero, and left out.
template <class R>
inline void find_sample_residuals(SkinChunk<ScalarOf<R>>& c, std::size_t first, int count, const Vec3<R>* base,
                                  const Vec3<R>* step, const R& exactness, const R& share, SampleResidual<R>* out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>, together = samples_together<R>;
    const SkinTopology& t = *c.topology;
    Vec3<R> x[residuals_together<R>];
    SampleSurface<R> at[residuals_together<R>];
    for (int k = 0; k < count; ++k)
        x[k] = base[k] + at_sample<R>(t, c.scratch.direction.data(), first + std::size_t(k));
    for (int slot = 0; slot < c.contacts.used; ++slot) {
        const Slot<R> there = read_slot<R>(c, slot);
        for (int k = 0; k < count; k += together)
            find_sample_surfaces(c, there, first + std::size_t(k), std::min(together, count - k), x + k, at + k);
        for (int k = 0; k < count; ++k) {
            const std::size_t s = first + std::size_t(k), i = std::size_t(slot) * t.sample_count() + s;
            if (!is_free_sample(t, s)) continue;
            const SampleContact<R> contact = sample_contact<R>(c, there, s, at[k], exactness);
            const ContactTerms<R>& terms = contact.terms;
            if (!there.all_body && !contact.idle) {
                out[k].fixed_gradient += there.of_others(terms.gradient);
                out[k].fixed_curvature = out[k].fixed_curvature + there.of_others(terms.curvature);
                out[k].idle = false;
            }
            if (!there.any_body) continue;
            const T *gradient = &c.exchange.slot_gradient[3 * i * W], *old = &c.exchange.slot_curvature[9 * i * W];
            if (contact.idle && all_zero<R>(gradient, 3) && all_zero<R>(old, 9)) continue;
            add_body_residual(c, slot, s, there.of_bodies(terms.gradient), there.of_bodies(terms.curvature), base[k],
                              step[k], share, out[k]);
            out[k].idle = false;
        }
    }
}

}  // namespace detail

/// What contact does at the end of the direction beyond its linearisation (direction.h): leaves it as right-hand side,
/// and the new curvature in the matrix. The slots' poses are the bodies' at the end of the direction; body_step is the
/// last addition to it.
template <class R>
void coupled_contact_residual(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, unsigned lanes) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>, together = detail::residuals_together<R>;
    const SkinTopology& t = *c.topology;
    const MaskOf<R> mask = mask_from_bits<R>(lanes);
    const R exactness = detail::given<R>(c, &LaneReport::exactness);
    const R share = detail::contact_share_of<R>(c, settings);
    place_slots(c);
    R squared(0);
    std::fill(c.exchange.body_rhs.begin(), c.exchange.body_rhs.end(), T(0));
    std::fill(c.scratch.sample_residual.begin(), c.scratch.sample_residual.end(), T(0));
    for (std::size_t first = 0, count = samples_in_use<R>(c); first < count; first += together) {
        const int n = int(std::min<std::size_t>(together, count - first));
        Vec3<R> base[together], step[together];
        detail::SampleResidual<R> found[together];
        for (int k = 0; k < n; ++k) {
            const std::size_t s = first + std::size_t(k);
            base[k] = at_sample<R>(t, c.state.position.data(), s);
            if (is_free_sample(t, s)) step[k] = at_free_sample<R>(t, c.scratch.permuted.data(), s);
        }
        detail::find_sample_residuals(c, first, n, base, step, exactness, share, found);
        for (int k = 0; k < n; ++k) {
            const std::size_t s = first + std::size_t(k);
            if (!is_free_sample(t, s)) continue;
            T *all_gradient = &c.scratch.sample_gradient[s * W3],
              *all_curvature = &c.scratch.sample_curvature[3 * s * W3];
            if (found[k].idle && detail::all_zero<R>(all_gradient, 3) && detail::all_zero<R>(all_curvature, 9))
                continue;
            const Mat3<R> old = load_mat3<R>(all_curvature),
                          curvature = detail::changed_curvature(found[k].fixed_curvature, old, share);
            Vec3<R> residual =
                found[k].residual + (found[k].fixed_gradient - load_vec3<R>(all_gradient) - old * step[k]);
            Mat3<R> change = found[k].change + (curvature - old);
            store_vec3<R>(all_gradient, found[k].fixed_gradient);
            store_mat3<R>(all_curvature, curvature);
            residual = select(mask, residual, Vec3<R>{R(0), R(0), R(0)});
            change = select(mask, change, Mat3<R>::zero());
            squared += dot(residual, residual);
            detail::change_sample_block<R>(c, s, change);
            store_vec3<R>(&c.scratch.sample_residual[s * W3], residual);
        }
    }
    std::fill(c.scratch.permuted.begin(), c.scratch.permuted.end(), T(0));
    for (std::size_t i = 0; i < samples_in_use<R>(c); ++i)
        if (is_free_sample(t, i))
            add_at_free_sample<R>(t, c.scratch.permuted.data(), i, -load_vec3<R>(&c.scratch.sample_residual[i * W3]));
    detail::report<R>(c, &LaneReport::contact_residual, squared);
}

/// Moves the lanes from their base along the direction; with `from_here`, the base is where they are.
template <class R>
void coupled_move(SkinChunk<ScalarOf<R>>& c, unsigned lanes, unsigned from_here) {
    detail::keep_base<R>(c, mask_from_bits<R>(from_here));
    detail::move_from_base<R>(c, mask_from_bits<R>(lanes), detail::given<R>(c, &LaneReport::alpha));
}

/// End of the step, for lanes that `failed`, or have `converged`. Returns the bits of lanes that were reset: those that
/// failed, are lost, or wound around themselves.
template <class R>
unsigned coupled_end(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings, unsigned failed, unsigned converged) {
    Evaluation<R> e;
    e.residual = detail::given<R>(c, &LaneReport::residual);
    e.violation = detail::given<R>(c, &LaneReport::violation);
    e.contact_force = detail::given<R>(c, &LaneReport::contact_force);
    e.coupling_force = detail::given<R>(c, &LaneReport::coupling_force);
    const unsigned reset = detail::end_iteration<R>(c, e, mask_from_bits<R>(active_lanes(c)), mask_from_bits<R>(failed),
                                                    mask_from_bits<R>(converged));
    detail::end_step<R>(c, settings);
    if (reset != 0) detail::forget_matrix<R>(c, mask_from_bits<R>(reset));
    return reset;
}

/// Everything a lane type offers.
template <class R>
constexpr Kernel<ScalarOf<R>> kernel() {
    return {lane_width<R>,
            &solve_chunk<R>,
            &move_rigid<R>,
            {&coupled_begin<R>, &coupled_evaluate<R>, &coupled_update<R>, &coupled_condense<R>, &coupled_direction<R>,
             &coupled_restore<R>, &coupled_contact_residual<R>, &coupled_move<R>, &coupled_end<R>}};
}

}  // namespace palpate
