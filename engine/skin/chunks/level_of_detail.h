#pragma once
// What a finger near nothing is left out of: it sleeps where nothing moves, and moves as one with its bone where that
// is allowed. Per lane, whatever its neighbours do.

#include <cstdint>

#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// Before the solve: wakes the lanes that an object has come near to, or whose target moves.
template <class T>
void wake_lanes(SkinChunk<T>& chunk, const SolverSettings& settings);

/// Gives the skin of rigid lanes positions and velocities of its own again: those of its bone.
template <class T>
void soften_lanes(SkinChunk<T>& chunk, unsigned lanes);

/// Before the solve, with its objects known: lets samples between nodes count in the lanes that would otherwise sink in
/// between nodes.
template <class T>
void choose_samples(SkinChunk<T>& chunk, const SolverSettings& settings);

/// Before the solve: lets the tissue of a lane be linear about an earlier place, or has it linearised in this step, or
/// neither. Where all lanes of a chunk are linear, elements are left out.
template <class T>
void choose_tissue(SkinChunk<T>& chunk, const SolverSettings& settings, std::int64_t step);

/// Whether settings let a chunk keep its Newton matrices. Linear tissue has a matrix of its own; without inertia, one
/// step may be another world than the last.
template <class T>
bool may_keep_matrix(const SkinChunk<T>& c, const SolverSettings& settings) {
    return settings.stiffness_steps > 1 && settings.inertia && c.linear.pairs.empty();
}

/// Before the solve: lets Newton matrices be kept, or has them assembled anew: in all chunks in the same steps.
template <class T>
void choose_matrices(SkinChunk<T>& chunk, const SolverSettings& settings, std::int64_t step);

/// After the solve: puts to sleep the lanes that have come to rest, and makes rigid those whose skin has come to its
/// rest shape, or fell asleep, as far as the settings allow it.
template <class T>
void settle_lanes(SkinChunk<T>& chunk, const SolverSettings& settings);

}  // namespace palpate
