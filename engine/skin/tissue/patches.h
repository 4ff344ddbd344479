#pragma once
// Corotational tissue whose elements share their change of volume in patches: linear tetrahedra that keep their volumes
// one by one lock near incompressibility, for there are more of them than a mesh has freedom; patches are fewer.
// Psi = sum over elements of volume mu |S - I|^2, + bulk/2 (sum over elements of volume tr(S - I))^2 per patch, with
// 1/bulk = sum of volume/lambda: the mean-dilatation method (Nagtegaal, Parks & Rice 1974; de Souza Neto et al. 2005,
// F-bar patches) with corotational strain.

#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// Deformation gradients of a patch's elements, decomposed.
template <class R>
struct PatchState {
    Mat3<R> F[most_patch_elements];
    SignedSvd<R> svd[most_patch_elements];
};

template <class R>
inline void decompose_patch(const SkinChunk<ScalarOf<R>>& c, const VolumePatch& p, PatchState<R>& out) {
    constexpr int W = lane_width<R>;
    auto guess = [&](int k) { return load_mat3<R>(&c.state.svd_guess[9 * std::size_t(p.first + k) * W]); };
    for (int k = 0; k < p.count; ++k) out.F[k] = element_deformation<R>(c, std::size_t(p.first + k));
    if constexpr (shares_register<R>) {
        constexpr int batch = lane_width<typename WholeRegister<R>::type> / W;
        for (int first = 0; first < p.count; first += batch) {
            const int n = std::min(batch, p.count - first);
            Mat3<R> guesses[batch];
            for (int k = 0; k < n; ++k) guesses[k] = guess(first + k);
            signed_svds<R>(out.F + first, guesses, n, out.svd + first);
        }
    } else {
        for (int k = 0; k < p.count; ++k) out.svd[k] = signed_svd(out.F[k], guess(k));
    }
}

/// Elasticity and strain limits of the elements of one patch.
template <Want want, class R>
inline void add_patch(SkinChunk<ScalarOf<R>>& c, std::size_t number, const ElementRequest<R>& request,
                      Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const VolumePatch& patch = t.patches[number];
    PatchState<R> s;
    decompose_patch<R>(c, patch, s);

    R dilatation(0);  // [m^3]
    for (int k = 0; k < patch.count; ++k) {
        const Vec3<R>& sigma = s.svd[k].sigma;
        dilatation += load<R>(&c.rest.volume[std::size_t(patch.first + k) * W]) * (sigma.x + sigma.y + sigma.z - R(3));
    }
    const R bulk = load<R>(&c.rest.patch_bulk[number * W]);
    const R pressure = bulk * dilatation;
    out.energy += R(T(0.5)) * pressure * dilatation;

    Vec3<R> slope[4 * most_patch_elements];  // of the dilatation, per node [m^2]
    for (int a = 0; a < patch.node_count; ++a) slope[a] = {R(0), R(0), R(0)};
    for (int k = 0; k < patch.count; ++k) {
        const auto e = std::size_t(patch.first + k);
        const SignedSvd<R>& svd = s.svd[k];
        Vec3<R> g[3], force[4];
        for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * std::size_t(a)) * W]);
        const R volume = load<R>(&c.rest.volume[e * W]), mu = load<R>(&c.rest.mu[e * W]);
        store_mat3<R>(&c.scratch.svd[9 * e * W], svd.V);
        const PrincipalTerms<R> elastic =
            blend_curvature(corotational<Curvature::exact>(svd.sigma, mu, R(0), pressure),
                            corotational<Curvature::positive>(svd.sigma, mu, R(0), pressure), request.exactness);
        out.energy += volume * elastic.energy;
        const PrincipalGradients<R> principal = principal_gradients(svd, g);
        principal_force(svd, principal, elastic.stress, volume, force);
        const auto& nodes = t.elements[e];
        for (int a = 0; a < 4; ++a) add_vec3<R>(&c.scratch.gradient[3 * nodes[a] * W], force[a]);
        if constexpr (want == Want::forces_and_matrix) {
            add_corotational_stiffness(svd, principal, elastic.twist, mu, R(0), volume, [&](int b) {
                return &c.scratch.blocks[std::size_t(t.element_block[e][std::size_t(b)]) * 9 * W];
            });
            for (int a = 0; a < 4; ++a) slope[t.element_place[e][a]] += volume * (svd.U * principal.ghat[a]);
        }
        if (!c.has_limits) continue;
        if (request.watches) watch_strain_limit(c, e, svd.sigma, request.watched, out);
        add_strain_limit<want>(c, e, s.F[k], svd, g, volume, request.limit_exactness, request.limits, out);
    }
    if constexpr (want == Want::forces_and_matrix) {
        const int* block = &t.patch_blocks[std::size_t(patch.first_block)];
        for (int a = 0; a < patch.node_count; ++a) {
            const Vec3<R> weighted = bulk * slope[a];
            for (int b = 0; b <= a; ++b, ++block)
                add_block<R>(c.scratch.blocks.data(), *block, outer(weighted, slope[b]));
        }
    }
}

template <Want want, class R>
inline void add_patches(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    for (std::size_t k = 0; k < c.topology->patches.size(); ++k) add_patch<want>(c, k, request, out);
}

}  // namespace palpate::detail
