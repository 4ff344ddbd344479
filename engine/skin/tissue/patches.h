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
    for (int a = 0; a < patch.node_count; ++a) {
        const Vec3<R> weighted = bulk * slope[a];
        for (int b = 0; b <= a; ++b, ++block) add_block<R>(c.scratch.blocks.data(), *block, outer(weighted, slope[b]));
    }
}

/// Elasticity of the elements of one patch; notes strain limits.
template <Want want, class R>
inline void add_patch(SkinChunk<ScalarOf<R>>& c, std::size_t number, const ElementRequest<R>& request,
                      Evaluation<R>& out) {
    using T = ScalarOf<R>;
    using Q = RegisterOf<R>;
    constexpr int W = lane_width<R>, step = elements_at_once<R>;
    const SkinTopology& t = *c.topology;
    const VolumePatch& patch = t.patches[number];
    auto group = [&](int k) {
        return ElementGroup<R, Q>(std::size_t(patch.first + k), std::min(step, patch.count - k));
    };
    Corotated<Q> state[(most_patch_elements + step - 1) / step];
    R dilatation(0);  // [m^3]
    const int groups = (patch.count + step - 1) / step;
    for (int n = 0; n < groups; n += rotations_at_once)
        corotate<R, Q>(
            c, std::min(rotations_at_once, groups - n), [&](int i) { return group((n + i) * step); }, state + n);
    for (int k = 0; k < patch.count; k += step) {
        const Corotated<Q>& s = state[k / step];
        const Q change = s.volume * s.stretch;
        for (int i = 0; i < std::min(step, patch.count - k); ++i) dilatation += part_of<R>(change, i);
    }
    const R bulk = load<R>(&c.rest.patch_bulk[number * W]), pressure = bulk * dilatation;
    out.energy += R(T(0.5)) * pressure * dilatation;

    Vec3<R> slope[4 * most_patch_elements];
    for (int a = 0; a < patch.node_count; ++a) slope[a] = {R(0), R(0), R(0)};
    for (int k = 0; k < patch.count; k += step) {
        const ElementGroup<R, Q> elements = group(k);
        const Corotated<Q>& s = state[k / step];
        const Q mu = elements.load(c.rest.mu), energy = shape_energy(s, mu);
        for (int i = 0; i < elements.count; ++i) out.energy += part_of<R>(energy, i);
        Vec3<Q> r[3];
        add_corotated<want, R, Q>(c, elements, s, mu, Q(0), repeat_part<Q>(pressure), repeat_part<Q>(request.exactness),
                                  r);
        if (c.has_limits) note_limits<R, Q>(c, elements, s, request.watches);
        if constexpr (want == Want::forces_and_matrix) {
            for (auto& v : r) v = s.volume * v;
            for (int i = 0; i < elements.count; ++i) {
                const auto& place = t.element_place[elements.first + std::size_t(i)];
                for (std::size_t a = 0; a < 3; ++a) {
                    const Vec3<R> of_node{part_of<R>(r[a].x, i), part_of<R>(r[a].y, i), part_of<R>(r[a].z, i)};
                    slope[place[a + 1]] += of_node;
                    slope[place[0]] -= of_node;
                }
            }
        }
    }
    if constexpr (want == Want::forces_and_matrix) add_patch_blocks<R>(c, patch, slope, bulk);
}

template <Want want, class R>
inline void add_patches(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    begin_limits<R>(c, request.limits);
    for (std::size_t k = 0; k < c.topology->patches.size(); ++k) add_patch<want>(c, k, request, out);
}

}  // namespace palpate::detail
