#pragma once
// Contact of fingers with soft objects, as a part of the solve that lanes and bodies share (solve_bodies.cpp).

#include "engine/bodies/islands.h"

namespace palpate {

/// Whether a pair is solved in an island that fulfils a condition.
template <class Condition>
bool solved_where(const BodyWork& w, const SoftPair& p, Condition condition) {
    return p.near && p.island >= 0 && condition(w.s.islands[std::size_t(p.island)]);
}

/// Which island each pair is solved in; marks those islands.
void begin_soft_contact(BodyWork& work);

/// Adds contact with soft objects to the lanes' energies and gradients, and to the matrices of lanes that step next.
void add_soft_contact(BodyWork& work);

/// Takes over multipliers, where the islands' are updated.
void update_soft_contact(BodyWork& work);

/// At the end of a step: multipliers are what is borne; lanes that were reset, or have failed, let go. A step in which
/// a finger is left too deep in a soft object has not converged.
void end_soft_contact(BodyWork& work);

/// a . b' of what pairs contribute between the lanes of an island: to `image` adds the part of the Newton matrix that
/// the lanes' own matrices leave out, times `x`. Numbers of a lane begin at soft.work.first.
void add_soft_coupling(const BodyWork& work, int island, const Eigen::VectorXd& x, Eigen::VectorXd& image);

}  // namespace palpate
