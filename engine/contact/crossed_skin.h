#pragma once
// What has come through the skin between its samples. Contact is decided at samples: a rod, a corner, or an edge may
// pass between them in a fast step, and no force says so.

#include "engine/skin/chunks/chunk.h"
#include "engine/world.h"

namespace palpate {

/// Nodes of the pad behind which, inside the tissue, an object's surface lies deeper than a quarter of the pad's
/// longest edge: so much is what flat faces between nodes leave out; one more for each narrow thing whose middle is in
/// there, and for each corner of a box or a mesh that is as deep. But for corners, and what was behind a node in the
/// step before, looks at nothing where what is near is far larger than the faces, or touches the pad away from its
/// edges, and moves by little. `surface` holds this step's positions, outward normals and bone.
template <class T>
int nodes_behind(SkinChunk<T>& chunk, int lane, const ContactSurface& surface);

/// Nodes of the pad that leapt through a rigid object, from one side of it to another, in this step or since the pad
/// last left it: a finger that snaps off a dome in a long step may come to rest where short steps would not have
/// brought it. Notes them in the object's contact. Of meshes: nodes_through_walls. `surface` holds this step's
/// positions and bone.
template <class T>
int nodes_leapt(SkinChunk<T>& chunk, int lane, const ContactSurface& surface);

/// Nodes of the pad that have come through walls of meshes, whose field knows no sides: in by one face and out by one
/// that faces the other way, on the straight way that they and the object went in one step. A node counts until it
/// comes back, or the object is far. Notes them in contact_side, which of a mesh is not used otherwise.
template <class T>
int nodes_through_walls(SkinChunk<T>& chunk, int lane, const ContactSurface& surface);

}  // namespace palpate
