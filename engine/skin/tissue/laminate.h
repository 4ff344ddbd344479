#pragma once
// Skin that is thinner than the elements it lies in. Layers that lie on each other share their strain along the skin
// and their stress across it: an element that holds several is as stiff along the skin as their mean, across it and in
// transverse shear as soft as they are in series (Voigt's and Reuss's means; Jones 1999, Mechanics of Composite
// Materials, 4). The element itself has the latter; what it lacks along the skin is a membrane, smeared over its
// volume: Psi = mu |S - I|^2 + lambda/2 tr(S - I)^2 in plane stress, with F T = R S for its two tangents T.

#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// F T and what follows of it. R = (a + b x n, b + n x a) / (sigma_1 + sigma_2): the polar factor of a 3x2 matrix.
template <class R>
struct MembraneState {
    Vec3<R> a, b;    ///< columns of F T
    Vec3<R> ra, rb;  ///< of its rotation
    Vec3<R> normal;  ///< of the plane that they span
    R trace;         ///< sigma_1 + sigma_2
    R inverse[3];    ///< of S: 11, 12, 22
};

template <class R>
inline MembraneState<R> membrane_state(const Vec3<R>& a, const Vec3<R>& b) {
    using T = ScalarOf<R>;
    MembraneState<R> s;
    s.a = a, s.b = b;
    const Vec3<R> across = cross(a, b);
    // Flattened to a line, a membrane has no normal; limits keep tissue far from there.
    const R area = maximum(norm(across), R(T(1e-4)));
    s.normal = (R(1) / area) * across;
    s.trace = square_root(dot(a, a) + dot(b, b) + R(2) * area);
    const R inverse = R(1) / s.trace;
    s.ra = inverse * (a + cross(b, s.normal));
    s.rb = inverse * (b + cross(s.normal, a));
    const R over_area = R(1) / area;
    s.inverse[0] = over_area * dot(s.rb, b);
    s.inverse[1] = -over_area * (R(T(0.5)) * (dot(s.ra, b) + dot(s.rb, a)));
    s.inverse[2] = over_area * dot(s.ra, a);
    return s;
}

/// A symmetric 2x2 matrix (11, 12, 22) without its negative eigenvalues.
template <class R>
inline void keep_positive_part(R m[3]) {
    using T = ScalarOf<R>;
    const R half(T(0.5)), zero(0);
    const R mean = half * (m[0] + m[2]), difference = half * (m[0] - m[2]);
    const R radius = square_root(difference * difference + m[1] * m[1]);
    const R above = maximum(mean + radius, zero), below = maximum(mean - radius, zero);
    const R scale = half * (above - below) / maximum(radius, R(std::numeric_limits<T>::min()));
    const R middle = half * (above + below);
    m[0] = middle + scale * difference;
    m[1] = scale * m[1];
    m[2] = middle - scale * difference;
}

/// The membrane of one element.
template <Want want, class R>
inline void add_membrane(SkinChunk<ScalarOf<R>>& c, std::size_t e, const R& mu, const R& exactness,
                         Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Mat3<R> F = element_deformation<R>(c, e);
    const Vec3<R> tangent[2] = {load_vec3<R>(&c.rest.membrane_tangents[6 * e * W]),
                                load_vec3<R>(&c.rest.membrane_tangents[(6 * e + 3) * W])};
    const R lambda = load<R>(&c.rest.membrane_lambda[e * W]), volume = load<R>(&c.rest.volume[e * W]);
    const MembraneState<R> s = membrane_state(F * tangent[0], F * tangent[1]);
    const R half(T(0.5)), two(2), stretch = s.trace - two;
    out.energy +=
        volume * (mu * (dot(s.a, s.a) + dot(s.b, s.b) - two * s.trace + two) + half * lambda * stretch * stretch);

    // P = 2 mu F T + kappa R; gradients of the shape functions along the tangents, p.
    const R kappa = lambda * stretch - two * mu;
    R p[4][2];
    for (int a = 1; a < 4; ++a) {
        const Vec3<R> g = load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * std::size_t(a - 1)) * W]);
        for (int k = 0; k < 2; ++k) p[a][k] = dot(g, tangent[k]);
    }
    for (int k = 0; k < 2; ++k) p[0][k] = -(p[1][k] + p[2][k] + p[3][k]);
    const Vec3<R> stress[2] = {volume * (two * mu * s.a + kappa * s.ra), volume * (two * mu * s.b + kappa * s.rb)};
    const auto& nodes = t.elements[e];
    for (int a = 0; a < 4; ++a)
        add_vec3<R>(&c.scratch.gradient[3 * nodes[std::size_t(a)] * W], p[a][0] * stress[0] + p[a][1] * stress[1]);
    if constexpr (want == Want::forces_and_matrix) {
        // Within the plane: 2 mu, lambda on R, and the turn within it; out of the plane 2 mu I + kappa S^-1.
        auto blend = [&](const R& exact, const R& positive) { return positive + exactness * (exact - positive); };
        const R turn = two * (mu + lambda) * stretch / s.trace;
        const R turn_weight = half * volume * (blend(turn, maximum(turn, R(0))) - two * mu);
        R exact[3], bend[3];
        for (int k = 0; k < 3; ++k) exact[k] = bend[k] = kappa * s.inverse[k] + (k == 1 ? R(0) : two * mu);
        keep_positive_part(bend);
        for (int k = 0; k < 3; ++k) bend[k] = volume * blend(exact[k], bend[k]);
        Vec3<R> stretched[4], turned[4];
        for (int a = 0; a < 4; ++a) {
            stretched[a] = p[a][0] * s.ra + p[a][1] * s.rb;
            turned[a] = p[a][1] * s.ra - p[a][0] * s.rb;
        }
        for (int a = 0, k = 0; a < 4; ++a) {
            const Vec3<R> weighted = volume * lambda * stretched[a], weighted_turn = turn_weight * turned[a];
            const R bent[2] = {bend[0] * p[a][0] + bend[1] * p[a][1], bend[1] * p[a][0] + bend[2] * p[a][1]};
            for (int b = 0; b <= a; ++b, ++k) {
                const R within = two * mu * volume * (p[a][0] * p[b][0] + p[a][1] * p[b][1]);
                const R out_of_plane = bent[0] * p[b][0] + bent[1] * p[b][1];
                const Vec3<R> along_normal = (out_of_plane - within) * s.normal;
                Mat3<R> K;
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j)
                        K.m[i][j] = weighted[i] * stretched[b][j] + weighted_turn[i] * turned[b][j] +
                                    along_normal[i] * s.normal[j] + (i == j ? within : R(0));
                add_block<R>(c.scratch.blocks.data(), t.element_block[e][std::size_t(k)], K);
            }
        }
    }
}

/// The membranes of all elements that hold several layers.
template <Want want, class R>
inline void add_membranes(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    for (std::size_t e = 0; e < c.topology->elements.size(); ++e) {
        const R mu = load<R>(&c.rest.membrane_mu[e * std::size_t(lane_width<R>)]);
        if (any(mu > R(0))) add_membrane<want>(c, e, mu, exactness, out);
    }
}

}  // namespace palpate::detail
