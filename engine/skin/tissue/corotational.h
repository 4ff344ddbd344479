#pragma once
// Corotational tissue without singular values: Psi = mu |S - I|^2 + lambda/2 tr(S - I)^2 with F = R S, forces from the
// rotation R alone. With G = tr(S) I - S, r_a = R g_a and kappa = pressure - 2 mu (pressure = lambda tr(S - I)),
//   K_ab = volume (2 mu ga.gb I + lambda r_a r_b^T + kappa [r_a]^T R G^-1 R^T [r_b]),   [r] v = r x v,
// whose last term is what turning costs: G's eigenvalues are sums of two stretches, never negative, and the stiffness
// against a turn is 2 mu + 2 kappa / (such a sum). So it is positive semidefinite where kappa is positive, and
// elsewhere where no eigenvalue of G is below -kappa / mu; for a definite matrix, they are raised to that (McAdams et
// al. 2011 clamp the same in the frame of the singular vectors).
//
// A register holds the same elements of several fingers, or several elements of one; all are added to the nodes in
// their own order, so that a finger is the same bits alone or beside others.

#include "engine/math/gather.h"
#include "engine/math/polar3.h"
#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// A finger alone has a register of its elements side by side; several fingers are side by side themselves.
template <class R>
using RegisterOf = std::conditional_t<shares_register<R> && lane_width<R> == 1, typename WholeRegister<R>::type, R>;
/// How many elements it holds.
template <class R>
inline constexpr int elements_at_once = lane_width<RegisterOf<R>> / lane_width<R>;
/// A whole register also where several fingers leave room for another element of theirs.
template <class R>
using FilledRegister = std::conditional_t<shares_register<R>, typename WholeRegister<R>::type, R>;

/// Elements first ... first + count - 1 as a register Q holds them; further parts repeat the last.
template <class R, class Q>
struct ElementGroup {
    static constexpr int parts = lane_width<Q> / lane_width<R>;
    std::size_t first = 0;
    int count = 0;
    std::array<std::size_t, parts> number;

    ElementGroup(std::size_t first_element, int n) : first(first_element), count(n) {
        for (int k = 0; k < parts; ++k) number[std::size_t(k)] = first + std::size_t(std::min(k, n - 1));
    }
    /// Number `i` of the `size` that an array has for each element.
    template <class Array>
    Q load(const Array& array, std::size_t size = 1, std::size_t i = 0) const {
        const bool in_a_row = count == parts && number.back() == number[0] + (parts - 1);  // they never fall
        if (parts > 1 && size == 1 && in_a_row) return palpate::load<Q>(array.data() + number[0] * lane_width<R>);
        std::array<std::size_t, parts> offset;
        for (std::size_t k = 0; k < offset.size(); ++k) offset[k] = size * number[k] * lane_width<R>;
        return gather_parts<R, Q>(array.data() + i * lane_width<R>, offset.data());
    }
    Vec3<Q> load_node(const LaneArray<ScalarOf<R>>& array, const SkinTopology& t, int a) const {
        std::array<std::size_t, parts> offset;
        for (std::size_t k = 0; k < offset.size(); ++k)
            offset[k] = std::size_t(3 * t.elements[number[k]][std::size_t(a)]) * lane_width<R>;
        return gather_vectors(array.data(), offset.data());
    }
    /// Vector `a` of the three that an array has for each element.
    template <class Array>
    Vec3<Q> load_third(const Array& array, std::size_t a) const {
        std::array<std::size_t, parts> offset;
        for (std::size_t k = 0; k < offset.size(); ++k) offset[k] = (9 * number[k] + 3 * a) * lane_width<R>;
        return gather_vectors(array.data(), offset.data());
    }
    static Vec3<Q> gather_vectors(const ScalarOf<R>* p, const std::size_t* offset) {
        if constexpr (lane_width<R> == 1 && parts >= 4) {
            Q v[3];
            gather_triples(p, offset, v);
            return {v[0], v[1], v[2]};
        } else {
            return {gather_parts<R, Q>(p, offset), gather_parts<R, Q>(p + lane_width<R>, offset),
                    gather_parts<R, Q>(p + 2 * lane_width<R>, offset)};
        }
    }
};

