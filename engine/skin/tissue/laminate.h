#pragma once
// Skin that is thinner than the elements it lies in. Layers that lie on each other share their strain along the skin
// and their stress across it: an element that holds several is as stiff along the skin as their mean, across it and in
// transverse shear as soft as they are in series (Voigt's and Reuss's means; Jones 1999, Mechanics of Composite
// Materials, 4). The element itself has the latter; what it lacks along the skin is a membrane, smeared over its
// volume: Psi = mu |S - I|^2 + lambda/2 tr(S - I)^2 in plane stress, with F T = R S for its two tangents T. Flat
// triangles that keep their stretches one by one are too stiff to be bent into another shape (membrane locking: they
// are more than a mesh has freedom), so that patches of skin have one S, the mean of their elements'.

#include <algorithm>

#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// F T and what follows of it. R = (a + b x n, b + n x a) / (sigma_1 + sigma_2): the polar factor of a 3x2 matrix.
template <class R>
struct MembraneState {
    Vec3<R> a, b;    ///< columns of F T
    Vec3<R> ra, rb;  ///< of its rotation
    Vec3<R> normal;  ///< of the plane that they span
    R trace;         ///< sigma_1 + sigma_2
    R S[3];          ///< R^T F T: 11, 12, 22
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
    s.S[0] = dot(s.ra, a), s.S[1] = R(T(0.5)) * (dot(s.ra, b) + dot(s.rb, a)), s.S[2] = dot(s.rb, b);
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

/// X of S X + X S = M, symmetric 2x2 matrices (11, 12, 22), for M = (1, 0, 0), (0, 1/2, 0) and (0, 0, 1):
/// M : dS = 2 X : F_T^T dF_T, with F_T = F T and S^2 = F_T^T F_T.
template <class R>
inline void membrane_slopes(const R S[3], R X[3][3]) {
    using T = ScalarOf<R>;
    const R determinant = maximum(S[0] * S[2] - S[1] * S[1], R(T(1e-4)));
    const R scale = R(T(0.5)) / ((S[0] + S[2]) * determinant);  // X = scale (det M + adj(S) M adj(S))
    const R a = S[2], b = -S[1], c = S[0];                      // adj(S)
    X[0][0] = scale * (determinant + a * a), X[0][1] = scale * (a * b), X[0][2] = scale * (b * b);
    X[1][0] = scale * (a * b), X[1][1] = scale * (R(T(0.5)) * (determinant + a * c + b * b)), X[1][2] = scale * (b * c);
    X[2][0] = scale * (b * b), X[2][1] = scale * (b * c), X[2][2] = scale * (determinant + c * c);
}

/// Elements whose membranes resist their mean stretch: a patch, or one alone.
struct MembraneGroup {
    const int* elements;
    const std::array<int, 4>* place;  ///< of their nodes among the group's; -1: does not move what is in the skin
    int count;
    const int* nodes;
    const int* blocks;  ///< of the nodes' pairs 00, 10, 11, 20, ...
    int node_count;
};

/// What a group's mean stretch costs: mu |S - I|^2 + lambda/2 tr(S - I)^2, moduli times volumes [N m].
template <class R>
struct MeanMembrane {
    R mu, lambda, over_mu;
    R stress[3];  ///< dE/dS: 11, 12, 22
};

/// Adds forces, and the stiffness that is an element's own; `slope` gets the group's dS/dx.
template <Want want, class R>
inline void add_group_element(SkinChunk<ScalarOf<R>>& c, const MembraneGroup& group, int i, const MembraneState<R>& s,
                              const MeanMembrane<R>& mean, const R& exactness, Vec3<R> (*slope)[3]) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const auto e = std::size_t(group.elements[i]);
    const auto& place = group.place[i];
    const R weight = mean.over_mu * load<R>(&c.rest.volume[e * W]) * load<R>(&c.rest.membrane_mu[e * W]), two(2);
    const R half(T(0.5)), zero(0);
    R p[4][2];  // gradients of the shape functions along the tangents
    for (int k = 0; k < 2; ++k) {
        const Vec3<R> tangent = load_vec3<R>(&c.rest.membrane_tangents[(6 * e + 3 * std::size_t(k)) * W]);
        for (int a = 1; a < 4; ++a)
            p[a][k] = dot(load_vec3<R>(&c.rest.shape_gradients[(9 * e + 3 * std::size_t(a - 1)) * W]), tangent);
        p[0][k] = -(p[1][k] + p[2][k] + p[3][k]);
    }
    R X[3][3], x[3];  // of the components of S; of the stress
    membrane_slopes(s.S, X);
    for (int k = 0; k < 3; ++k)
        x[k] = mean.stress[0] * X[0][k] + two * mean.stress[1] * X[1][k] + mean.stress[2] * X[2][k];
    const R twice = two * weight;
    const Vec3<R> P[2] = {twice * (x[0] * s.a + x[1] * s.b), twice * (x[1] * s.a + x[2] * s.b)};
    for (std::size_t a = 0; a < 4; ++a)
        if (place[a] >= 0)
            add_vec3<R>(&c.scratch.gradient[std::size_t(3 * group.nodes[place[a]] * W)],
                        p[a][0] * P[0] + p[a][1] * P[1]);
    if constexpr (want == Want::forces_and_matrix) {
        Vec3<R> own[4][3];  // dS/dx, of the element
        for (int k = 0; k < 3; ++k) {
            const Vec3<R> Q[2] = {two * (X[k][0] * s.a + X[k][1] * s.b), two * (X[k][1] * s.a + X[k][2] * s.b)};
            for (int a = 0; a < 4; ++a) {
                own[a][k] = p[a][0] * Q[0] + p[a][1] * Q[1];
                if (const int at = place[std::size_t(a)]; at >= 0) slope[at][k] += weight * own[a][k];
            }
        }
        // What the stress adds: out of the plane 2 X; within it, with dF_T = R (dS + w J S), J the quarter turn,
        // w^2 stress : S + 2 w dS : Z, Z = J S X - X S J. Where the matrix is to be positive, without what is not.
        R bend[3] = {two * x[0], two * x[1], two * x[2]}, positive[3] = {bend[0], bend[1], bend[2]};
        keep_positive_part(positive);
        for (int k = 0; k < 3; ++k) bend[k] = weight * (positive[k] + exactness * (bend[k] - positive[k]));
        R turn = mean.stress[0] * s.S[0] + two * mean.stress[1] * s.S[1] + mean.stress[2] * s.S[2];
        turn = weight * (maximum(turn, zero) + exactness * minimum(turn, zero));
        const R u11 = s.S[0] * x[0] + s.S[1] * x[1], u12 = s.S[0] * x[1] + s.S[1] * x[2],
                u21 = s.S[1] * x[0] + s.S[2] * x[1], u22 = s.S[1] * x[1] + s.S[2] * x[2];
        const R mixed = weight * exactness;
        const R z[3] = {mixed * (-two * u21), mixed * (two * (u11 - u22)), mixed * (two * u12)};
        Vec3<R> turned[4], crossed[4];
        for (int a = 0; a < 4; ++a) {
            turned[a] = (R(1) / s.trace) * (p[a][0] * s.rb - p[a][1] * s.ra);
            crossed[a] = half * turn * turned[a] + z[0] * own[a][0] + z[1] * own[a][1] + z[2] * own[a][2];
        }
        for (int a = 0; a < 4; ++a) {
            const int at = place[std::size_t(a)];
            if (at < 0) continue;
            const R bent[2] = {bend[0] * p[a][0] + bend[1] * p[a][1], bend[1] * p[a][0] + bend[2] * p[a][1]};
            for (int b = 0; b < 4; ++b) {
                const int before = place[std::size_t(b)];
                if (before < 0 || before > at) continue;
                const Vec3<R> along = (bent[0] * p[b][0] + bent[1] * p[b][1]) * s.normal;
                T* to = c.scratch.blocks.data() + std::size_t(group.blocks[at * (at + 1) / 2 + before]) * 9 * W;
                for (int k = 0; k < 3; ++k)
                    for (int j = 0; j < 3; ++j, to += W)
                        store<R>(to, load<R>(to) + (along[k] * s.normal[j] + turned[a][k] * crossed[b][j] +
                                                    crossed[a][k] * turned[b][j]));
            }
        }
    }
}

