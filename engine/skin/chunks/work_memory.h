#pragma once
// Memory of several chunks: rest data that are the same, and work memory that they take turns with. Where there are
// many, what a chunk needs only while it is solved is then still in the cache from the one before, and no more than
// what outlives the step is fetched and written back.

#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Lets the chunks from `first` on, of one archetype, take turns where they are many.
template <class T>
void share_work(std::vector<SkinChunk<T>>& chunks, std::size_t first, SkinChunks& all);

/// Lets the chunks from `first` on share their rest data, by archetype and width, where all fingers are alike: of a
/// thousand the numbers of one stay in the cache.
template <class T>
void share_rest(std::vector<SkinChunk<T>>& chunks, std::size_t first);

/// Swaps the work memory of a chunk that has none of its own with that of `memory`, and that of its matrix, too, where
/// it is to.
template <class T>
void trade_work(SkinChunk<T>& chunk, SkinChunk<T>& memory, bool with_matrix);

/// Whether no lane has a matrix to keep, or will have one after this step (choose_matrices).
template <class T>
bool keeps_none(const SkinChunk<T>& chunk);

inline std::vector<SkinChunk<double>>& memory_of(WorkMemory& m, double) { return m.doubles; }
inline std::vector<SkinChunk<float>>& memory_of(WorkMemory& m, float) { return m.floats; }

/// Solves a chunk that has no work memory of its own with that of one of those that solve at the same time.
template <class T, class Solve>
void with_work(SkinChunk<T>& c, WorkMemory& work, Solve solve) {
    SkinChunk<T>& memory = memory_of(work, T())[std::size_t(c.shared_work)];
    const bool with_matrix = c.keeps_matrix && keeps_none(c);
    trade_work(c, memory, with_matrix);
    // What it holds is another's.
    std::fill(c.scratch.changed_columns.begin(), c.scratch.changed_columns.end(), 1);
    c.limits.candidates_clear = false;
    c.limits.met = true;
    solve();
    trade_work(c, memory, with_matrix);
}

}  // namespace palpate
