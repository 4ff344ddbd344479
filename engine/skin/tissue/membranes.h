#pragma once
// Adds the membranes of laminate.h to a chunk. A register holds the same elements of several fingers, or several
// elements of one; all are added to the nodes in their own order, so that a finger is the same bits alone or beside
// others.

#include <algorithm>

#include "engine/skin/tissue/corotational.h"
#include "engine/skin/tissue/laminate.h"

namespace palpate::detail {

/// Elements whose membranes resist their mean stretch.
struct MembraneGroup {
    const int* elements;
    const std::array<int, 4>* place;  ///< of their corners among the group's nodes, ascending; last -1: three corners
    int count;
    const int* nodes;
    const int* blocks;  ///< of the nodes' pairs 00, 10, 11, 20, ...
    int node_count;
};

/// Membranes of one group of several fingers.
template <Want want, class R>
inline void add_membrane_group(SkinChunk<ScalarOf<R>>& c, const MembraneGroup& group, const R& exactness,
                               Evaluation<R>& out) {
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    const R one(1);
    MembraneState<R> state[most_membrane_elements];
    MembraneSlopes<R> slopes[most_membrane_elements];
    R weight[most_membrane_elements];
    MeanMembrane<R> mean = begin_mean<R>();
    for (int i = 0; i < group.count; ++i) {
        const auto e = std::size_t(group.elements[i]);
        const auto& place = group.place[i];
        auto position = [&](int a) {
            return load_vec3<R>(&c.state.position[std::size_t(3 * group.nodes[place[std::size_t(a)]] * W)]);
        };
        auto number = [&](int k) { return load<R>(&c.rest.membrane_slopes[(6 * e + std::size_t(k)) * W]); };
        const MembraneState<R>& s = state[i] = place[3] < 0 ? deformed_membrane<3>(position, number, slopes[i])
                                                            : deformed_membrane<4>(position, number, slopes[i]);
        const R volume = load<R>(&c.rest.volume[e * W]);
        weight[i] = volume * load<R>(&c.rest.membrane_mu[e * W]);
        mean.mu += weight[i], mean.lambda += volume * load<R>(&c.rest.membrane_lambda[e * W]);
        mean.strain[0] += weight[i] * (s.S[0] - one);
        mean.strain[1] += weight[i] * s.S[1];
        mean.strain[2] += weight[i] * (s.S[2] - one);
    }
    out.energy += finish_mean(mean);
    Vec3<R> slope[4 * most_membrane_elements][3];
    if constexpr (want == Want::forces_and_matrix)
        for (int a = 0; a < group.node_count; ++a)
            for (auto& v : slope[a]) v = {R(0), R(0), R(0)};
    for (int i = 0; i < group.count; ++i) {
        const auto& place = group.place[i];
        auto corner = [&](int a) { return place[std::size_t(a)]; };
        auto add = [&](auto corners) {
            membrane_terms<want, decltype(corners)::value>(
                state[i], slopes[i], mean.stress, mean.over_mu * weight[i], exactness,
                [&](int a, const Vec3<R>& v) {
                    add_vec3<R>(&c.scratch.gradient[std::size_t(3 * group.nodes[corner(a)] * W)], v);
                },
                [&](int a, int k, const Vec3<R>& v) { slope[corner(a)][k] += v; },
                [&](int a, int b, const Mat3<R>& K) {
                    add_block<R>(c.scratch.blocks.data(), group.blocks[corner(a) * (corner(a) + 1) / 2 + corner(b)], K);
                });
        };
        if (place[3] < 0)
            add(std::integral_constant<int, 3>{});
        else
            add(std::integral_constant<int, 4>{});
    }
    if constexpr (want != Want::forces_and_matrix) return;
    const std::array<R, 3> moduli = principal_moduli(mean);
    const int* block = group.blocks;
    for (int a = 0; a < group.node_count; ++a) {
        take_principal_parts(slope[a]);
        Vec3<R> weighted[3];
        for (int k = 0; k < 3; ++k) weighted[k] = moduli[std::size_t(k)] * slope[a][k];
        for (int b = 0; b <= a; ++b, ++block) {
            T* to = c.scratch.blocks.data() + std::size_t(*block) * 9 * W;
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j, to += W)
                    store<R>(to, load<R>(to) + (weighted[0][i] * slope[b][0][j] + weighted[1][i] * slope[b][1][j] +
                                                weighted[2][i] * slope[b][2][j]));
        }
    }
}

