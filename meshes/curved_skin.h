#pragma once
// The skin between nodes, which is round where a mesh has flat triangles.

#include "meshes/tet_mesh.h"

namespace palpate {

/// How far the curved skin that can touch reaches along a direction (unit length) [m]: as far as a plane is from the
/// origin that comes against it and touches first. A cubic patch over each triangle, by its corners' normals (Vlachos
/// et al. 2001, "Curved PN triangles"), which leave out triangles beyond an edge. Vertices lie on the skin, so that
/// flat triangles are touched later: with 350 elements by up to 0.08 mm, this within 0.025.
double reach_of_curved_skin(const TetMesh& mesh, const Point& direction);

}  // namespace palpate
