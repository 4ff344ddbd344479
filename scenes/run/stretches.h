#pragma once
// How far tetrahedra are stretched, for results and pictures.

#include <array>
#include <vector>

#include "engine/math/linear_algebra.h"
#include "meshes/tet_mesh.h"

namespace palpate {

/// Principal stretches of a tetrahedron whose corners went from `rest` to `now` [m], longest first; the last is
/// negative where it is turned inside out.
Vec3<double> principal_stretches(const std::array<Point, 4>& rest, const std::array<Point, 4>& now);

/// Of each tetrahedron of a mesh whose nodes are at `now`, the principal stretches that strain limits see: its own, or
/// where limits are of patches, those of its patch's mean deformation.
std::vector<Vec3<double>> limited_stretches(const TetMesh& mesh, const std::vector<Point>& now);

/// The corners of one of a mesh.
template <class Node>  ///< of [node], with three numbers
std::array<Point, 4> corners(const std::vector<Node>& nodes, const std::array<int, 4>& tet) {
    std::array<Point, 4> out;
    for (std::size_t a = 0; a < 4; ++a) {
        const Node& x = nodes[std::size_t(tet[a])];
        out[a] = {x[0], x[1], x[2]};
    }
    return out;
}

}  // namespace palpate