/// Whether any finger of the chunk has a membrane in an element.
template <class R>
inline bool has_membrane(const SkinChunk<ScalarOf<R>>& c, int e) {
    return any(load<R>(&c.rest.membrane_mu[std::size_t(e * lane_width<R>)]) > R(0));
}

/// Elements of patches of a finger alone, as a register Q holds them; further parts repeat the last.
template <class R, class Q>
struct MembraneElements {
    int first, count;
    std::array<std::size_t, elements_at_once<R>> element, number;  ///< of the element; among those of patches

    MembraneElements(const SkinTopology& t, int first_element, int n) : first(first_element), count(n) {
        for (std::size_t k = 0; k < element.size(); ++k) {
            number[k] = std::size_t(first + std::min(int(k), n - 1));
            element[k] = std::size_t(t.membrane_elements[number[k]]);
        }
    }
    template <class Array>
    Q load(const Array& array, std::size_t size = 1, std::size_t i = 0) const {
        std::array<std::size_t, elements_at_once<R>> offset;
        for (std::size_t k = 0; k < offset.size(); ++k) offset[k] = size * element[k];
        return gather_parts<R, Q>(array.data() + i, offset.data());
    }
    Vec3<Q> load_corner(const LaneArray<ScalarOf<R>>& nodal, const SkinTopology& t, int a) const {
        std::array<std::size_t, elements_at_once<R>> offset;
        for (std::size_t k = 0; k < offset.size(); ++k)
            offset[k] = 3 * std::size_t(t.membrane_corner[number[k]][std::size_t(a)]);
        const ScalarOf<R>* p = nodal.data();
        return {gather_parts<R, Q>(p, offset.data()), gather_parts<R, Q>(p + 1, offset.data()),
                gather_parts<R, Q>(p + 2, offset.data())};
    }
};

/// What the elements of a register add, as memory holds it element after element: forces, parts of dS/dx, blocks.
template <class T, int elements>
struct MembraneNumbers {
    static constexpr std::size_t slope = 16, block = slope + 40, count = block + 96;  // in squares of 8
    alignas(64) std::array<T, std::size_t(elements) * count> of_element;
    const T* of(int k) const { return &of_element[std::size_t(k) * count]; }
};
template <Want want, class R, class Q>
inline void turn_membranes(const MembraneState<Q>& s, const MembraneSlopes<Q>& slopes, const Q stress[3],
                           const Q& weight, const Q& exactness,
                           MembraneNumbers<ScalarOf<R>, elements_at_once<R>>& out) {
    using Numbers = MembraneNumbers<ScalarOf<R>, elements_at_once<R>>;
    std::array<Q, Numbers::count> number;
    auto put = [&](std::size_t at, const Vec3<Q>& v) { number[at] = v.x, number[at + 1] = v.y, number[at + 2] = v.z; };
    auto clear = [&](std::size_t from, std::size_t to) {
        for (std::size_t i = from; i < to; ++i) number[i] = Q(0);
    };
    clear(12, Numbers::slope);
    clear(Numbers::slope + 36, Numbers::block);
    clear(Numbers::block + 90, Numbers::count);
    membrane_terms<want, 4>(
        s, slopes, stress, weight, exactness, [&](int a, const Vec3<Q>& v) { put(std::size_t(3 * a), v); },
        [&](int a, int k, const Vec3<Q>& v) { put(Numbers::slope + std::size_t(9 * a + 3 * k), v); },
        [&](int a, int b, const Mat3<Q>& K) {
            Q* to = &number[Numbers::block + 9 * std::size_t(a * (a + 1) / 2 + b)];
            for (int i = 0; i < 9; ++i) to[i] = K.m[i / 3][i % 3];
        });
    turn_numbers<R, Q, Numbers::count>(number.data(), want == Want::forces ? Numbers::slope : Numbers::count,
                                       out.of_element.data());
}

