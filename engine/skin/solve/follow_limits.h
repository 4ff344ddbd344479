#pragma once
// Strain limits that a direction would run into. A limit that does not act where the direction was computed is not in
// the Newton matrix; a long step then ends at the first of them, the next one, which knows it, at another, and where
// one lets go as soon as it is known, the iteration goes round between the two for ever. So the direction is corrected
// for those that it would exceed, on the same linearised tissue: each is a spring k max(0, excess) along the gradient
// a of its principal stretch, whose answer H^-1 a is one more solve with the factor at hand (Woodbury 1950); their
// forces follow of a small linear complementarity problem (projected Gauss-Seidel; Cottle, Pang & Stone 1992, ch. 5).

#include "engine/skin/solve/direction.h"

namespace palpate::detail {

/// A principal stretch of a lane that would exceed its limit.
template <class R>
struct Wall {
    using T = ScalarOf<R>;
    std::size_t limit = 0;
    int axis = 0;
    T sign{1};         ///< 1: above the upper bound; -1: below the lower
    T stiffness{0};    ///< volume times penalty [N m]
    T excess{0};       ///< beyond the bound at the end of Newton's own direction
    T force{0};        ///< volume times stress [N m]
    Vec3<T> u{}, v{};  ///< its principal directions
};

/// What one lane's direction would run into.
template <class R>
struct Walls {
    using T = ScalarOf<R>;
    std::size_t count = 0;
    std::array<Wall<R>, fitted::most_walls> wall;
    std::array<std::array<T, fitted::most_walls>, fitted::most_walls> answer;  ///< [j][m] how much excess of j a force
                                                                               ///< of m takes away [1/(N m)]
};

/// Where a node is, from the bone's position.
template <class R>
inline Vec3<ScalarOf<R>> arm_of(const SkinChunk<ScalarOf<R>>& c, int node, int lane) {
    constexpr std::size_t W = lane_width<R>;
    const auto l = std::size_t(lane);
    Vec3<ScalarOf<R>> arm;
    for (std::size_t d = 0; d < 3; ++d)
        arm[int(d)] = c.state.position[(3 * std::size_t(node) + d) * W + l] - c.state.bone[d * W + l];
    return arm;
}

/// Calls visit(node, volume dF/dx over volume) for each node of a limit, of one lane.
template <class R, class Visit>
inline void for_each_limit_slope(const SkinChunk<ScalarOf<R>>& c, std::size_t limit, int lane, Visit visit) {
    using T = ScalarOf<R>;
    const SkinTopology& t = *c.topology;
    constexpr std::size_t W = lane_width<R>;
    const auto l = std::size_t(lane);
    const std::size_t elements = t.elements.size();
    auto vec = [&](const auto& a, std::size_t i) {
        return Vec3<T>{a[i * W + l], a[(i + 1) * W + l], a[(i + 2) * W + l]};
    };
    if (limit >= elements) {
        const LimitPatch& patch = t.limit_patches[limit - elements];
        const T over = T(1) / c.rest.limit_volume[(limit - elements) * W + l];
        for (int a = 0; a < patch.node_count; ++a)
            visit(t.limit_nodes[std::size_t(patch.first_node + a)],
                  over * vec(c.rest.limit_slopes, 3 * std::size_t(patch.first_node + a)));
        return;
    }
    Vec3<T> sum{T(0), T(0), T(0)};
    for (std::size_t a = 1; a < 4; ++a) {
        const Vec3<T> g = vec(c.rest.shape_gradients, 9 * limit + 3 * (a - 1));
        sum += g;
        visit(t.elements[limit][a], g);
    }
    visit(t.elements[limit][0], -sum);
}

/// Adds scale times the gradient of a wall's stretch, over all unknowns, to a lane's right-hand side.
template <class R>
inline void add_wall_gradient(SkinChunk<ScalarOf<R>>& c, const Wall<R>& wall, int lane, ScalarOf<R> scale) {
    using T = ScalarOf<R>;
    const SkinTopology& t = *c.topology;
    constexpr std::size_t W = lane_width<R>;
    const auto l = std::size_t(lane);
    auto add = [&](int unknown, const Vec3<T>& f) {
        for (std::size_t d = 0; d < 3; ++d)
            c.scratch.permuted[(3 * std::size_t(t.elimination[std::size_t(unknown)]) + d) * W + l] += f[int(d)];
    };
    for_each_limit_slope<R>(c, wall.limit, lane, [&](int node, const Vec3<T>& slope) {
        const Vec3<T> f = (scale * dot(slope, wall.v)) * wall.u;
        if (t.elimination[std::size_t(node)] >= 0) return add(node, f);
        add(t.bone_position, f);
        add(t.bone_rotation, torque_of(arm_of<R>(c, node, lane), f));
    });
}

/// How fast a wall's stretch grows along a lane's displacement in scratch.permuted.
template <class R>
inline ScalarOf<R> along_wall(const SkinChunk<ScalarOf<R>>& c, const Wall<R>& wall, int lane) {
    using T = ScalarOf<R>;
    const SkinTopology& t = *c.topology;
    constexpr std::size_t W = lane_width<R>;
    const auto l = std::size_t(lane);
    auto of = [&](int unknown) {
        const T* p = &c.scratch.permuted[3 * std::size_t(t.elimination[std::size_t(unknown)]) * W + l];
        return Vec3<T>{p[0], p[W], p[2 * W]};
    };
    T sum(0);
    for_each_limit_slope<R>(c, wall.limit, lane, [&](int node, const Vec3<T>& slope) {
        const bool is_free = t.elimination[std::size_t(node)] >= 0;
        const Vec3<T> moved =
            is_free ? of(node) : of(t.bone_position) + cross(of(t.bone_rotation), arm_of<R>(c, node, lane));
        sum += dot(slope, wall.v) * dot(wall.u, moved);
    });
    return sum;
}

/// Bone nodes move along the direction as the bone does.
template <class R>
inline void direct_bone_nodes(SkinChunk<ScalarOf<R>>& c) {
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Vec3<R> origin = load_vec3<R>(c.state.bone.data());
    const Vec3<R> dp = load_vec3<R>(&c.scratch.direction[t.bone_position * W3]);
    const Vec3<R> dr = load_vec3<R>(&c.scratch.direction[t.bone_rotation * W3]);
    for (int node : t.bone_nodes)
        store_vec3<R>(&c.scratch.direction[node * W3],
                      dp + cross(dr, load_vec3<R>(&c.state.position[node * W3]) - origin));
}

/// The wall of each lane that its direction runs into hardest, of those that it has not met yet. Returns the lanes
/// that have one.
template <class R>
inline unsigned find_walls(const SkinChunk<ScalarOf<R>>& c, unsigned lanes, const Walls<R>* met, Wall<R>* hardest) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const std::size_t elements = t.elements.size();
    unsigned found = 0;
    T energy[W];
    for (T& e : energy) e = T(0);
    for (std::size_t limit = 0; limit < t.limit_count(); ++limit) {
        auto of = [&](const LaneArray<T>& nodal) {
            return limit < elements ? element_gradient<R>(c, nodal, limit)
                                    : patch_gradient<R>(c, nodal, limit - elements);
        };
        const R low = load<R>(&c.rest.limit_low[limit * W]), high = load<R>(&c.rest.limit_high[limit * W]);
        const Mat3<R> F = of(c.state.position), change = of(c.scratch.direction);
        const MaskOf<R> within = is_within_limits(F + change, low, high);
        const unsigned loaded = loaded_lanes<R>(c, limit);
        const unsigned near = ((bits_from_mask<R>(!within) & ((1u << W) - 1)) | loaded) & lanes;
        if (near == 0) continue;
        Mat3<R> multiplier = Mat3<R>::zero();
        if (loaded != 0) multiplier = load_mat3<R>(&c.state.limit_multiplier[9 * limit * W]);
        const R k = limit_penalty(multiplier, low,
                                  load<R>(&c.rest.limit_penalty[limit * W]) * load<R>(&c.state.penalty_scale[0]));
        const SignedSvd<R> svd = signed_svd(F + (R(1) / k) * multiplier);
        const R volume =
            load<R>(limit < elements ? &c.rest.volume[limit * W] : &c.rest.limit_volume[(limit - elements) * W]);
        for (int i = 0; i < 3; ++i) {
            const Vec3<R> u = svd.U.column(i), v = svd.V.column(i);
            const R tau = svd.sigma[i], end = tau + dot(u, change * v);
            const MaskOf<R> idle = (tau >= low) & (tau <= high);
            const R excess = maximum(end - high, low - end);
            const R costs = volume * k * excess * excess;
            const unsigned hits = bits_from_mask<R>(idle & (excess > R(0))) & near;
            for (int l = 0; l < W; ++l) {
                if (!((hits >> l) & 1u) || !(lane(costs, l) > energy[l])) continue;
                bool known = false;
                for (std::size_t j = 0; j < met[l].count; ++j)
                    known |= met[l].wall[j].limit == limit && met[l].wall[j].axis == i;
                if (known) continue;
                energy[l] = lane(costs, l);
                found |= 1u << l;
                Wall<R>& w = hardest[l];
                w.limit = limit, w.axis = i, w.force = T(0);
                w.sign = lane(end, l) > lane(high, l) ? T(1) : T(-1);
                w.stiffness = lane(volume * k, l), w.excess = lane(excess, l);
                for (int d = 0; d < 3; ++d) w.u[d] = lane(u[d], l), w.v[d] = lane(v[d], l);
            }
        }
    }
    return found;
}