/// Elements turned back: F = R (I + E).
template <class Q>
struct Corotated {
    Mat3<Q> rotation;
    Mat3<Q> strained;      ///< F - R
    Symmetric3<Q> strain;  ///< E
    Q stretch;             ///< tr E
    Vec3<Q> g[3];          ///< shape gradients of nodes 1..3 [1/m]
    Q volume;
    Symmetric3<Q> turning;  ///< volume kappa G^-1, as stiffness has it (weigh_turning)
};

/// What follows of the rotation and of F, which is in `strained` before.
template <class Q>
inline void finish_corotated(Corotated<Q>& s) {
    for (int i = 0; i < 9; ++i) s.strained.m[i / 3][i % 3] = s.strained.m[i / 3][i % 3] - s.rotation.m[i / 3][i % 3];
    auto along = [&](int i, int j) { return dot(s.rotation.column(i), s.strained.column(j)); };
    s.strain = {along(0, 0), along(0, 1), along(1, 1), along(0, 2), along(1, 2), along(2, 2)};
    s.stretch = trace(s.strain);
}

/// Turns back up to rotations_at_once groups of elements.
template <class R, class Q, class Group>
inline void corotate(const SkinChunk<ScalarOf<R>>& c, int count, Group group, Corotated<Q>* out) {
    for (int n = 0; n < count; ++n) {
        const ElementGroup<R, Q> elements = group(n);
        Corotated<Q>& s = out[n];
        Vec3<Q> x[4];
        for (int a = 0; a < 4; ++a) x[a] = elements.load_node(c.state.position, *c.topology, a);
        for (std::size_t a = 0; a < 3; ++a) s.g[a] = elements.load_third(c.rest.shape_gradients, a);
        s.volume = elements.load(c.rest.volume);
        set_deformation_gradient(x, s.g, s.strained);
    }
    nearest_rotations<Q>(
        count, [&](int n) -> const Mat3<Q>& { return out[n].strained; },
        [&](int n) -> Mat3<Q>& { return out[n].rotation; });
    for (int n = 0; n < count; ++n) finish_corotated(out[n]);
}

/// Nodal forces (gradients) dE/dx_a of nodes 0..3 [N].
template <class Q>
inline void corotational_force(const Corotated<Q>& s, const Q& mu, const Q& pressure, Vec3<Q> out[4]) {
    const Q twice_mu = Q(2) * mu * s.volume, around = pressure * s.volume;
    Mat3<Q> P;
    for (int i = 0; i < 9; ++i)
        P.m[i / 3][i % 3] = plus_product(around * s.rotation.m[i / 3][i % 3], twice_mu, s.strained.m[i / 3][i % 3]);
    for (int a = 0; a < 3; ++a) out[a + 1] = P * s.g[a];
    out[0] = -(out[1] + out[2] + out[3]);
}

/// volume kappa G^-1, without what would make the stiffness indefinite where exactness is 0. Its operations wait for
/// each other: ask for several groups of elements in a row.
template <class Q>
inline void weigh_turning(Corotated<Q>& s, const Q& mu, const Q& pressure, const Q& exactness) {
    const Q least(ScalarOf<Q>(1e-6)), zero(0), two(2);
    const Q kappa = pressure - two * mu, floor = maximum(two - pressure / mu, zero);
    const Symmetric3<Q> minus_strain = Q(-1) * s.strain, G = plus_diagonal(two + s.stretch, minus_strain);
    // The positive part of what G is above the floor. Where kappa is positive nothing has to be raised.
    const Symmetric3<Q> above = plus_diagonal(two + s.stretch - floor, minus_strain);
    const Symmetric3<Q> raised = plus_diagonal(floor, positive_part_bound(above));
    Symmetric3<Q> W = kappa * inverse_of_positive(select(kappa > zero, G, raised), least);
    if (any(exactness > zero)) W = W + exactness * (kappa * inverse_of_positive(G, least) - W);
    s.turning = s.volume * W;
}

