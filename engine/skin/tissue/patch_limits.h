#pragma once
// Strain limits of patches: on the stretches of their mean deformation gradient, F = sum of volume F_e / sum of volume.
// Limits on every tetrahedron are more than a mesh has freedom: it saturates too early, in spots, and at another depth
// with each mesh. A finger has the same number of these patches whatever its mesh, so that what saturates is as large
// in all of them.

#include "engine/skin/tissue/corotational.h"

namespace palpate::detail {

/// Whether all principal stretches of F are between the limits, and none is turned inside out: without decomposing it.
template <class R>
inline MaskOf<R> is_within_limits(const Mat3<R>& F, const R& low, const R& high) {
    const Vec3<R> x = F.column(0), y = F.column(1), z = F.column(2);
    const Symmetric3<R> C{dot(x, x), dot(x, y), dot(y, y), dot(x, z), dot(y, z), dot(z, z)};
    return positive_definite(plus_diagonal(-(low * low), C)) &
           positive_definite(plus_diagonal(high * high, R(-1) * C)) & (dot(x, cross(y, z)) > R(0));
}

/// Gradient of a nodal array in a patch: sum over nodes of x (volume dF/dx) / volume, with x from the patch's first
/// node, as rounding is of what is added.
template <class R>
inline Mat3<R> patch_gradient(const SkinChunk<ScalarOf<R>>& c, const LaneArray<ScalarOf<R>>& nodal,
                              std::size_t number) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const LimitPatch& patch = t.limit_patches[number];
    const int* nodes = &t.limit_nodes[std::size_t(patch.first_node)];
    const ScalarOf<R>* slopes = &c.rest.limit_slopes[std::size_t(3 * patch.first_node * W)];
    const Vec3<R> first = load_vec3<R>(&nodal[std::size_t(3 * nodes[0] * W)]);
    Mat3<R> F = Mat3<R>::zero();
    for (int a = 1; a < patch.node_count; ++a)
        F = F + outer(load_vec3<R>(&nodal[std::size_t(3 * nodes[a] * W)]) - first, load_vec3<R>(slopes + 3 * a * W));
    return (R(1) / load<R>(&c.rest.limit_volume[number * W])) * F;
}

/// Its mean deformation gradient.
template <class R>
inline Mat3<R> patch_deformation(const SkinChunk<ScalarOf<R>>& c, std::size_t number) {
    return patch_gradient<R>(c, c.state.position, number);
}

/// Notes the patches that may be at their limits, or bear multipliers.
template <class R>
inline void note_patch_limits(SkinChunk<ScalarOf<R>>& c, bool watches) {
    constexpr int W = lane_width<R>;
    const std::size_t elements = c.topology->elements.size();
    for (std::size_t k = 0; k < c.topology->limit_patches.size(); ++k) {
        const std::size_t limit = elements + k;
        const R low = load<R>(&c.rest.limit_low[limit * W]), high = load<R>(&c.rest.limit_high[limit * W]);
        const Mat3<R> F = patch_deformation<R>(c, k);
        const MaskOf<R> within = is_within_limits(F, low, high);
        const unsigned lanes = (bits_from_mask<R>(!within) & ((1u << W) - 1)) | loaded_lanes<R>(c, limit);
        if (lanes != 0 || watches) c.scratch.noted_limits.push_back({int(limit), lanes});
    }
}

/// The limit of one patch in the masked lanes.
template <Want want, class R>
inline void add_patch_limit(SkinChunk<ScalarOf<R>>& c, std::size_t number, const Mat3<R>& F, const SignedSvd<R>& svd,
                            const R& exactness, MaskOf<R> lanes, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const LimitPatch& patch = t.limit_patches[number];
    const int* nodes = &t.limit_nodes[std::size_t(patch.first_node)];
    const ScalarOf<R>* slopes = &c.rest.limit_slopes[std::size_t(3 * patch.first_node * W)];
    const R volume = load<R>(&c.rest.limit_volume[number * W]);
    add_limit(
        c, t.elements.size() + number, F, svd, volume, exactness, lanes, out,
        [&](const Mat3<R>& stress, const Mat3<R>& change, const SignedSvd<R>& at, const PrincipalTerms<R>& terms) {
            for (int a = 0; a < patch.node_count; ++a) {
                const Vec3<R> slope = load_vec3<R>(slopes + 3 * a * W);
                add_vec3<R>(&c.scratch.gradient[std::size_t(3 * nodes[a] * W)], stress * slope);
                add_vec3<R>(&c.scratch.pending[std::size_t(3 * nodes[a] * W)], change * slope);
            }
            if constexpr (want == Want::forces_and_matrix) {
                const int* block = &t.limit_blocks[std::size_t(patch.first_block)];
                const R one_over = R(1) / volume;
                for (int a = 0; a < patch.node_count; ++a) {
                    const Vec3<R> of_a = one_over * transposed_times(at.V, load_vec3<R>(slopes + 3 * a * W));
                    for (int b = 0; b <= a; ++b, ++block) {
                        const Vec3<R> of_b = transposed_times(at.V, load_vec3<R>(slopes + 3 * b * W));
                        const Mat3<R> local = principal_block(terms, of_a, of_b);
                        add_block<R>(c.scratch.blocks.data(), *block, times_transposed(at.U * local, at.U));
                    }
                }
            }
        });
}

/// Limits of the elements, and patches, that were noted.
template <Want want, class R>
inline void add_noted_limits(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    const std::size_t elements = c.topology->elements.size();
    take_noted_limits<R>(
        c,
        [&](std::size_t limit) {
            return limit < elements ? element_deformation<R>(c, limit) : patch_deformation<R>(c, limit - elements);
        },
        [&](const NotedLimit& note, const Mat3<R>& F, const SignedSvd<R>& svd) {
            const auto limit = std::size_t(note.limit);
            if (limit < elements) return add_noted_limit<want>(c, note, F, svd, request, out);
            if (request.watches) watch_strain_limit(c, limit, svd.sigma, request.watched, out);
            if (note.lanes == 0) return;
            add_patch_limit<want>(c, limit - elements, F, svd, request.limit_exactness,
                                  request.limits & mask_from_bits<R>(note.lanes), out);
        });
}

}  // namespace palpate::detail
