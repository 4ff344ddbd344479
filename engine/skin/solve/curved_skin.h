#pragma once
// The skin between nodes, which is round where a mesh has flat faces: a cubic patch over each, by its corners' normals
// (Vlachos et al. 2001, "Curved PN triangles"). As it is deformed: skin that lies flat on a plate does not bulge.

#include "engine/skin/chunks/chunk.h"
#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// Outward normals at nodes of the pad, of faces weighted so that they are right on every sphere (Max 1999, "Weights
/// for computing vertex normals from facet normals").
template <class R>
inline void find_skin_normals(SkinChunk<ScalarOf<R>>& c) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    constexpr T tiny(T(1e-30));
    auto& normals = c.scratch.skin_normal;
    std::fill(normals.begin(), normals.end(), T(0));
    auto at = [&](int node) { return load_vec3<R>(&c.state.position[node * W3]); };
    for (std::size_t n = 0; n < c.topology->skin_corners.size(); ++n) {
        const SkinCorner& k = c.topology->skin_corners[n];
        const Vec3<R> x = at(k.node), a = at(k.next) - x, b = at(k.last) - x;
        const R weight =
            load<R>(&c.rest.corner_on_pad[n * std::size_t(lane_width<R>)]) / maximum(dot(a, a) * dot(b, b), R(tiny));
        add_vec3<R>(&normals[k.sample * W3], weight * cross(a, b));
    }
    for (std::size_t s = 0; s < c.topology->samples.size(); ++s) {
        const Vec3<R> n = load_vec3<R>(&normals[s * W3]);
        store_vec3<R>(&normals[s * W3], (R(T(1)) / square_root(maximum(dot(n, n), R(tiny)))) * n);
    }
}

/// How far the skin is outside the flat faces around a node, at the start of the step: the mean of the middles of its
/// edges. There a patch is (d n_b) n_b / 8 - (d n_a) n_a / 8 outside, for an edge d from a to b. So high over the nodes
/// that decide contact, the skin is as far out on average as it is between them; coarse pads are touched as early as
/// fine ones, and bear as much.
template <class R>
inline void find_bulges(SkinChunk<ScalarOf<R>>& c) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    const SkinTopology& t = *c.topology;
    find_skin_normals<R>(c);
    auto& bulges = c.scratch.bulge;
    std::fill(bulges.begin(), bulges.end(), T(0));
    const R eighth(T(0.125));
    for (const SkinEdge& e : t.skin_edges) {
        const Vec3<R> n_a = load_vec3<R>(&c.scratch.skin_normal[e.sample[0] * W3]),
                      n_b = load_vec3<R>(&c.scratch.skin_normal[e.sample[1] * W3]),
                      d = load_vec3<R>(&c.state.position[e.node[1] * W3]) -
                          load_vec3<R>(&c.state.position[e.node[0] * W3]);
        const Vec3<R> middle = (eighth * dot(d, n_b)) * n_b - (eighth * dot(d, n_a)) * n_a;
        for (int s : e.sample) add_vec3<R>(&bulges[s * W3], R(T(t.edge_share[std::size_t(s)])) * middle);
    }
}

}  // namespace palpate::detail
