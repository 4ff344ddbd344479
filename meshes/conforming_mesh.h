#pragma once
// A finger's soft tissue alone: tetrahedra between the skin and a phalanx whose surface they conform to.

#include "meshes/finger_regions.h"
#include "meshes/tetrahedralise.h"

namespace palpate {

/// How long edges are: `coarse` times as long on the back and in the bone as on the pad. Of the wanted number of
/// elements follows how long that is.
struct Grading {
    double coarse = 3;
    double bone = 1.5;  ///< of the bone's surface, over the pad's
};

/// The phalanx as a closed surface, by shares of the bounds of the skin in the finger frame: a capsule that begins
/// short of the cut, so that the tissue around it is one shell. Throws InputError where it leaves the skin.
Surface phalanx_surface(const Surface& skin, const FingerRegions& regions);

/// The regions with a phalanx that is narrower, by up to a half, and shorter with it, where theirs would come too near
/// to the skin: for fingers of which nobody said where the bone lies.
FingerRegions fitted_phalanx(const Surface& skin, FingerRegions regions);

/// Tetrahedra of the tissue. Bone nodes are those of the phalanx and the skin above the nail's height, to which the
/// skin's mesh conforms; pad nodes are the other nodes of the skin. `surface` is the skin: the phalanx is a hole.
TetMesh conforming_mesh(const Surface& skin, const FingerRegions& regions, const Grading& grading,
                        const TetrahedraliseSettings& settings);

}  // namespace palpate