/// Membranes of one group.
template <Want want, class R>
inline void add_membrane_group(SkinChunk<ScalarOf<R>>& c, const MembraneGroup& group, const R& exactness,
                               Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const R one(1), two(2), half(T(0.5));
    MembraneState<R> state[most_membrane_elements];
    MeanMembrane<R> mean{R(0), R(0), R(0), {R(0), R(0), R(0)}};
    R strain[3] = {R(0), R(0), R(0)};
    for (int i = 0; i < group.count; ++i) {
        const auto e = std::size_t(group.elements[i]);
        const Mat3<R> F = element_deformation<R>(c, e);
        const MembraneState<R>& s = state[i] =
            membrane_state(F * load_vec3<R>(&c.rest.membrane_tangents[6 * e * W]),
                           F * load_vec3<R>(&c.rest.membrane_tangents[(6 * e + 3) * W]));
        const R volume = load<R>(&c.rest.volume[e * W]), weight = volume * load<R>(&c.rest.membrane_mu[e * W]);
        mean.mu += weight, mean.lambda += volume * load<R>(&c.rest.membrane_lambda[e * W]);
        strain[0] += weight * (s.S[0] - one), strain[1] += weight * s.S[1], strain[2] += weight * (s.S[2] - one);
    }
    mean.over_mu = one / maximum(mean.mu, R(T(1e-30)));  // a finger without, beside fingers with membranes
    for (R& e : strain) e = mean.over_mu * e;
    const R stretch = strain[0] + strain[2];
    out.energy += mean.mu * (strain[0] * strain[0] + two * strain[1] * strain[1] + strain[2] * strain[2]) +
                  half * mean.lambda * stretch * stretch;
    for (int k = 0; k < 3; ++k) mean.stress[k] = two * mean.mu * strain[k] + (k == 1 ? R(0) : mean.lambda * stretch);
    Vec3<R> slope[4 * most_membrane_elements][3];
    if constexpr (want == Want::forces_and_matrix)
        for (int a = 0; a < group.node_count; ++a)
            for (auto& v : slope[a]) v = {R(0), R(0), R(0)};
    for (int i = 0; i < group.count; ++i) add_group_element<want>(c, group, i, state[i], mean, exactness, slope);
    if constexpr (want == Want::forces_and_matrix) {
        const R moduli[3] = {mean.mu + mean.lambda, mean.mu, R(4) * mean.mu};  // of tr S, S11 - S22, S12
        const int* block = group.blocks;
        for (int a = 0; a < group.node_count; ++a) {
            const Vec3<R> xx = slope[a][0], yy = slope[a][2];
            slope[a][0] = xx + yy, slope[a][2] = slope[a][1], slope[a][1] = xx - yy;
            Vec3<R> weighted[3];
            for (int k = 0; k < 3; ++k) weighted[k] = moduli[k] * slope[a][k];
            for (int b = 0; b <= a; ++b, ++block) {
                T* to = c.scratch.blocks.data() + std::size_t(*block) * 9 * W;
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j, to += W)
                        store<R>(to, load<R>(to) + (weighted[0][i] * slope[b][0][j] + weighted[1][i] * slope[b][1][j] +
                                                    weighted[2][i] * slope[b][2][j]));
            }
        }
    }
}

