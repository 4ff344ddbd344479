#pragma once
// The implicit skin step of one chunk, for every lane type that the machine offers.

#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Width of the chunk that takes the first of `fingers` fingers on this processor, in lanes of T.
template <class T>
int chunk_width(int fingers);

/// Advances all fingers of a chunk by one step (solve_lanes.h). The chunk's width chooses the kernel; it must be one
/// that chunk_width gives.
template <class T>
void solve_skin(SkinChunk<T>& chunk, const SolverSettings& settings);

}  // namespace palpate
