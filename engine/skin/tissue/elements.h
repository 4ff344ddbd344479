#pragma once
// Elasticity and strain limits of the elements of a chunk: energy, gradient, positive definite Newton matrix.

#include <algorithm>
#include <limits>

#include "engine/math/pose.h"
#include "engine/skin/chunks/chunk.h"
#include "engine/skin/solve/fitted.h"
#include "engine/skin/solve/lane_progress.h"
#include "engine/skin/tissue/isotropic.h"

namespace palpate::detail {

template <class R>
inline void add_block(ScalarOf<R>* blocks, int b, const Mat3<R>& K) {
    ScalarOf<R>* p = blocks + static_cast<std::size_t>(b) * 9 * lane_width<R>;
    store_mat3<R>(p, load_mat3<R>(p) + K);
}
template <class R>
inline void add_vec3(ScalarOf<R>* p, const Vec3<R>& a) {
    store_vec3<R>(p, load_vec3<R>(p) + a);
}

template <class R>
inline Pose<R> load_pose(const ScalarOf<R>* p) {
    constexpr int W = lane_width<R>;
    return {load_vec3<R>(p), {load<R>(p + 3 * W), load<R>(p + 4 * W), load<R>(p + 5 * W), load<R>(p + 6 * W)}};
}
template <class R>
inline void store_pose(ScalarOf<R>* p, const Pose<R>& pose) {
    constexpr int W = lane_width<R>;
    store_vec3<R>(p, pose.position);
    store<R>(p + 3 * W, pose.rotation.w);
    store<R>(p + 4 * W, pose.rotation.x);
    store<R>(p + 5 * W, pose.rotation.y);
    store<R>(p + 6 * W, pose.rotation.z);
}

/// Sum of the squares of a matrix's entries.
template <class R>
inline R squared_norm(const Mat3<R>& A) {
    R squared(0);
    for (int i = 0; i < 9; ++i) squared += A.m[i / 3][i % 3] * A.m[i / 3][i % 3];
    return squared;
}

/// Penalty of a strain limit: it grows with the multiplier, so that the augmented Lagrangian stays convex
/// against buckling, and so that T keeps two positive singular values (svd3.h allows one negative) however strong the
/// compression.
template <class R>
inline R limit_penalty(const Mat3<R>& multiplier, const R& low, const R& base) {
    const R norm = square_root(squared_norm(multiplier));
    return maximum(base, R(ScalarOf<R>(fitted::penalty_over_multiplier)) * norm / low);
}

/// What an evaluation is asked for: forces alone where no linear solve follows; forces, and what contact adds to the
/// matrix, where tissue's part of it is kept (kept_matrix.h).
enum class Want { forces, forces_and_contacts, forces_and_matrix };

/// Adds the nodal forces of an element's stress to an array [node][xyz].
template <class R>
inline void scatter_stress(const Mat3<R>& P, const Vec3<R> g[3], const R& volume, const std::array<int, 4>& nodes,
                           ScalarOf<R>* out) {
    constexpr int W = lane_width<R>;
    Vec3<R> gradient[4];
    for (auto& v : gradient) v = {R(0), R(0), R(0)};
    add_gradient(P, g, volume, gradient);
    for (int a = 0; a < 4; ++a) add_vec3<R>(&out[3 * nodes[a] * W], gradient[a]);
}

/// Stiffness of any isotropic energy of one element.
template <class R>
inline void add_general_stiffness(SkinChunk<ScalarOf<R>>& c, std::size_t e, const SignedSvd<R>& svd,
                                  const PrincipalTerms<R>& terms, const Vec3<R> g[3], const R& volume) {
    ElementBlocks<R> blocks;
    for (auto& block : blocks.block) block = Mat3<R>::zero();
    add_stiffness(svd, terms, g, volume, blocks);
    for (int b = 0; b < 10; ++b)
        add_block<R>(c.scratch.blocks.data(), c.topology->element_block[e][b], blocks.block[b]);
}

/// Makes a limit's updated multiplier zero in some lanes.
template <class R>
inline void clear_candidate(SkinChunk<ScalarOf<R>>& c, std::size_t e, unsigned lanes) {
    std::uint16_t& kept = c.scratch.candidate_limits[e];
    if ((kept & lanes) == 0) return;
    kept &= std::uint16_t(~lanes);
    auto* candidate = &c.scratch.limit_candidate[9 * e * lane_width<R>];
    store_mat3<R>(candidate, select(mask_from_bits<R>(lanes), Mat3<R>::zero(), load_mat3<R>(candidate)));
}

/// Writes a limit's updated multiplier in the masked lanes.
template <class R>
inline void keep_candidate(SkinChunk<ScalarOf<R>>& c, std::size_t e, const Mat3<R>& stress, MaskOf<R> lanes) {
    auto* candidate = &c.scratch.limit_candidate[9 * e * lane_width<R>];
    store_mat3<R>(candidate, select(lanes, stress, load_mat3<R>(candidate)));
    MaskOf<R> none = R(0) <= R(0);
    for (int i = 0; i < 9; ++i) none = none & (absolute(stress.m[i / 3][i % 3]) <= R(0));
    const unsigned bits = bits_from_mask<R>(lanes), zero = bits_from_mask<R>(none);
    std::uint16_t& kept = c.scratch.candidate_limits[e];
    kept = std::uint16_t((kept & ~bits) | (bits & ~zero));
}

/// Strain limit number e in the masked lanes: of an element, or a patch, that has the deformation gradient F.
/// Writes the updated multiplier; `act(stress, change since the multiplier, its decomposition, terms)` adds to gradient
/// and blocks.
template <class R, class Act>
inline void add_limit(SkinChunk<ScalarOf<R>>& c, std::size_t e, const Mat3<R>& F, const SignedSvd<R>& svd,
                      const R& volume, const R& exactness, MaskOf<R> lanes, Evaluation<R>& out, Act act) {
    constexpr int W = lane_width<R>;
    const R low = load<R>(&c.rest.limit_low[e * W]), high = load<R>(&c.rest.limit_high[e * W]);
    const Vec3<R>& s = svd.sigma;
    const MaskOf<R> beyond =
        lanes & ((s[0] > high) | (s[1] > high) | (s[2] > high) | (s[0] < low) | (s[1] < low) | (s[2] < low));
    if (any(beyond)) {
        R excess(0);
        for (int i = 0; i < 3; ++i) excess = maximum(maximum((s[i] - high) / high, (low - s[i]) / low), excess);
        out.violation = maximum(select(lanes, excess, R(0)), out.violation);
    }
    Mat3<R> multiplier = Mat3<R>::zero();
    R largest(0);
    if (!c.limits.unloaded) {
        multiplier = load_mat3<R>(&c.state.limit_multiplier[9 * e * W]);
        for (int i = 0; i < 9; ++i) largest = maximum(absolute(multiplier.m[i / 3][i % 3]), largest);
    }
    const MaskOf<R> loaded = lanes & (largest > R(0));
    if (!any(loaded | beyond)) return clear_candidate<R>(c, e, bits_from_mask<R>(lanes));
    multiplier = select(lanes, multiplier, Mat3<R>::zero());
    c.limits.met = true;
    c.limits.candidates_clear = false;
    const R k =
        limit_penalty(multiplier, low, load<R>(&c.rest.limit_penalty[e * W]) * load<R>(&c.state.penalty_scale[0]));
    SignedSvd<R> shifted = svd;
    if (any(loaded)) {
        const SignedSvd<R> own = signed_svd(F + (R(1) / k) * multiplier, svd.V);
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                shifted.U[i][j] = select(loaded, own.U[i][j], svd.U[i][j]);
                shifted.V[i][j] = select(loaded, own.V[i][j], svd.V[i][j]);
            }
            shifted.sigma[i] = select(loaded, own.sigma[i], svd.sigma[i]);
        }
    }
    for (int i = 0; i < 3; ++i) shifted.sigma[i] = select(lanes, shifted.sigma[i], R(1));  // no terms elsewhere
    const PrincipalTerms<R> terms =
        blend_curvature(strain_limit<Curvature::exact>(shifted.sigma, low, high, k),
                        strain_limit<Curvature::positive>(shifted.sigma, low, high, k), exactness);
    const Mat3<R> stress = principal_to_matrix(shifted, terms.stress);
    act(stress, stress - multiplier, shifted, terms);
    out.energy += volume * (terms.energy - R(ScalarOf<R>(0.5)) / k * squared_norm(multiplier));
    out.limited += select(dot(terms.stress, terms.stress) > R(0), R(1), R(0));
    for (int i = 0; i < 3; ++i)
        out.limits_met += select(absolute(terms.stress[i]) > R(0), R(ScalarOf<R>(3 * e + std::size_t(i) + 1)), R(0));
    keep_candidate(c, e, stress, lanes);
}

