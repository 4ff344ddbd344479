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

// --- strain limits of patches ----------------------------------------------------------------------------------------
// On the stretches of F = sum of volume F_e / sum of volume: as with volumes, limits on every tetrahedron would be more
// than a mesh has freedom, and it saturates too early and in spots.

template <class R>
inline Mat3<R> patch_deformation(const SkinChunk<ScalarOf<R>>& c, const VolumePatch& patch) {
    constexpr int W = lane_width<R>;
    Mat3<R> sum = Mat3<R>::zero();
    R volume(0);
    for (int k = patch.first; k < patch.first + patch.count; ++k) {
        const R part = load<R>(&c.rest.volume[std::size_t(k * W)]);
        sum = sum + part * element_deformation<R>(c, std::size_t(k));
        volume += part;
    }
    return (R(1) / volume) * sum;
}

/// Notes a patch that may be at its limit, or bears its multiplier.
template <class R>
inline void note_patch_limit(SkinChunk<ScalarOf<R>>& c, std::size_t number, const Mat3<R>& volume_times_F,
                             const R& volume, bool watches) {
    constexpr int W = lane_width<R>;
    const std::size_t e = c.topology->elements.size() + number;
    const R low = load<R>(&c.rest.limit_low[e * W]), high = load<R>(&c.rest.limit_high[e * W]);
    const Mat3<R> F = (R(1) / volume) * volume_times_F;
    const Vec3<R> x = F.column(0), y = F.column(1), z = F.column(2);
    const Symmetric3<R> C{dot(x, x), dot(x, y), dot(y, y), dot(x, z), dot(y, z), dot(z, z)};
    const MaskOf<R> within = positive_definite(plus_diagonal(-(low * low), C)) &
                             positive_definite(plus_diagonal(high * high, R(-1) * C)) & (dot(x, cross(y, z)) > R(0));
    const unsigned lanes = (bits_from_mask<R>(!within) & ((1u << W) - 1)) | loaded_lanes<R>(c, e);
    if (lanes != 0 || watches) c.scratch.noted_limits.push_back({int(e), lanes});
}

/// The limit of one patch in the masked lanes.
template <Want want, class R>
inline void add_patch_limit(SkinChunk<ScalarOf<R>>& c, std::size_t number, const Mat3<R>& F, const SignedSvd<R>& svd,
                            const R& exactness, MaskOf<R> lanes, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const VolumePatch& patch = t.patches[number];
    Vec3<R> slope[4 * most_patch_elements];  // volume dF/dx of each node [m^2]
    for (int a = 0; a < patch.node_count; ++a) slope[a] = {R(0), R(0), R(0)};
    R volume(0);
    for (int k = patch.first; k < patch.first + patch.count; ++k) {
        const auto e = std::size_t(k);
        const R part = load<R>(&c.rest.volume[e * W]);
        volume += part;
        for (std::size_t a = 0; a < 3; ++a) {
            const Vec3<R> g = part * load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * a) * W]);
            slope[t.element_place[e][a + 1]] += g;
            slope[t.element_place[e][0]] -= g;
        }
    }
    add_limit(
        c, t.elements.size() + number, F, svd, volume, exactness, lanes, out,
        [&](const Mat3<R>& stress, const Mat3<R>& change, const SignedSvd<R>& at, const PrincipalTerms<R>& terms) {
            for (int a = 0; a < patch.node_count; ++a) {
                const auto i = std::size_t(3 * t.patch_nodes[std::size_t(patch.first_node + a)] * W);
                add_vec3<R>(&c.scratch.gradient[i], stress * slope[a]);
                add_vec3<R>(&c.scratch.pending[i], change * slope[a]);
            }
            if constexpr (want == Want::forces_and_matrix) {
                for (int a = 0; a < patch.node_count; ++a) slope[a] = transposed_times(at.V, slope[a]);
                const int* block = &t.patch_blocks[std::size_t(patch.first_block)];
                const R one_over = R(1) / volume;
                for (int a = 0; a < patch.node_count; ++a) {
                    const Vec3<R> of_a = one_over * slope[a];
                    for (int b = 0; b <= a; ++b, ++block) {
                        const Mat3<R> local = principal_block(terms, of_a, slope[b]);
                        add_block<R>(c.scratch.blocks.data(), *block, times_transposed(at.U * local, at.U));
                    }
                }
            }
        });
}

/// Limits of the elements and patches that were noted.
template <Want want, class R>
inline void add_noted_patch_limits(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    const SkinTopology& t = *c.topology;
    const std::size_t elements = t.elements.size();
    take_noted_limits<R>(
        c,
        [&](std::size_t limit) {
            return limit < elements ? element_deformation<R>(c, limit)
                                    : patch_deformation<R>(c, t.patches[limit - elements]);
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
    const bool limited = c.has_limits && t.patches_limited;
    R volume(0);
    Mat3<R> deformation = Mat3<R>::zero();  // times volume
    const int groups = (patch.count + step - 1) / step;
    for (int n = 0; n < groups; n += rotations_at_once)
        corotate<R, Q>(
            c, std::min(rotations_at_once, groups - n), [&](int i) { return group((n + i) * step); }, state + n);
    for (int k = 0; k < patch.count; k += step) {
        const Corotated<Q>& s = state[k / step];
        const Q change = s.volume * s.stretch;
        for (int i = 0; i < std::min(step, patch.count - k); ++i) dilatation += part_of<R>(change, i);
        if (!limited) continue;
        const Mat3<Q> F = s.volume * (s.strained + s.rotation);
        for (int i = 0; i < std::min(step, patch.count - k); ++i) {
            volume += part_of<R>(s.volume, i);
            for (int d = 0; d < 9; ++d) deformation.m[d / 3][d % 3] += part_of<R>(F.m[d / 3][d % 3], i);
        }
    }
    const R bulk = load<R>(&c.rest.patch_bulk[number * W]), pressure = bulk * dilatation;
    out.energy += R(T(0.5)) * pressure * dilatation;
    if (limited) note_patch_limit<R>(c, number, deformation, volume, request.watches);

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
    if (!c.has_limits) return;
    if (c.topology->patches_limited)
        add_noted_patch_limits<want>(c, request, out);
    else
        add_noted_limits<want>(c, request, out);
}

}  // namespace palpate::detail
