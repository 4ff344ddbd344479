#include <algorithm>
#include <bit>

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

/// Moves every solved finger of `from` to lanes of `to` that are not solved.
template <class T>
int empty_into(SkinChunk<T>& from, int from_row, SkinChunk<T>& to, int to_row, Table<Skin>& skins) {
    int moves = 0;
    for (int lane = 0; lane < from.width; ++lane) {
        if (!((active_lanes(from) >> lane) & 1u)) continue;
        const int free = std::countr_one(active_lanes(to));
        exchange_lanes(from, lane, to, free);
        ++moves;
        skins[std::size_t(to.finger[std::size_t(free)])].chunk = to_row;
        skins[std::size_t(to.finger[std::size_t(free)])].lane = free;
        if (from.finger[std::size_t(lane)] < 0) continue;
        skins[std::size_t(from.finger[std::size_t(lane)])].chunk = from_row;
        skins[std::size_t(from.finger[std::size_t(lane)])].lane = lane;
    }
    return moves;
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
        if (to >= 0) moves += empty_into(chunks[std::size_t(row)], row, chunks[std::size_t(to)], to, skins);
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
    gather(chunks.doubles, skins);
    gather(chunks.floats, skins);
}

}  // namespace palpate