/// Strain limit of one element.
template <Want want, class R>
inline void add_strain_limit(SkinChunk<ScalarOf<R>>& c, std::size_t e, const Mat3<R>& F, const SignedSvd<R>& svd,
                             const Vec3<R> g[3], const R& volume, const R& exactness, MaskOf<R> lanes,
                             Evaluation<R>& out) {
    const auto& nodes = c.topology->elements[e];
    add_limit(
        c, e, F, svd, volume, exactness, lanes, out,
        [&](const Mat3<R>& stress, const Mat3<R>& change, const SignedSvd<R>& at, const PrincipalTerms<R>& terms) {
            scatter_stress(stress, g, volume, nodes, c.scratch.gradient.data());
            scatter_stress(change, g, volume, nodes, c.scratch.pending.data());
            if constexpr (want == Want::forces_and_matrix) add_general_stiffness(c, e, at, terms, g, volume);
        });
}

/// Elasticity of any material, from its terms with exact and with positive curvature.
template <Want want, class R>
inline void add_elasticity(SkinChunk<ScalarOf<R>>& c, std::size_t e, const SignedSvd<R>& svd, const Vec3<R> g[3],
                           const R& volume, const PrincipalTerms<R>& exact, const PrincipalTerms<R>& positive,
                           const R& exactness, Evaluation<R>& out) {
    const PrincipalTerms<R> terms = blend_all_curvature(exact, positive, exactness);
    out.energy += volume * terms.energy;
    scatter_stress(principal_to_matrix(svd, terms.stress), g, volume, c.topology->elements[e],
                   c.scratch.gradient.data());
    if constexpr (want == Want::forces_and_matrix) add_general_stiffness(c, e, svd, terms, g, volume);
}