/// Forces of a lane's walls.
template <class R>
inline void balance_walls(Walls<R>& walls) {
    using T = ScalarOf<R>;
    for (int sweep = 0; sweep < fitted::wall_sweeps; ++sweep)
        for (std::size_t j = 0; j < walls.count; ++j) {
            Wall<R>& w = walls.wall[j];
            T excess = w.excess;
            for (std::size_t m = 0; m < walls.count; ++m)
                if (m != j) excess -= walls.answer[j][m] * walls.wall[m].force;
            w.force = std::max(T(0), excess / (T(1) / w.stiffness + walls.answer[j][j]));
        }
}

/// Takes a lane's newest wall up, whose answer is in scratch.permuted, and finds the forces of all anew: what has
/// changed of each is in `change`.
template <class R>
inline void take_wall(const SkinChunk<ScalarOf<R>>& c, const Wall<R>& newest, int lane, Walls<R>& walls,
                      std::array<ScalarOf<R>, fitted::most_walls>& change) {
    const std::size_t j = walls.count++;
    walls.wall[j] = newest;
    for (std::size_t m = 0; m <= j; ++m)
        walls.answer[m][j] = walls.answer[j][m] = walls.wall[m].sign * along_wall<R>(c, walls.wall[m], lane);
    // Its excess was that of the direction as it is now.
    for (std::size_t m = 0; m < j; ++m) walls.wall[j].excess += walls.answer[j][m] * walls.wall[m].force;
    for (std::size_t m = 0; m <= j; ++m) change[m] = -walls.wall[m].force;
    balance_walls<R>(walls);
    for (std::size_t m = 0; m <= j; ++m) change[m] += walls.wall[m].force;
}

