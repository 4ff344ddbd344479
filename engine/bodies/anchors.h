#pragma once
// Bodies in steps of static equilibrium. Nothing but contact bears a weight there, so that what nothing holds has no
// equilibrium, and Newton no direction. So a body is held by an anchor, as it were by inertia in a short step, while
// the solve looks for equilibrium; each update of multipliers takes the anchor's force away by casting it anew where
// the body then is (the proximal point method, Rockafellar 1976). What a step has converged with leaves next to nothing
// to the anchors; a body that goes adrift, because its anchor bears as much after an update as before, has not
// converged.

#include "engine/bodies/islands.h"

namespace palpate {

/// Casts a body's anchor at the start of a step: where it is, or where it will be if it goes on as the grip that had
/// hold of it went; its target is where that leads it without contact.
void cast_anchor(const BodyWork& work, RigidBody& body, BodyProgress& progress);

/// Anchor and weight, in place of a body's inertia.
void evaluate_anchor(const BodyWork& work, const RigidBody& body, BodyProgress& progress);

/// Casts the anchors of an island anew; notes the bodies that are adrift.
void recast_anchors(BodyWork& work, const Island& island);

/// Notes the bodies that skin has hold of, at the end of a step.
void find_gripped(BodyWork& work);

/// What a static step's motion comes to.
void end_static_body(const BodyWork& work, RigidBody& body, BodyProgress& progress);

}  // namespace palpate