/// Stiffness blocks of an element: emit(k, i, j, number) of each k of block_pair, entry after entry [N/m]; `r` are the
/// turned shape gradients, R g_a. A column at a time needs four numbers of memory and seven registers: whole blocks do
/// not fit into the sixteen that there are. `own_volume`: whether lambda acts on the element, and not on its patch.
template <bool own_volume = true, class Q, class Emit>
inline void corotational_stiffness(const Corotated<Q>& s, const Vec3<Q> r[3], const Q& mu, const Q& lambda, Emit emit) {
    const Symmetric3<Q>& W = s.turning;
    const Mat3<Q>& A = s.rotation;
    const Mat3<Q> full{{{W.xx, W.xy, W.xz}, {W.xy, W.yy, W.yz}, {W.xz, W.yz, W.zz}}};
    const Mat3<Q> M = times_transposed(A * full, A);  // symmetric but for its rounding: its lower half counts
    const Vec3<Q> row[3] = {
        {M.m[0][0], M.m[1][0], M.m[2][0]}, {M.m[1][0], M.m[1][1], M.m[2][1]}, {M.m[2][0], M.m[2][1], M.m[2][2]}};
    const Q direct = Q(2) * mu * s.volume, bulk = lambda * s.volume;
    // Moving all four nodes costs nothing: what turns node 0 is minus the others.
    const Vec3<Q> node[4] = {-(r[0] + r[1] + r[2]), r[0], r[1], r[2]};
#pragma GCC unroll 4
    for (int b = 0; b < 4; ++b) {
        const Vec3<Q> N[3] = {cross(row[0], node[b]), cross(row[1], node[b]), cross(row[2], node[b])};
        const Vec3<Q> stretched = bulk * node[b];
#pragma GCC unroll 4
        for (int a = b; a < 4; ++a) {
            const int k = a * (a + 1) / 2 + b;
            const Vec3<Q>& v = node[a];
            const Q diagonal = direct * dot(v, node[b]);
#pragma GCC unroll 3
            for (int j = 0; j < 3; ++j) {
                const Q n[3] = {N[0][j], N[1][j], N[2][j]};
#pragma GCC unroll 3
                for (int i = a == b ? j : 0; i < 3; ++i) {
                    const int p = (i + 1) % 3, q = (i + 2) % 3;
                    Q entry = product_less(n[p], v[q], n[q] * v[p]);
                    if constexpr (own_volume) entry = plus_product(entry, v[i], stretched[j]);
                    if (i == j) entry += diagonal;
                    emit(k, i, j, entry);
                    if (a == b && i != j) emit(k, j, i, entry);
                }
            }
        }
    }
}

/// Part k of what a register holds.
template <class R, class Q>
inline R part_of(const Q& whole, int k) {
    if constexpr (std::is_same_v<R, Q>)
        return whole;
    else if constexpr (lane_width<R> != 1)
        return k == 0 ? low_part<R>(whole) : high_part<R>(whole);
    else
        return R(lane(whole, k));
}
template <class R, class Q>
inline Vec3<R> part_of(const Vec3<Q>& whole, int k) {
    return {part_of<R>(whole.x, k), part_of<R>(whole.y, k), part_of<R>(whole.z, k)};
}

/// What the elements of a register add to a finger alone: forces on their nodes, then stiffness of their node pairs.
template <class Q>
struct ElementSums {
    static constexpr std::size_t stiffness = 16, count = 112;  // in squares of 8
    std::array<Q, count> number;

    ElementSums() {
        for (std::size_t i = 12; i < stiffness; ++i) number[i] = Q(0);
        for (std::size_t i = stiffness + 90; i < count; ++i) number[i] = Q(0);
    }
};

