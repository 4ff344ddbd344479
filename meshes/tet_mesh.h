#pragma once
// A tetrahedral mesh as plain data. No dependency, so that the engine can be embedded without the mesher.

#include <array>
#include <string>
#include <vector>

namespace palpate {

using Point = std::array<double, 3>;  ///< [m]

/// How much of an element's volume lies in a limit patch whose bounds cut it.
struct LimitShare {
    int tet, patch;
    double share;
    friend bool operator==(const LimitShare&, const LimitShare&) = default;
};

/// Tetrahedra with det(x1-x0, x2-x0, x3-x0) > 0. Finger frame: x distal, y radial, z from pad to nail.
struct TetMesh {
    std::vector<Point> nodes;                 ///< [m]
    std::vector<std::array<int, 4>> tets;     ///< node indices
    std::vector<std::array<int, 3>> surface;  ///< boundary triangles, outward
    std::vector<int> bone_nodes;              ///< nodes tied to the bone, ascending
    std::vector<int> pad_nodes;               ///< surface nodes that can touch, ascending
    std::vector<int>
        patches;  ///< [tet] number, from 0, of the patch that shares one change of volume; empty: none does
    std::vector<int> limit_patches;  ///< [tet] number, from 0, of the patch whose mean deformation strain limits hold;
                                     ///< empty: each tetrahedron's own
    std::vector<LimitShare> limit_shares;  ///< of tetrahedra that lie in several limit patches, ascending: their part
                                           ///< in each; the others are wholly in the one above
    std::vector<int> membrane_patches;     ///< [tet] number, from 0, of the patch of skin whose mean stretch a membrane
                                           ///< resists; -1, or empty: its own
    bool curved_skin = false;  ///< between nodes the skin that touches is as round as the surface's normals say
};

}  // namespace palpate