/// Gradient of a nodal array in an element.
template <class R>
inline Mat3<R> element_gradient(const SkinChunk<ScalarOf<R>>& c, const LaneArray<ScalarOf<R>>& nodal, std::size_t e) {
    constexpr int W = lane_width<R>;
    Vec3<R> x[4], g[3];
    for (int a = 0; a < 4; ++a) x[a] = load_vec3<R>(&nodal[3 * c.topology->elements[e][a] * W]);
    for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * a) * W]);
    return deformation_gradient(x, g);
}
template <class R>
inline Mat3<R> element_deformation(const SkinChunk<ScalarOf<R>>& c, std::size_t e) {
    return element_gradient<R>(c, c.state.position, e);
}

/// Notes for the masked lanes whether an element, or a patch, is near limit number e, or held by it; how near the
/// others are.
template <class R>
inline void watch_strain_limit(SkinChunk<ScalarOf<R>>& c, std::size_t e, const Vec3<R>& sigma, MaskOf<R> lanes,
                               Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const R low = load<R>(&c.rest.limit_low[e * W]), high = load<R>(&c.rest.limit_high[e * W]);
    R margin(std::numeric_limits<T>::max()), largest(0);
    for (int i = 0; i < 3; ++i) margin = minimum(minimum(high - sigma[i], sigma[i] - low), margin);
    if (!c.limits.unloaded)
        for (int i = 0; i < 9; ++i)
            largest = maximum(absolute(load<R>(&c.state.limit_multiplier[(9 * e + std::size_t(i)) * W])), largest);
    const MaskOf<R> near = (margin < R(T(fitted::watched_margin))) | (largest > R(0));
    T* watched = &c.linear.watched[e * W];
    store<R>(watched, select(lanes, select(near, R(1), R(0)), load<R>(watched)));
    out.margin = minimum(select(near, out.margin, margin), out.margin);
}