/// The same as memory holds it, element after element. (For Want::forces, no more than forces.)
template <class R>
struct ElementNumbers {
    static constexpr std::size_t count = ElementSums<RegisterOf<R>>::count;
    alignas(64) std::array<ScalarOf<R>, std::size_t(elements_at_once<R>) * count> of_element;
    const ScalarOf<R>* of(int k) const { return &of_element[std::size_t(k) * count]; }
};
/// The first `used` of the `count` numbers of each of a register's elements, element after element.
template <class R, class Q, std::size_t count>
inline void turn_numbers(const Q* number, std::size_t used, ScalarOf<R>* out) {
    using T = ScalarOf<R>;
    using Row = HalfRegister<T>;
    constexpr std::size_t side = sizeof(Row) / sizeof(T), lanes = elements_at_once<R>;
    for (std::size_t i = 0; i < used; i += side)
        for (std::size_t first = 0; first < lanes; first += side) {
            Row row[side];
#pragma GCC unroll 8
            for (std::size_t k = 0; k < side; ++k)
                std::memcpy(&row[k], reinterpret_cast<const T*>(&number[i + k].v) + first, sizeof(Row));
            transpose_square(row);
#pragma GCC unroll 8
            for (std::size_t k = 0; k < side; ++k) std::memcpy(&out[(first + k) * count + i], &row[k], sizeof(Row));
        }
}

/// Adds nine numbers to a block of a finger alone, eight of them in a register (or two).
template <class T>
inline void add_nine(T* to, const T* from) {
    using Row = Lanes<T, 32 / sizeof(T)>;
    for (int i = 0; i < 8; i += lane_width<Row>) store(to + i, load<Row>(to + i) + load<Row>(from + i));
    to[8] += from[8];
}

/// Adds what element e adds to a finger alone. Element after element: a sum of a node's is then the same in whatever
/// register its elements were.
template <Want want, class R>
inline void add_element(SkinChunk<ScalarOf<R>>& c, std::size_t e, const ScalarOf<R>* from) {
    auto* gradient = c.scratch.gradient.data();
    const auto& nodes = c.topology->elements[e];
    for (std::size_t a = 0; a < 4; ++a)
        for (int i = 0; i < 3; ++i) gradient[3 * nodes[a] + i] += from[3 * a + std::size_t(i)];
    if constexpr (want == Want::forces_and_matrix) {
        from += ElementSums<RegisterOf<R>>::stiffness;
        for (int block : c.topology->element_block[e]) {
            add_nine(&c.scratch.blocks[9 * std::size_t(block)], from);
            from += 9;
        }
    }
}

/// Lanes in which limit e may bear a multiplier.
template <class R>
inline unsigned loaded_lanes(const SkinChunk<ScalarOf<R>>& c, std::size_t e) {
    return c.limits.unloaded ? 0 : c.scratch.loaded_limits[e] & ((1u << lane_width<R>)-1);
}

/// Elements that may be at a strain limit, or bear one's multiplier, are noted: add_noted_limits (patch_limits.h)
/// takes them in turn.
template <class R, class Q>
inline void note_limits(SkinChunk<ScalarOf<R>>& c, const ElementGroup<R, Q>& elements, const Corotated<Q>& s,
                        bool watches) {
    constexpr int W = lane_width<R>;
    const Q one(1), low = elements.load(c.rest.limit_low), high = elements.load(c.rest.limit_high);
    const Q margin = minimum(one - low, high - one);
    unsigned beyond = 0;
    // No stretch is further from one than the norm of what it deforms by. (What is not a number is looked at.)
    if (!all(squared_norm(s.strained) < Q(ScalarOf<Q>(fitted::clearly_within)) * margin * margin)) {
        const MaskOf<Q> within = positive_definite(plus_diagonal(one - low, s.strain)) &
                                 positive_definite(plus_diagonal(high - one, Q(-1) * s.strain));
        beyond = bits_from_mask<Q>(!within);
    }
    if (beyond == 0 && c.limits.unloaded && !watches) return;
    for (int k = 0; k < elements.count; ++k) {
        const std::size_t e = elements.first + std::size_t(k);
        unsigned lanes = (beyond >> (k * W)) & ((1u << W) - 1);
        lanes |= loaded_lanes<R>(c, e);
        if (lanes != 0 || watches) c.scratch.noted_limits.push_back({int(e), lanes});
    }
}

