#include <algorithm>
#include <bit>

#include "engine/skin/chunks/contact_slots.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "engine/systems.h"

namespace palpate {

namespace {

/// A move takes a tenth of a millisecond, and several where chunks are not in the cache; those that are left over come
/// in the next steps.
constexpr int most_moves = 4;

template <class T>
int count_active(const SkinChunk<T>& c) {
    return std::popcount(active_lanes(c));
}

/// Moves a solved finger to a lane of another chunk that is not solved.
template <class T>
void move_finger(std::vector<SkinChunk<T>>& chunks, int from_row, int lane, int to_row, Table<Skin>& skins) {
    SkinChunk<T>&from = chunks[std::size_t(from_row)], &to = chunks[std::size_t(to_row)];
    const int free = std::countr_one(active_lanes(to));
    exchange_lanes(from, lane, to, free);
    skins[std::size_t(to.finger[std::size_t(free)])].chunk = to_row;
    skins[std::size_t(to.finger[std::size_t(free)])].lane = free;
    if (from.finger[std::size_t(lane)] < 0) return;
    skins[std::size_t(from.finger[std::size_t(lane)])].chunk = from_row;
    skins[std::size_t(from.finger[std::size_t(lane)])].lane = lane;
}

/// Moves every solved finger of one chunk to another.
template <class T>
int empty_into(std::vector<SkinChunk<T>>& chunks, int from, int to, Table<Skin>& skins) {
    int moves = 0;
    for (int lane = 0; lane < chunks[std::size_t(from)].width; ++lane) {
        if (!((active_lanes(chunks[std::size_t(from)]) >> lane) & 1u)) continue;
        move_finger(chunks, from, lane, to, skins);
        ++moves;
    }
    return moves;
}

/// What a chunk's solved lanes are: near what they are solved together with, by themselves, or some of both.
enum class Company { none, apart, coupled, mixed };
template <class T>
Company company_of(const SkinChunk<T>& c) {
    const unsigned active = active_lanes(c), coupled = coupled_lanes(c) & active;
    if (active == 0) return Company::none;
    if (coupled == 0) return Company::apart;
    return coupled == active ? Company::coupled : Company::mixed;
}

/// Where a solved finger of `row` may join others of its kind, or else an empty chunk. -1: nowhere.
template <class T>
int place_with(const std::vector<SkinChunk<T>>& chunks, int row, Company kind) {
    int empty = -1;
    for (int k = 0; k < int(chunks.size()); ++k) {
        const SkinChunk<T>& other = chunks[std::size_t(k)];
        if (k == row || count_active(other) >= other.width || !alike(chunks[std::size_t(row)], other)) continue;
        const Company there = company_of(other);
        if (there == kind) return k;
        if (there == Company::none && (empty < 0 || other.width > chunks[std::size_t(empty)].width)) empty = k;
    }
    return empty;
}

/// Parts fingers that are solved together with something from those that are not: one iteration serves all lanes of a
/// chunk, and what one of them needs would change the others' bits. The fewer move, or where they have no place, the
/// others.
template <class T>
void part(std::vector<SkinChunk<T>>& chunks, Table<Skin>& skins) {
    for (int row = 0; row < int(chunks.size()); ++row) {
        const SkinChunk<T>& c = chunks[std::size_t(row)];
        if (company_of(c) != Company::mixed) continue;
        const unsigned coupled = coupled_lanes(c) & active_lanes(c), apart = active_lanes(c) & ~coupled;
        const bool fewer = std::popcount(coupled) <= std::popcount(apart);
        for (const bool of_coupled : {fewer, !fewer})
            for (int lane = 0; lane < c.width && company_of(c) == Company::mixed; ++lane) {
                if (!(((of_coupled ? coupled : apart) >> lane) & 1u)) continue;
                const int to = place_with(chunks, row, of_coupled ? Company::coupled : Company::apart);
                if (to < 0) break;
                move_finger(chunks, row, lane, to, skins);
            }
    }
}

/// Where the few solved fingers of a chunk had better be: with those of another, or in a narrower chunk. -1: nowhere.
template <class T>
int better_place(const std::vector<SkinChunk<T>>& chunks, int row) {
    const SkinChunk<T>& c = chunks[std::size_t(row)];
    const int count = count_active(c);
    int best = -1;
    for (int k = 0; k < int(chunks.size()); ++k) {
        const SkinChunk<T>& other = chunks[std::size_t(k)];
        const int there = count_active(other);
        if (k == row || there + count > other.width) continue;
        const bool joins = there > count || (there == count && (other.width < c.width || k < row));
        const bool narrows = there == 0 && other.width < c.width;
        if (!(there > 0 ? joins : narrows) || !alike(c, other)) continue;
        if (there > 0 && company_of(other) != company_of(c)) continue;
        if (there > 0) return k;
        if (best < 0 || other.width < chunks[std::size_t(best)].width) best = k;
    }
    return best;
}

template <class T>
void gather(std::vector<SkinChunk<T>>& chunks, Table<Skin>& skins) {
    int moves = 0;
    for (int row = 0; row < int(chunks.size()); ++row) {
        const int count = count_active(chunks[std::size_t(row)]);
        if (count == 0 || moves + count > most_moves) continue;
        const int to = better_place(chunks, row);
        if (to >= 0) moves += empty_into(chunks, row, to, skins);
    }
}

}  // namespace

void choose_detail(const SolverSettings& solver, std::int64_t step, SkinChunks& chunks) {
    chunks.for_each([&](auto& c) {
        wake_lanes(c, solver);
        choose_samples(c, solver);
        choose_tissue(c, solver, step);
        choose_matrices(c, solver, step);
    });
}

void gather_lanes(Table<Skin>& skins, SkinChunks& chunks) {
    part(chunks.doubles, skins);
    part(chunks.floats, skins);
    gather(chunks.doubles, skins);
    gather(chunks.floats, skins);
}

}  // namespace palpate