/// What the mean stretch of a group couples, of a finger alone: as add_membrane_group has it, eight numbers of a block
/// in a register.
template <class R>
inline void add_mean_blocks(SkinChunk<ScalarOf<R>>& c, const MembranePatch& patch, Vec3<R> (*slope)[3],
                            const MeanMembrane<R>& mean) {
    using T = ScalarOf<R>;
    using Row = HalfRegister<T>;
    constexpr std::size_t side = sizeof(Row) / sizeof(T);
    const std::array<R, 3> moduli = principal_moduli(mean);
    const int* block = &c.topology->membrane_blocks[std::size_t(patch.first_block)];
    T* blocks = c.scratch.blocks.data();
    alignas(64) std::array<std::array<T, 24>, 4 * most_membrane_elements> across;
    for (std::size_t a = 0; a < std::size_t(patch.node_count); ++a) {
        take_principal_parts(slope[a]);
        Row down[3][8 / side];
        T last[3];
        for (std::size_t k = 0; k < 3; ++k) {
            for (std::size_t i = 0; i < 8; ++i) across[a][8 * k + i] = lane(slope[a][k][int(i % 3)], 0);
            const Vec3<R> weighted = moduli[k] * slope[a][k];
            const T x = lane(weighted.x, 0), y = lane(weighted.y, 0), z = last[k] = lane(weighted.z, 0);
            if constexpr (side == 8)
                down[k][0] = Row{x, x, x, y, y, y, z, z};
            else
                down[k][0] = Row{x, x, x, y}, down[k][1] = Row{y, y, z, z};
        }
        for (std::size_t b = 0; b <= a; ++b, ++block) {
            T* to = blocks + 9 * std::size_t(*block);
            const T* right = across[b].data();
            for (std::size_t i = 0; i < 8; i += side) {
                Row sum, r[3];
                std::memcpy(&sum, to + i, sizeof(Row));
                for (std::size_t k = 0; k < 3; ++k) std::memcpy(&r[k], right + 8 * k + i, sizeof(Row));
                sum += down[0][i / side] * r[0] + down[1][i / side] * r[1] + down[2][i / side] * r[2];
                std::memcpy(to + i, &sum, sizeof(Row));
            }
            to[8] += last[0] * right[2] + last[1] * right[10] + last[2] * right[18];
        }
    }
}

/// Elements of several patches of a finger alone in registers, and what the patches share.
template <class R>
struct MembraneBatch {
    using T = ScalarOf<R>;
    using Q = RegisterOf<R>;
    static constexpr int step = elements_at_once<R>, most = step * membrane_registers;
    static_assert(lane_width<R> == 1 && most >= most_membrane_elements);

    int begin, count, registers;  ///< elements
    MembraneState<Q> state[membrane_registers];
    MembraneSlopes<Q> slopes[membrane_registers];
    alignas(64) std::array<T, most> weight, stress[3];  ///< of elements
    std::array<MeanMembrane<R>, most> mean;             ///< of patches
};

/// Of patches `first` to `last` (not with it); adds their energies.
template <class R>
inline void begin_batch(const SkinChunk<ScalarOf<R>>& c, std::size_t first, std::size_t last, MembraneBatch<R>& b,
                        Evaluation<R>& out) {
    using T = ScalarOf<R>;
    using Q = RegisterOf<R>;
    constexpr int step = MembraneBatch<R>::step, most = MembraneBatch<R>::most;
    const SkinTopology& t = *c.topology;
    const auto& patches = t.membrane_patches;
    b.begin = patches[first].first, b.count = patches[last - 1].first + patches[last - 1].count - b.begin;
    b.registers = (b.count + step - 1) / step;
    alignas(64) std::array<T, most> bulk, strain[3];  // of elements
    for (int n = 0; n < b.registers; ++n) {
        const MembraneElements<R, Q> elements(t, b.begin + n * step, std::min(step, b.count - n * step));
        auto position = [&](int a) { return elements.load_corner(c.state.position, t, a); };
        auto number = [&](int k) { return elements.load(c.rest.membrane_slopes, 6, std::size_t(k)); };
        const MembraneState<Q>& s = b.state[n] = deformed_membrane<4>(position, number, b.slopes[n]);
        const Q volume = elements.load(c.rest.volume), mu = volume * elements.load(c.rest.membrane_mu), one(1);
        const auto at = std::size_t(n * step);
        store<Q>(&b.weight[at], mu);
        store<Q>(&bulk[at], volume * elements.load(c.rest.membrane_lambda));
        store<Q>(&strain[0][at], mu * (s.S[0] - one));
        store<Q>(&strain[1][at], mu * s.S[1]);
        store<Q>(&strain[2][at], mu * (s.S[2] - one));
    }
    for (std::size_t number = first; number < last; ++number) {
        MeanMembrane<R>& m = b.mean[number - first] = begin_mean<R>();
        const auto at = std::size_t(patches[number].first - b.begin), end = at + std::size_t(patches[number].count);
        for (std::size_t e = at; e < end; ++e) {
            m.mu += R(b.weight[e]), m.lambda += R(bulk[e]);
            for (std::size_t k = 0; k < 3; ++k) m.strain[k] += R(strain[k][e]);
        }
        out.energy += finish_mean(m);
        for (std::size_t e = at; e < end; ++e) {
            b.weight[e] = lane(m.over_mu * R(b.weight[e]), 0);
            for (std::size_t k = 0; k < 3; ++k) b.stress[k][e] = lane(m.stress[k], 0);
        }
    }
    for (auto& of : b.stress)
        std::fill(of.begin() + b.count, of.begin() + b.registers * step, of[std::size_t(b.count - 1)]);
}

