#pragma once
// Corotational tissue whose elements share their change of volume in patches: linear tetrahedra that keep their volumes
// one by one lock near incompressibility, for there are more of them than a mesh has freedom; patches are fewer.
// Psi = sum over elements of volume mu |S - I|^2, + bulk/2 (sum over elements of volume tr(S - I))^2 per patch, with
// 1/bulk = sum of volume/lambda: the mean-dilatation method (Nagtegaal, Parks & Rice 1974; de Souza Neto et al. 2005,
// F-bar patches) with corotational strain.

#include "engine/skin/tissue/corotational.h"

namespace palpate::detail {

/// Adds the volume term's part that couples the nodes of a patch: bulk times the outer product of the dilatation's
/// slope [m^2] with itself.
template <class R>
inline void add_patch_blocks(SkinChunk<ScalarOf<R>>& c, const VolumePatch& patch, const Vec3<R>* slope, const R& bulk) {
    const int* block = &c.topology->patch_blocks[std::size_t(patch.first_block)];
    if constexpr (std::is_same_v<R, RegisterOf<R>>) {
        for (int a = 0; a < patch.node_count; ++a) {
            const Vec3<R> weighted = bulk * slope[a];
            for (int b = 0; b <= a; ++b, ++block)
                add_block<R>(c.scratch.blocks.data(), *block, outer(weighted, slope[b]));
        }
    } else {
        // Of a finger alone, eight of a block's nine numbers in a register (or two) as they lie in memory.
        using T = ScalarOf<R>;
        using Row = HalfRegister<T>;
        constexpr std::size_t side = sizeof(Row) / sizeof(T);
        T* blocks = c.scratch.blocks.data();
        alignas(64) std::array<std::array<T, 8>, 4 * most_patch_elements> across;
        for (std::size_t a = 0; a < std::size_t(patch.node_count); ++a)
            for (std::size_t i = 0; i < 8; ++i) across[a][i] = lane(slope[a][int(i % 3)], 0);
        for (std::size_t a = 0; a < std::size_t(patch.node_count); ++a) {
            const Vec3<R> weighted = bulk * slope[a];
            // Made in registers: what was just stored in parts cannot be loaded at once.
            const T x = lane(weighted.x, 0), y = lane(weighted.y, 0), last = lane(weighted.z, 0);
            Row down[8 / side];
            if constexpr (side == 8)
                down[0] = Row{x, x, x, y, y, y, last, last};
            else
                down[0] = Row{x, x, x, y}, down[1] = Row{y, y, last, last};
            for (std::size_t b = 0; b <= a; ++b, ++block) {
                T* to = blocks + 9 * std::size_t(*block);
                for (std::size_t i = 0; i < 8; i += side) {
                    Row sum, right;
                    std::memcpy(&sum, to + i, sizeof(Row));
                    std::memcpy(&right, &across[b][i], sizeof(Row));
                    sum += down[i / side] * right;
                    std::memcpy(to + i, &sum, sizeof(Row));
                }
                to[8] += last * across[b][2];
            }
        }
    }
}

/// Elasticity of the elements of one patch of several fingers; notes strain limits.
template <Want want, class R>
inline void add_patch(SkinChunk<ScalarOf<R>>& c, std::size_t number, const ElementRequest<R>& request,
                      Evaluation<R>& out) {
    using T = ScalarOf<R>;
    using Q = FilledRegister<R>;
    constexpr int W = lane_width<R>, step = ElementGroup<R, Q>::parts;
    const SkinTopology& t = *c.topology;
    const VolumePatch& patch = t.patches[number];
    const int groups = (patch.count + step - 1) / step;
    auto group = [&](int n) {
        return ElementGroup<R, Q>(std::size_t(patch.first + n * step), std::min(step, patch.count - n * step));
    };
    Corotated<Q> state[(most_patch_elements + step - 1) / step];
    for (int n = 0; n < groups; n += rotations_at_once)
        corotate<R, Q>(
            c, std::min(rotations_at_once, groups - n), [&](int i) { return group(n + i); }, state + n);
    R dilatation(0);  // [m^3]
    for (int n = 0; n < groups; ++n) {
        const Q change = state[n].volume * state[n].stretch;
        for (int k = 0; k < group(n).count; ++k) dilatation += part_of<R>(change, k);
    }
    const R bulk = load<R>(&c.rest.patch_bulk[number * W]), pressure = bulk * dilatation;
    out.energy += R(T(0.5)) * pressure * dilatation;

    Vec3<R> slope[4 * most_patch_elements];
    for (int a = 0; a < patch.node_count; ++a) slope[a] = {R(0), R(0), R(0)};
    const Q of_patch = repeat_part<Q>(pressure), exactness = repeat_part<Q>(request.exactness);
    if constexpr (want == Want::forces_and_matrix)
        for (int n = 0; n < groups; ++n) weigh_turning(state[n], group(n).load(c.rest.mu), of_patch, exactness);
    for (int n = 0; n < groups; ++n) {
        const ElementGroup<R, Q> elements = group(n);
        const Corotated<Q>& s = state[n];
        const Q mu = elements.load(c.rest.mu), energy = shape_energy(s, mu);
        for (int k = 0; k < elements.count; ++k) out.energy += part_of<R>(energy, k);
        Vec3<Q> r[3];
        add_corotated<want, R, Q, false>(c, elements, s, mu, Q(0), of_patch, r);
        if (c.has_limits) note_limits<R, Q>(c, elements, s, request.watches);
        if constexpr (want == Want::forces_and_matrix) {
            const Vec3<Q> turned[3] = {s.volume * r[0], s.volume * r[1], s.volume * r[2]};
            for (int k = 0; k < elements.count; ++k) {
                const auto& place = t.element_place[elements.first + std::size_t(k)];
                for (std::size_t a = 0; a < 3; ++a) {
                    const Vec3<R> of_node = part_of<R>(turned[a], k);
                    slope[place[a + 1]] += of_node;
                    slope[place[0]] -= of_node;
                }
            }
        }
    }
    if constexpr (want == Want::forces_and_matrix) add_patch_blocks<R>(c, patch, slope, bulk);
}

/// The same of patches `first` to `last` (not with it) of a finger alone, whose elements follow each other: registers
/// are filled with elements of several patches, and all is added up in the order in which one patch after the other
/// would be.
template <Want want, class R>
inline void add_patches_of_one(SkinChunk<ScalarOf<R>>& c, std::size_t first, std::size_t last,
                               const ElementRequest<R>& request, Evaluation<R>& out) {
    using T = ScalarOf<R>;
    using Q = RegisterOf<R>;
    constexpr int step = elements_at_once<R>, most = step * rotations_at_once;
    static_assert(lane_width<R> == 1 && most >= most_patch_elements);
    const SkinTopology& t = *c.topology;
    const int begin = t.patches[first].first, count = t.patches[last - 1].first + t.patches[last - 1].count - begin;
    auto group = [&](int n) {
        return ElementGroup<R, Q>(std::size_t(begin + n * step), std::min(step, count - n * step));
    };
    const int groups = (count + step - 1) / step;
    Corotated<Q> state[rotations_at_once];
    corotate<R, Q>(c, groups, group, state);
    Q mu[rotations_at_once];
    alignas(64) std::array<T, most> change, energy, pressure;  // of elements
    std::array<R, most> bulk;                                  // of patches
    for (int n = 0; n < groups; ++n) {
        mu[n] = group(n).load(c.rest.mu);
        store<Q>(&change[std::size_t(n * step)], state[n].volume * state[n].stretch);
        store<Q>(&energy[std::size_t(n * step)], shape_energy(state[n], mu[n]));
    }
    for (std::size_t number = first; number < last; ++number) {
        const VolumePatch& patch = t.patches[number];
        const auto at = std::size_t(patch.first - begin), end = at + std::size_t(patch.count);
        R dilatation(0);  // [m^3]
        for (std::size_t e = at; e < end; ++e) dilatation += R(change[e]);
        bulk[number - first] = load<R>(&c.rest.patch_bulk[number]);
        const R of_patch = bulk[number - first] * dilatation;
        out.energy += R(T(0.5)) * of_patch * dilatation;
        for (std::size_t e = at; e < end; ++e) out.energy += R(energy[e]), pressure[e] = lane(of_patch, 0);
    }
    std::fill(pressure.begin() + count, pressure.begin() + groups * step, pressure[std::size_t(count - 1)]);
    if constexpr (want == Want::forces_and_matrix)
        for (int n = 0; n < groups; ++n)
            weigh_turning(state[n], mu[n], load<Q>(&pressure[std::size_t(n * step)]),
                          repeat_part<Q>(request.exactness));

    std::size_t number = first;
    Vec3<R> slope[4 * most_patch_elements];
    auto clear_slope = [&] {
        for (int a = 0; a < t.patches[number].node_count; ++a) slope[a] = {R(0), R(0), R(0)};
    };
    if constexpr (want == Want::forces_and_matrix) clear_slope();
    for (int n = 0; n < groups; ++n) {
        const ElementGroup<R, Q> elements = group(n);
        const Corotated<Q>& s = state[n];
        Vec3<Q> r[3];
        ElementNumbers<R> numbers;
        element_numbers<want, R, false>(s, mu[n], Q(0), load<Q>(&pressure[std::size_t(n * step)]), r, numbers);
        alignas(64) std::array<T, std::size_t(9 * step)> turned;  // volume R g
        if constexpr (want == Want::forces_and_matrix)
            for (std::size_t i = 0; i < 9; ++i)
                store<Q>(&turned[i * std::size_t(step)], s.volume * r[i / 3][int(i % 3)]);
        for (int k = 0; k < elements.count; ++k) {
            const std::size_t e = elements.first + std::size_t(k);
            add_element<want, R>(c, e, numbers.of(k));
            if constexpr (want == Want::forces_and_matrix) {
                const auto& place = t.element_place[e];
                auto part = [&](std::size_t i) { return R(turned[i * std::size_t(step) + std::size_t(k)]); };
                for (std::size_t a = 0; a < 3; ++a) {
                    const Vec3<R> of_node{part(3 * a), part(3 * a + 1), part(3 * a + 2)};
                    slope[place[a + 1]] += of_node;
                    slope[place[0]] -= of_node;
                }
                const VolumePatch& patch = t.patches[number];
                if (int(e) + 1 < patch.first + patch.count) continue;
                add_patch_blocks<R>(c, patch, slope, bulk[number - first]);
                if (++number < last) clear_slope();
            }
        }
        if (c.has_limits) note_limits<R, Q>(c, elements, s, request.watches);
    }
}

template <Want want, class R>
inline void add_patches(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    begin_limits<R>(c, request.limits);
    const auto& patches = c.topology->patches;
    if constexpr (std::is_same_v<R, RegisterOf<R>>) {
        for (std::size_t k = 0; k < patches.size(); ++k) add_patch<want>(c, k, request, out);
    } else {
        constexpr int most = elements_at_once<R> * rotations_at_once;
        for (std::size_t first = 0, last; first < patches.size(); first = last) {
            const int begin = patches[first].first;
            for (last = first + 1; last < patches.size(); ++last) {
                const VolumePatch &before = patches[last - 1], &next = patches[last];
                if (next.first != before.first + before.count || next.first + next.count - begin > most) break;
            }
            add_patches_of_one<want>(c, first, last, request, out);
        }
    }
}

}  // namespace palpate::detail
