#pragma once
// Stiffness of the bone's nodes, carried over to the bone: dx_a = dp + omega x arm_a. Of a finger alone, rows of blocks
// go through registers as a whole.

#include <type_traits>

#include "engine/skin/chunks/chunk.h"
#include "engine/skin/tissue/elements.h"

namespace palpate::detail {

/// A block of one finger's matrix by rows, each in a register; what a row has in its fourth place is never used.
template <class V>
struct BlockRows {
    V row[3] = {V(0), V(0), V(0)};

    friend BlockRows operator+(const BlockRows& a, const BlockRows& b) {
        return {{a.row[0] + b.row[0], a.row[1] + b.row[1], a.row[2] + b.row[2]}};
    }
};
template <int... places, class V>
inline V places_of(const V& a, const V& b) {
    return V(__builtin_shufflevector(a.v, b.v, places...));
}
template <class V>
inline BlockRows<V> load_rows(const ScalarOf<V>* p) {
    const V last = load<V>(p + 5);  // not beyond the block
    return {{load<V>(p), load<V>(p + 3), places_of<1, 2, 3, 3>(last, last)}};
}
template <class V>
inline void store_rows(ScalarOf<V>* p, const BlockRows<V>& K) {
    store(p, K.row[0]);  // each goes over the next one's first number
    store(p + 3, K.row[1]);
    store(p + 5, places_of<2, 4, 5, 6>(K.row[1], K.row[2]));
}
template <class V>
inline BlockRows<V> transpose(const BlockRows<V>& K) {
    const V ab = places_of<0, 4, 1, 5>(K.row[0], K.row[1]), last = places_of<2, 6, 3, 7>(K.row[0], K.row[1]);
    return {{places_of<0, 1, 4, 4>(ab, K.row[2]), places_of<2, 3, 5, 5>(ab, K.row[2]),
             places_of<0, 1, 6, 6>(last, K.row[2])}};
}
/// The cross product of a with every column.
template <class V>
inline BlockRows<V> cross_columns(const Vec3<V>& a, const BlockRows<V>& K) {
    return {{product_less(a.y, K.row[2], a.z * K.row[1]), product_less(a.z, K.row[0], a.x * K.row[2]),
             product_less(a.x, K.row[1], a.y * K.row[0])}};
}

/// Lanes for the rows of a block.
template <class R>
struct BlockRowLanes {
    using type = Lanes<R, 4, 128>;  // no code of wider processors
};
template <class T, int Bits>
struct BlockRowLanes<Lanes<T, 1, Bits>> {
    using type = Lanes<T, 4, Bits>;
};

/// Block and arms as a kernel of lanes reads them; of a finger alone, rows of blocks in registers.
template <class R>
struct BlocksAtBone {
    static constexpr bool by_rows = lane_width<R> == 1;
    using Number = typename std::conditional_t<by_rows, BlockRowLanes<R>, std::type_identity<R>>::type;
    using Block = std::conditional_t<by_rows, BlockRows<Number>, Mat3<R>>;

    SkinChunk<ScalarOf<R>>& c;
    const Vec3<R> origin = load_vec3<R>(c.state.bone.data());

    ScalarOf<R>* at(int block) const { return c.scratch.blocks.data() + std::size_t(block) * 9 * lane_width<R>; }
    Block read(int block) const {
        if constexpr (by_rows)
            return load_rows<Number>(at(block));
        else
            return load_mat3<R>(at(block));
    }
    void write(int block, const Block& K) const {
        if constexpr (by_rows)
            store_rows(at(block), K);
        else
            store_mat3<R>(at(block), K);
    }
    static Block zero() {
        if constexpr (by_rows)
            return {};
        else
            return Mat3<R>::zero();
    }
    Vec3<Number> arm(int node) const {
        const Vec3<R> a = load_vec3<R>(&c.state.position[std::size_t(3 * node * lane_width<R>)]) - origin;
        if constexpr (by_rows)
            return {Number(lane(a.x, 0)), Number(lane(a.y, 0)), Number(lane(a.z, 0))};
        else
            return a;
    }
};

/// Carries the stiffness of the bone nodes over to the bone.
template <class R>
inline void carry_stiffness_to_bone(SkinChunk<ScalarOf<R>>& c) {
    const SkinTopology& t = *c.topology;
    const BlocksAtBone<R> blocks{c};
    using Block = typename BlocksAtBone<R>::Block;
    // Edges to one free node follow each other, and are added up before they are stored.
    for (auto edge = t.bone_edges.begin(); edge != t.bone_edges.end();) {
        const auto first = edge;
        Block position = blocks.read(first->position), rotation = blocks.read(first->rotation);
        for (; edge != t.bone_edges.end() && edge->position == first->position; ++edge) {
            const Block K = blocks.read(edge->block);
            position = position + K;
            rotation = rotation + cross_columns(blocks.arm(edge->bone_node), K);
        }
        blocks.write(first->position, position);
        blocks.write(first->rotation, rotation);
    }
    Block pp = blocks.zero(), rp = pp, rr = pp;
    for (const auto& pair : t.bone_pairs) {
        const auto arm_a = blocks.arm(pair.a), arm_b = blocks.arm(pair.b);
        const Block K = blocks.read(pair.block), turned = cross_columns(arm_a, K);
        const Block both = transpose(cross_columns(arm_b, transpose(turned)));
        pp = pp + K;
        rp = rp + turned;
        rr = rr + both;
        if (pair.a == pair.b) continue;
        const Block back = transpose(K);
        pp = pp + back;
        rp = rp + cross_columns(arm_b, back);
        rr = rr + transpose(both);
    }
    const int position = t.diagonal_block[std::size_t(t.bone_position)],
              rotation = t.diagonal_block[std::size_t(t.bone_rotation)];
    blocks.write(position, blocks.read(position) + pp);
    blocks.write(t.bone_cross_block, blocks.read(t.bone_cross_block) + rp);
    blocks.write(rotation, blocks.read(rotation) + rr);
}

}  // namespace palpate::detail
