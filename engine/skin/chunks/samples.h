#pragma once
// Samples: where contact is decided. The first are nodes; further ones lie inside faces of the pad, as weighted means
// of three nodes (SkinTopology::face_samples).

#include "engine/math/linear_algebra.h"
#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Samples that count in some lane: those at nodes come first.
template <class R>
inline std::size_t samples_in_use(const SkinChunk<ScalarOf<R>>& c) {
    return (c.fine_lanes & c.used_lanes) ? c.topology->sample_count() : c.topology->samples.size();
}

/// Value of a nodal array [node][xyz] at a sample.
template <class R>
inline Vec3<R> at_sample(const SkinTopology& t, const ScalarOf<R>* nodal, std::size_t s) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    if (s < t.samples.size()) return load_vec3<R>(nodal + t.samples[s] * W3);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    Vec3<R> sum = R(T(f.weight[0])) * load_vec3<R>(nodal + f.node[0] * W3);
    for (int k = 1; k < 3; ++k) sum += R(T(f.weight[k])) * load_vec3<R>(nodal + f.node[k] * W3);
    return sum;
}

/// How much nearer a curved skin is to a slot's object at a sample than its flat faces are [m]. Only where it is
/// curved.
template <class R>
inline R rise_at_sample(const SkinChunk<ScalarOf<R>>& c, int slot, std::size_t s) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const T* rise = &c.scratch.rise[std::size_t(slot) * t.samples.size() * W];
    if (s < t.samples.size()) return load<R>(rise + s * W);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    R sum = R(T(f.weight[0])) * load<R>(rise + f.sample[0] * W);
    for (int k = 1; k < 3; ++k) sum += R(T(f.weight[k])) * load<R>(rise + f.sample[k] * W);
    return sum;
}

/// The same of an array in elimination order; the sample must be free.
template <class R>
inline Vec3<R> at_free_sample(const SkinTopology& t, const ScalarOf<R>* permuted, std::size_t s) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    if (s < t.samples.size()) return load_vec3<R>(permuted + t.elimination[t.samples[s]] * W3);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    Vec3<R> sum = R(T(f.weight[0])) * load_vec3<R>(permuted + t.elimination[f.node[0]] * W3);
    for (int k = 1; k < 3; ++k) sum += R(T(f.weight[k])) * load_vec3<R>(permuted + t.elimination[f.node[k]] * W3);
    return sum;
}

/// Adds a force at a sample to a nodal array.
template <class R>
inline void add_at_sample(const SkinTopology& t, ScalarOf<R>* nodal, std::size_t s, const Vec3<R>& force) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    auto add = [&](int node, const Vec3<R>& v) {
        store_vec3<R>(nodal + node * W3, load_vec3<R>(nodal + node * W3) + v);
    };
    if (s < t.samples.size()) return add(t.samples[s], force);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    for (int k = 0; k < 3; ++k) add(f.node[k], R(T(f.weight[k])) * force);
}

/// The same to an array in elimination order; the sample must be free.
template <class R>
inline void add_at_free_sample(const SkinTopology& t, ScalarOf<R>* permuted, std::size_t s, const Vec3<R>& force) {
    using T = ScalarOf<R>;
    constexpr int W3 = 3 * lane_width<R>;
    auto add = [&](int node, const Vec3<R>& v) {
        ScalarOf<R>* p = permuted + t.elimination[node] * W3;
        store_vec3<R>(p, load_vec3<R>(p) + v);
    };
    if (s < t.samples.size()) return add(t.samples[s], force);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    for (int k = 0; k < 3; ++k) add(f.node[k], R(T(f.weight[k])) * force);
}

/// Adds a symmetric stiffness at a sample to the blocks of the Newton matrix.
template <class R>
inline void add_sample_block(const SkinTopology& t, ScalarOf<R>* blocks, std::size_t s, const Mat3<R>& K) {
    using T = ScalarOf<R>;
    constexpr int W9 = 9 * lane_width<R>;
    auto add = [&](int block, const Mat3<R>& part) {
        ScalarOf<R>* p = blocks + static_cast<std::size_t>(block) * W9;
        store_mat3<R>(p, load_mat3<R>(p) + part);
    };
    if (s < t.samples.size()) return add(t.diagonal_block[t.samples[s]], K);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    for (int k = 0, a = 0; a < 3; ++a)
        for (int b = 0; b <= a; ++b, ++k) add(f.block[k], R(T(f.weight[a] * f.weight[b])) * K);
}

/// Marks the columns of the Newton matrix that add_sample_block changes; the sample must be free.
template <class R>
inline void mark_sample_columns(const SkinTopology& t, std::size_t s, std::vector<unsigned char>& changed) {
    auto mark = [&](int node) { changed[std::size_t(t.elimination[std::size_t(node)])] = 1; };
    if (s < t.samples.size()) return mark(t.samples[s]);
    for (int node : t.face_samples[s - t.samples.size()].node) mark(node);
}

/// Whether a sample hangs on free nodes alone, and not on the bone.
inline bool is_free_sample(const SkinTopology& t, std::size_t s) {
    return s >= t.samples.size() || t.elimination[t.samples[s]] >= 0;
}

}  // namespace palpate
