#pragma once
// The implicit skin step of one chunk, for every lane type that the machine offers.

#include "engine/skin/chunk.h"

namespace palpate {

/// Widest chunk worth building on this processor, in lanes of T.
template <class T>
int widest_chunk();

/// Advances all fingers of a chunk by one step (newton.h). The chunk's width chooses the kernel.
template <class T>
void solve_skin(SkinChunk<T>& chunk, const SolverSettings& settings);

}  // namespace palpate
