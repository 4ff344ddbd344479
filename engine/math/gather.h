#pragma once
// Registers that are filled from several places in memory, and turned: parts that are each a finger's lanes, or one
// element each of a finger alone.

#include "engine/math/lanes.h"

namespace palpate {

/// 32 bytes of numbers, as many as rows of a square that transpose_square turns in registers.
template <class T>
struct HalfRegisterOf {
    typedef T Vector __attribute__((vector_size(32)));
};
template <class T>
using HalfRegister = typename HalfRegisterOf<T>::Vector;
inline void transpose_square(HalfRegister<double>* row) {
    const auto a = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6),
               c = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6);
    const auto b = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7),
               d = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
    row[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5), row[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    row[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5), row[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}
inline void transpose_square(HalfRegister<float>* row) {
    HalfRegister<float> pair[8], quad[8];
    for (int i = 0; i < 8; i += 2) {
        pair[i] = __builtin_shufflevector(row[i], row[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        pair[i + 1] = __builtin_shufflevector(row[i], row[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int i = 0; i < 8; i += 4)
        for (int k = 0; k < 2; ++k) {
            quad[i + 2 * k] = __builtin_shufflevector(pair[i + k], pair[i + k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            quad[i + 2 * k + 1] = __builtin_shufflevector(pair[i + k], pair[i + k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int i = 0; i < 4; ++i) {
        row[i] = __builtin_shufflevector(quad[i], quad[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        row[i + 4] = __builtin_shufflevector(quad[i], quad[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

/// Two parts side by side in a register.
template <class Whole, class Part>
inline Whole join_parts(const Part& low, const Part& high) {
    static_assert(lane_width<Whole> == 2 * lane_width<Part>);
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return Whole(typename Whole::Vector(__builtin_shufflevector(low.v, high.v, k...)));
    }
    (std::make_integer_sequence<int, lane_width<Whole>>{});
}
template <class Part, class Whole>
inline Part low_part(const Whole& whole) {
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return Part(typename Part::Vector(__builtin_shufflevector(whole.v, whole.v, k...)));
    }
    (std::make_integer_sequence<int, lane_width<Part>>{});
}
template <class Part, class Whole>
inline Part high_part(const Whole& whole) {
    return [&]<int... k>(std::integer_sequence<int, k...>) {
        return Part(typename Part::Vector(__builtin_shufflevector(whole.v, whole.v, (lane_width<Part> + k)...)));
    }
    (std::make_integer_sequence<int, lane_width<Part>>{});
}
/// A whole register of numbers p[offset[k]], or of lanes that begin there.
template <class Part, class Whole>
inline Whole gather_parts(const ScalarOf<Part>* p, const std::size_t* offset) {
    if constexpr (std::is_same_v<Part, Whole>) {
        return load<Part>(p + offset[0]);
    } else if constexpr (lane_width<Part> != 1) {
        return join_parts<Whole>(load<Part>(p + offset[0]), load<Part>(p + offset[1]));
    } else {
        return [&]<std::size_t... k>(std::index_sequence<k...>) {
            return Whole(typename Whole::Vector{p[offset[k]]...});
        }
        (std::make_index_sequence<std::size_t(lane_width<Whole>)>{});
    }
}
namespace detail {
/// Four numbers, of which three are wanted.
template <class T>
struct FourOf {
    typedef T Vector __attribute__((vector_size(4 * sizeof(T))));
    typedef Vector InMemory __attribute__((aligned(alignof(T))));
};
template <class V>
inline auto joined(V low, V high) {
    return [&]<std::size_t... k>(std::index_sequence<k...>) { return __builtin_shufflevector(low, high, int(k)...); }
    (std::make_index_sequence<2 * sizeof(V) / sizeof(low[0])>{});
}

/// Which number of two registers a and b, of n numbers each, is number i of a register that has of every four of them
/// a0 b0 a1 b1, or, in pairs, a0 a1 b0 b1; from number `first`, or pair `first`, of the fours on.
template <int n, bool pairs, int first>
constexpr int interleaved(int i) {
    const int of_four = i / 4 * 4, place = i % 4;
    if (!pairs) return of_four + first + place / 2 + (place % 2) * n;  // a0 b0 a1 b1
    return of_four + 2 * first + place % 2 + place / 2 * n;            // a0 a1 b0 b1
}
template <bool pairs, int first, class V, std::size_t... i>
inline V interleave(V a, V b, std::index_sequence<i...>) {
    return __builtin_shufflevector(a, b, interleaved<int(sizeof...(i)), pairs, first>(int(i))...);
}
}  // namespace detail

/// Whole registers of the numbers p[offset[k]], and of the two after each: fours are loaded, and turned in registers.
/// Memory must not end before them (CacheAligned).
template <class Whole>
inline void gather_triples(const ScalarOf<Whole>* p, const std::size_t* offset, Whole out[3]) {
    using T = ScalarOf<Whole>;
    using V = typename Whole::Vector;
    constexpr int n = lane_width<Whole>;
    static_assert(n == 4 || n == 8 || n == 16);
    constexpr auto all = std::make_index_sequence<std::size_t(n)>{};
    auto four = [&](int part) {
        return *reinterpret_cast<const typename detail::FourOf<T>::InMemory*>(p + offset[part]);
    };
    auto row_of = [&](int i) {
        if constexpr (n == 4)
            return V(four(i));
        else if constexpr (n == 8)
            return detail::joined(four(i), four(i + 4));
        else
            return detail::joined(detail::joined(four(i), four(i + 4)), detail::joined(four(i + 8), four(i + 12)));
    };
    const V row[4] = {row_of(0), row_of(1), row_of(2), row_of(3)};
    const V xy = detail::interleave<false, 0>(row[0], row[1], all),
            z = detail::interleave<false, 2>(row[0], row[1], all);
    const V xy2 = detail::interleave<false, 0>(row[2], row[3], all),
            z2 = detail::interleave<false, 2>(row[2], row[3], all);
    out[0] = Whole(detail::interleave<true, 0>(xy, xy2, all));
    out[1] = Whole(detail::interleave<true, 1>(xy, xy2, all));
    out[2] = Whole(detail::interleave<true, 0>(z, z2, all));
}

/// A whole register of one number, or of the same lanes.
template <class Whole, class Part>
inline Whole repeat_part(const Part& part) {
    if constexpr (std::is_same_v<Part, Whole>)
        return part;
    else if constexpr (lane_width<Part> != 1)
        return join_parts<Whole>(part, part);
    else
        return Whole(lane(part, 0));
}

}  // namespace palpate