/// What each lane's elements are asked for.
template <class R>
struct ElementRequest {
    MaskOf<R> limits;     ///< strain limits, too
    R exactness;          ///< of the curvature of elasticity
    R limit_exactness;    ///< and of limits
    MaskOf<R> watched{};  ///< which of their elements are near a limit
    bool watches = false;
};

/// Elasticity and strain limit of one element with deformation gradient F, of a material that needs its stretches
/// (corotational.h has the one that does not).
template <Want want, class R>
inline void add_element(SkinChunk<ScalarOf<R>>& c, std::size_t e, const Mat3<R>& F, const SignedSvd<R>& svd,
                        const ElementRequest<R>& request, Evaluation<R>& out) {
    const R& exactness = request.exactness;
    constexpr int W = lane_width<R>;
    Vec3<R> g[3];
    for (int a = 0; a < 3; ++a) g[a] = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * a) * W]);
    const R volume = load<R>(&c.rest.volume[e * W]);
    store_mat3<R>(&c.scratch.svd[9 * e * W], svd.V);

    const R mu = load<R>(&c.rest.mu[e * W]), lambda = load<R>(&c.rest.lambda[e * W]);
    if (c.material == Material::saint_venant_kirchhoff)
        add_elasticity<want>(c, e, svd, g, volume, saint_venant_kirchhoff<Curvature::exact>(svd.sigma, mu, lambda),
                             saint_venant_kirchhoff<Curvature::positive>(svd.sigma, mu, lambda), exactness, out);
    else
        add_elasticity<want>(c, e, svd, g, volume, neo_hookean<Curvature::exact>(svd.sigma, mu, lambda),
                             neo_hookean<Curvature::positive>(svd.sigma, mu, lambda), exactness, out);
    if (!c.has_limits) return;
    if (request.watches) watch_strain_limit(c, e, svd.sigma, request.watched, out);
    add_strain_limit<want>(c, e, F, svd, g, volume, request.limit_exactness, request.limits, out);
}

/// Elasticity and strain limit of every element. Where a register takes several elements, they are decomposed
/// together: a decomposition alone is one long chain of operations that wait for each other.
template <Want want, class R>
inline void add_elements(SkinChunk<ScalarOf<R>>& c, const ElementRequest<R>& request, Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const std::size_t count = c.topology->elements.size();
    if constexpr (shares_register<R>) {
        constexpr int batch = lane_width<typename WholeRegister<R>::type> / W;
        Mat3<R> F[batch], guess[batch];
        SignedSvd<R> svd[batch];
        for (std::size_t first = 0; first < count; first += batch) {
            const int n = int(std::min<std::size_t>(batch, count - first));
            for (int k = 0; k < n; ++k) {
                F[k] = element_deformation<R>(c, first + k);
                guess[k] = load_mat3<R>(&c.state.svd_guess[9 * (first + k) * W]);
            }
            signed_svds<R>(F, guess, n, svd);
            for (int k = 0; k < n; ++k) add_element<want>(c, first + k, F[k], svd[k], request, out);
        }
    } else {
        for (std::size_t e = 0; e < count; ++e) {
            const Mat3<R> F = element_deformation<R>(c, e);
            add_element<want>(c, e, F, signed_svd(F, load_mat3<R>(&c.state.svd_guess[9 * e * W])), request, out);
        }
    }
}

}  // namespace palpate::detail
