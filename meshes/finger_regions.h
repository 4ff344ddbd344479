#pragma once
// Which nodes of a finger mesh ride on the bone, and which can touch.

#include "meshes/surface.h"

namespace palpate {

/// Bone nodes: at the cut (proximal end), under the nail (dorsal strip) and inside the phalanx. Pad
/// nodes: the other nodes of the surface. Both by shares of the mesh's bounds in the finger frame.
struct FingerRegions {
    double cut = 0.06;             ///< share of the length, from the proximal end
    double nail = 0.74;            ///< share of the thickness, from the pad; above it is nail and back
    double phalanx_length = 0.70;  ///< share of the length reached by the bone, from the proximal end
    double phalanx_height = 0.60;  ///< share of the thickness at which its axis lies
    double phalanx_radius = 0.20;  ///< share of the thickness
    bool operator==(const FingerRegions&) const = default;
};
void mark_regions(TetMesh& mesh, const FingerRegions& regions);

/// Bone nodes = nodes on the positive side of a plane (normal . x > offset) [m]; pad = the other
/// surface nodes.
void mark_half_space(TetMesh& mesh, const Point& normal, double offset);

/// Pad nodes = surface nodes that are not bone nodes.
void mark_pad(TetMesh& mesh);

}  // namespace palpate
