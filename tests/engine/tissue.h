#pragma once
// Tissue of a chunk by itself, anywhere.

#include <algorithm>
#include <random>

#include "engine/skin/solve/evaluate.h"

namespace palpate::testing {

/// Energy, gradient and matrix of its tissue alone.
inline Evaluation<double> evaluate_tissue(SkinChunk<double>& c, double exactness) {
    Evaluation<double> out;
    std::fill(c.scratch.gradient.begin(), c.scratch.gradient.end(), 0.0);
    std::fill(c.scratch.blocks.begin(), c.scratch.blocks.end(), 0.0);
    detail::add_tissue<detail::Want::forces_and_matrix>(c, exactness, out);
    return out;
}

/// Moves every coordinate of every node by up to `by` [m].
inline void scramble(SkinChunk<double>& c, unsigned seed, double by) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> u(-by, by);
    for (double& x : c.state.position) x += u(random);
}

}  // namespace palpate::testing
