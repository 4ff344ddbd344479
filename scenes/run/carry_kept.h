#pragma once
// A run goes on with fingers, objects or thimbles more or less.

#include "scenes/run/simulation.h"

namespace palpate {

/// What the rows of a world were in the one before; -1: they are new.
struct KeptRows {
    std::vector<int> fingers, objects;
};

/// Moves what `from` has come to into `to`: of fingers, objects and thimbles that both have. A finger goes on with the
/// same bits, unless what is new brings its chunk what it had not (the first friction, the first body): then it keeps
/// its places, velocities and strain limits, and finds its contacts anew. Throws nothing; `from` is of no use
/// afterwards.
void carry_kept(Simulation& from, Simulation& to, const KeptRows& kept);

}  // namespace palpate