/// Corrects the direction of the masked lanes for the limits that it would exceed. Returns the slope.
template <class R>
inline R follow_limits(SkinChunk<ScalarOf<R>>& c, MaskOf<R> lanes, R slope) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    unsigned left = bits_from_mask<R>(lanes & (slope < R(0))) & ((1u << W) - 1), corrected = 0;
    if (!c.has_limits || left == 0) return slope;
    Walls<R> walls[W];
    Wall<R> hardest[W];
    std::array<T, fitted::most_walls> change[W];
    auto clear = [&] { std::fill(c.scratch.permuted.begin(), c.scratch.permuted.end(), T(0)); };
    auto for_each_left = [&](auto visit) {
        for (int l = 0; l < W; ++l)
            if ((left >> l) & 1u) visit(l);
    };
    direct_bone_nodes<R>(c);
    for (int round = 0; round < fitted::most_walls; ++round) {
        left = find_walls<R>(c, left, walls, hardest);
        if (left == 0) break;
        if (corrected == 0) {
            c.scratch.first_direction = c.scratch.direction;
            (void)factor_matrix<R>(c);  // contacts that were followed may have changed it since, or a neighbour's may
        }
        corrected |= left;
        clear();
        for_each_left([&](int l) { add_wall_gradient<R>(c, hardest[l], l, hardest[l].sign); });
        solve_matrix<R>(c);
        for_each_left([&](int l) { take_wall<R>(c, hardest[l], l, walls[l], change[l]); });
        clear();
        for_each_left([&](int l) {
            for (std::size_t m = 0; m < walls[l].count; ++m)
                add_wall_gradient<R>(c, walls[l].wall[m], l, -walls[l].wall[m].sign * change[l][m]);
        });
        solve_matrix<R>(c);
        const MaskOf<R> mask = mask_from_bits<R>(left);
        for (int i : t.unknowns) {
            T* direction = &c.scratch.direction[3 * i * W];
            const Vec3<R> old = load_vec3<R>(direction);
            store_vec3<R>(direction,
                          select(mask, old + load_vec3<R>(&c.scratch.permuted[3 * t.elimination[i] * W]), old));
        }
        direct_bone_nodes<R>(c);
    }
    if (corrected == 0) return slope;
    const R corrected_slope = slope_of<R>(c);
    const MaskOf<R> taken = mask_from_bits<R>(corrected) & (corrected_slope < R(0));
    for (std::size_t i = 0; i < c.scratch.direction.size(); i += W)
        store<R>(&c.scratch.direction[i],
                 select(taken, load<R>(&c.scratch.direction[i]), load<R>(&c.scratch.first_direction[i])));
    return select(taken, corrected_slope, slope);
}

}  // namespace palpate::detail