/// Strain limit of an element that was noted.
template <Want want, class R>
inline void add_noted_limit(SkinChunk<ScalarOf<R>>& c, const NotedLimit& note, const Mat3<R>& F,
                            const SignedSvd<R>& svd, const ElementRequest<R>& request, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const auto e = std::size_t(note.limit);
    if (request.watches) watch_strain_limit(c, e, svd.sigma, request.watched, out);
    if (note.lanes == 0) return;
    Vec3<R> g[3];
    for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * std::size_t(a)) * W]);
    add_strain_limit<want>(c, e, F, svd, g, load<R>(&c.rest.volume[e * W]), request.limit_exactness,
                           request.limits & mask_from_bits<R>(note.lanes), out);
}

/// Decomposes, several in a register, what was noted: apply(note, F, its decomposition), with F from
/// deformation_of(number of the limit).
template <class R, class Deformation, class Apply>
inline void take_noted_limits(SkinChunk<ScalarOf<R>>& c, Deformation deformation_of, Apply apply) {
    const auto& noted = c.scratch.noted_limits;
    for (std::size_t n = 0; n < noted.size(); n += elements_at_once<R>) {
        const int count = std::min(elements_at_once<R>, int(noted.size() - n));
        Mat3<R> F[elements_at_once<R>], guess[elements_at_once<R>];
        SignedSvd<R> svd[elements_at_once<R>];
        for (int k = 0; k < count; ++k) {
            F[k] = deformation_of(std::size_t(noted[n + std::size_t(k)].limit));
            guess[k] = Mat3<R>::identity();
        }
        if constexpr (shares_register<R>)
            signed_svds<R>(F, guess, count, svd);
        else
            svd[0] = signed_svd(F[0]);
        for (int k = 0; k < count; ++k) apply(noted[n + std::size_t(k)], F[k], svd[k]);
    }
}

/// Forgets what was noted; updated multipliers of elements that are not at a limit are zero.
template <class R>
inline void begin_limits(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes) {
    c.scratch.noted_limits.clear();
    if (!c.has_limits || c.limits.candidates_clear) return;
    const unsigned bits = bits_from_mask<R>(lanes);
    for (std::size_t e = 0; e < c.scratch.candidate_limits.size(); ++e) clear_candidate<R>(c, e, bits);
}

/// Forces, and where wanted stiffness, of the elements of a register that a finger has for itself; leaves their turned
/// shape gradients.
template <Want want, class R, bool own_volume = true, class Q>
inline void element_numbers(const Corotated<Q>& s, const Q& mu, const Q& lambda, const Q& pressure, Vec3<Q> r[3],
                            ElementNumbers<R>& out) {
    Vec3<Q> force[4];
    corotational_force(s, mu, pressure, force);
    ElementSums<Q> sums;
    for (std::size_t i = 0; i < 12; ++i) sums.number[i] = force[i / 3][int(i % 3)];
    if constexpr (want == Want::forces_and_matrix) {
        for (int a = 0; a < 3; ++a) r[a] = s.rotation * s.g[a];
        corotational_stiffness<own_volume>(s, r, mu, lambda, [&](int k, int i, int j, const Q& entry) {
            sums.number[ElementSums<Q>::stiffness + std::size_t(9 * k + 3 * i + j)] = entry;
        });
    }
    using Sums = ElementSums<Q>;
    turn_numbers<R, Q, Sums::count>(sums.number.data(), want == Want::forces ? Sums::stiffness : Sums::count,
                                    out.of_element.data());
}