/// Whether any finger of the chunk has a membrane in an element.
template <class R>
inline bool has_membrane(const SkinChunk<ScalarOf<R>>& c, int e) {
    return any(load<R>(&c.rest.membrane_mu[std::size_t(e * lane_width<R>)]) > R(0));
}

/// The membranes of all elements that hold several layers.
template <Want want, class R>
inline void add_membranes(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    const SkinTopology& t = *c.topology;
    for (const MembranePatch& p : t.membrane_patches) {
        const int* elements = &t.membrane_elements[std::size_t(p.first)];
        if (std::none_of(elements, elements + p.count, [&](int e) { return has_membrane<R>(c, e); })) continue;
        const MembraneGroup group{elements,
                                  &t.membrane_place[std::size_t(p.first)],
                                  p.count,
                                  &t.membrane_nodes[std::size_t(p.first_node)],
                                  &t.membrane_blocks[std::size_t(p.first_block)],
                                  p.node_count};
        add_membrane_group<want>(c, group, exactness, out);
    }
    const std::array<int, 4> places{0, 1, 2, 3};
    for (int e = 0; e < int(t.elements.size()); ++e) {
        if ((!t.in_membrane_patch.empty() && t.in_membrane_patch[std::size_t(e)]) || !has_membrane<R>(c, e)) continue;
        const MembraneGroup alone{
            &e, &places, 1, t.elements[std::size_t(e)].data(), t.element_block[std::size_t(e)].data(), 4};
        add_membrane_group<want>(c, alone, exactness, out);
    }
}

}  // namespace palpate::detail