/// The same as add_membrane_group for patches `first` to `last` (not with it) of a finger alone: registers are filled
/// with elements of several patches, and all is added up in the order in which one patch after the other would be.
template <Want want, class R>
inline void add_membranes_of_one(SkinChunk<ScalarOf<R>>& c, std::size_t first, std::size_t last, const R& exactness,
                                 Evaluation<R>& out) {
    using T = ScalarOf<R>;
    using Q = RegisterOf<R>;
    constexpr int step = elements_at_once<R>;
    const SkinTopology& t = *c.topology;
    MembraneBatch<R> batch;
    begin_batch<R>(c, first, last, batch, out);
    std::size_t number = first;
    Vec3<R> slope[4 * most_membrane_elements][3];
    auto clear_slope = [&] {
        if constexpr (want == Want::forces_and_matrix)
            for (int a = 0; a < t.membrane_patches[number].node_count; ++a)
                for (auto& v : slope[a]) v = {R(0), R(0), R(0)};
    };
    clear_slope();
    for (int n = 0; n < batch.registers; ++n) {
        using Numbers = MembraneNumbers<T, step>;
        Numbers numbers;
        const auto at = std::size_t(n * step);
        const Q stress[3] = {load<Q>(&batch.stress[0][at]), load<Q>(&batch.stress[1][at]),
                             load<Q>(&batch.stress[2][at])};
        turn_membranes<want, R>(batch.state[n], batch.slopes[n], stress, load<Q>(&batch.weight[at]),
                                repeat_part<Q>(exactness), numbers);
        for (int k = 0; k < std::min(step, batch.count - n * step); ++k) {
            const auto m = std::size_t(batch.begin + n * step + k);
            const MembranePatch& patch = t.membrane_patches[number];
            const auto &place = t.membrane_place[m], &node = t.membrane_corner[m];
            const T* from = numbers.of(k);
            const std::size_t used = place[3] < 0 ? 3 : 4;
            for (std::size_t a = 0; a < used; ++a)
                for (std::size_t i = 0; i < 3; ++i) c.scratch.gradient[std::size_t(3 * node[a]) + i] += from[3 * a + i];
            const bool is_last = int(m) + 1 == patch.first + patch.count;
            if constexpr (want == Want::forces_and_matrix) {
                const int* blocks = &t.membrane_blocks[std::size_t(patch.first_block)];
                for (std::size_t a = 0, pair = 0; a < used; ++a) {
                    for (std::size_t j = 0; j < 3; ++j) {
                        const T* v = from + Numbers::slope + 9 * a + 3 * j;
                        slope[place[a]][j] += Vec3<R>{R(v[0]), R(v[1]), R(v[2])};
                    }
                    for (std::size_t b = 0; b <= a; ++b, ++pair)
                        add_nine(
                            c.scratch.blocks.data() + 9 * std::size_t(blocks[place[a] * (place[a] + 1) / 2 + place[b]]),
                            from + Numbers::block + 9 * pair);
                }
                if (is_last) add_mean_blocks<R>(c, patch, slope, batch.mean[number - first]);
            }
            if (is_last && ++number < last) clear_slope();
        }
    }
}