/// Adds the elements of a register to several fingers. Element after element: what comes after the first one waits.
template <Want want, class R, bool own_volume, class Q>
inline void add_to_fingers(SkinChunk<ScalarOf<R>>& c, const ElementGroup<R, Q>& elements, const Corotated<Q>& s,
                           const Q& mu, const Q& lambda, const Q& pressure, Vec3<Q> r[3]) {
    constexpr int W = lane_width<R>, parts = ElementGroup<R, Q>::parts;
    static_assert(parts <= 2);
    Vec3<Q> force[4];
    corotational_force(s, mu, pressure, force);
    for (int k = 0; k < elements.count; ++k) {
        const auto& nodes = c.topology->elements[elements.first + std::size_t(k)];
        for (std::size_t a = 0; a < 4; ++a)
            add_vec3<R>(&c.scratch.gradient[std::size_t(3 * nodes[a] * W)], part_of<R>(force[a], k));
    }
    if constexpr (want == Want::forces_and_matrix) {
        for (int a = 0; a < 3; ++a) r[a] = s.rotation * s.g[a];
        auto* all = c.scratch.blocks.data();
        const auto& blocks = c.topology->element_block[elements.first];
        [[maybe_unused]] std::array<R, 90> waiting;  // of a second element
        corotational_stiffness<own_volume>(s, r, mu, lambda, [&](int k, int i, int j, const Q& entry) {
            auto* to = all + (9 * std::size_t(blocks[std::size_t(k)]) + std::size_t(3 * i + j)) * W;
            store<R>(to, load<R>(to) + part_of<R>(entry, 0));
            if constexpr (parts == 2) waiting[std::size_t(9 * k + 3 * i + j)] = high_part<R>(entry);
        });
        if (elements.count < 2) return;
        const auto& others = c.topology->element_block[elements.first + 1];
        for (std::size_t k = 0; k < 10; ++k) {
            auto* to = all + 9 * std::size_t(others[k]) * W;
            for (std::size_t i = 0; i < 9; ++i, to += W) store<R>(to, load<R>(to) + waiting[9 * k + i]);
        }
    }
}

/// Adds them to a finger alone, or to several.
template <Want want, class R, class Q, bool own_volume = true>
inline void add_corotated(SkinChunk<ScalarOf<R>>& c, const ElementGroup<R, Q>& elements, const Corotated<Q>& s,
                          const Q& mu, const Q& lambda, const Q& pressure, Vec3<Q> r[3]) {
    if constexpr (lane_width<R> != 1 || std::is_same_v<R, Q>) {
        add_to_fingers<want, R, own_volume>(c, elements, s, mu, lambda, pressure, r);
    } else {
        ElementNumbers<R> numbers;
        element_numbers<want, R, own_volume>(s, mu, lambda, pressure, r, numbers);
        for (int k = 0; k < elements.count; ++k)
            add_element<want, R>(c, elements.first + std::size_t(k), numbers.of(k));
    }
}

/// mu |S - I|^2 of elements, times their volumes [J].
template <class Q>
inline Q shape_energy(const Corotated<Q>& s, const Q& mu) {
    return s.volume * mu * squared_norm(s.strained);
}

/// Elasticity and strain limits of every element with a volume term of its own.
template <Want want, class R>
inline void add_corotational_elements(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    using Q = FilledRegister<R>;
    using T = ScalarOf<R>;
    const int count = int(c.topology->elements.size());
    constexpr int step = ElementGroup<R, Q>::parts;
    const Q exactness = repeat_part<Q>(request.exactness);
    begin_limits<R>(c, request.limits);
    for (int first = 0; first < count; first += step * rotations_at_once) {
        auto group = [&](int n) {
            const int begin = first + n * step;
            return ElementGroup<R, Q>(std::size_t(begin), std::min(step, count - begin));
        };
        Corotated<Q> state[rotations_at_once];
        const int groups = std::min(rotations_at_once, (count - first + step - 1) / step);
        corotate<R, Q>(c, groups, group, state);
        Q mus[rotations_at_once], lambdas[rotations_at_once];
        for (int n = 0; n < groups; ++n) {
            mus[n] = group(n).load(c.rest.mu), lambdas[n] = group(n).load(c.rest.lambda);
            if constexpr (want == Want::forces_and_matrix)
                weigh_turning(state[n], mus[n], lambdas[n] * state[n].stretch, exactness);
        }
        for (int n = 0; n < groups; ++n) {
            const ElementGroup<R, Q> elements = group(n);
            const Corotated<Q>& s = state[n];
            const Q &mu = mus[n], &lambda = lambdas[n], pressure = lambda * s.stretch;
            const Q energy = shape_energy(s, mu) + Q(T(0.5)) * s.volume * pressure * s.stretch;
            for (int k = 0; k < elements.count; ++k) out.energy += part_of<R>(energy, k);
            Vec3<Q> r[3];
            add_corotated<want, R, Q>(c, elements, s, mu, lambda, pressure, r);
            if (c.has_limits) note_limits<R, Q>(c, elements, s, request.watches);
        }
    }
}

}  // namespace palpate::detail