/// The membranes of all patches: of a finger alone as many at a time as fill some registers.
template <Want want, class R>
inline void add_membrane_patches(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    const SkinTopology& t = *c.topology;
    const auto& patches = t.membrane_patches;
    if constexpr (std::is_same_v<R, RegisterOf<R>>) {
        for (const MembranePatch& p : patches) {
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
    } else {
        constexpr int most = elements_at_once<R> * membrane_registers;
        for (std::size_t first = 0, last; first < patches.size(); first = last) {
            const int begin = patches[first].first;
            for (last = first + 1; last < patches.size(); ++last)
                if (patches[last].first + patches[last].count - begin > most) break;
            add_membranes_of_one<want>(c, first, last, exactness, out);
        }
    }
}

/// Membranes that resist their own stretch alone, of the elements of a register.
template <Want want, class R, class Q>
inline void add_lone_membranes(SkinChunk<ScalarOf<R>>& c, const ElementGroup<R, Q>& elements, const R& exactness,
                               Evaluation<R>& out) {
    constexpr int W = lane_width<R>;
    const SkinTopology& t = *c.topology;
    const Q volume = elements.load(c.rest.volume);
    const Q mu = volume * elements.load(c.rest.membrane_mu), lambda = volume * elements.load(c.rest.membrane_lambda);
    auto position = [&](int a) { return elements.load_node(c.state.position, t, a); };
    auto number = [&](int k) { return elements.load(c.rest.membrane_slopes, 6, std::size_t(k)); };
    if constexpr (std::is_same_v<R, Q>) {
        const std::size_t e = elements.number[0];
        out.energy += lone_membrane<want, Q>(
            position, number, mu, lambda, exactness,
            [&](int a, const Vec3<Q>& v) {
                add_vec3<R>(&c.scratch.gradient[std::size_t(3 * t.elements[e][std::size_t(a)] * W)], v);
            },
            [&](int a, int b, const Mat3<Q>& K) {
                add_block<R>(c.scratch.blocks.data(), t.element_block[e][std::size_t(a * (a + 1) / 2 + b)], K);
            });
    } else {
        using Sums = ElementSums<Q>;
        Sums sums;
        const Q energy = lone_membrane<want, Q>(
            position, number, mu, lambda, repeat_part<Q>(exactness),
            [&](int a, const Vec3<Q>& v) {
                for (int i = 0; i < 3; ++i) sums.number[std::size_t(3 * a + i)] = v[i];
            },
            [&](int a, int b, const Mat3<Q>& K) {
                Q* to = &sums.number[Sums::stiffness + 9 * std::size_t(a * (a + 1) / 2 + b)];
                for (int i = 0; i < 9; ++i) to[i] = K.m[i / 3][i % 3];
            });
        ElementNumbers<R> numbers;
        turn_numbers<R, Q, Sums::count>(sums.number.data(), want == Want::forces ? Sums::stiffness : Sums::count,
                                        numbers.of_element.data());
        for (int k = 0; k < elements.count; ++k) {
            out.energy += part_of<R>(energy, k);
            add_element<want, R>(c, elements.number[std::size_t(k)], numbers.of(k));
        }
    }
}

/// The membranes of all elements that hold several layers.
template <Want want, class R>
inline void add_membranes(SkinChunk<ScalarOf<R>>& c, const R& exactness, Evaluation<R>& out) {
    const SkinTopology& t = *c.topology;
    add_membrane_patches<want>(c, exactness, out);
    ElementGroup<R, RegisterOf<R>> lone(0, 1);
    lone.count = 0;
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        if ((!t.in_membrane_patch.empty() && t.in_membrane_patch[e]) || !has_membrane<R>(c, int(e))) continue;
        for (int k = lone.count++; k < elements_at_once<R>; ++k) lone.number[std::size_t(k)] = e;
        if (lone.count < elements_at_once<R>) continue;
        add_lone_membranes<want>(c, lone, exactness, out);
        lone.count = 0;
    }
    if (lone.count > 0) add_lone_membranes<want>(c, lone, exactness, out);
}

}  // namespace palpate::detail
