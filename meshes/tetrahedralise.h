#pragma once
// From a closed surface to tetrahedra, by TetGen in a guarded child process.

#include <string>

#include "meshes/surface.h"

namespace palpate {

struct TetrahedraliseSettings {
    int elements = 347;              ///< wanted count; the result is near it
    double time_limit_s = 20;        ///< per TetGen run
    double memory_limit_MiB = 2048;  ///< per TetGen run
};

/// Remeshes the surface to several resolutions and keeps the tetrahedra nearest to the wanted count.
/// Bone and pad nodes are left empty. Throws InputError when no resolution gives a sound mesh.
TetMesh tetrahedralise(const Surface& surface, const TetrahedraliseSettings& settings);

/// One TetGen run in the helper process, surface kept as it is; where `holes` has points, the surface has closed parts
/// around them that face inwards, and are left empty. Of a surface for an `object`, closed parts that lie in others and
/// face outwards become faces of elements on both sides. Throws InputError with what happened: refused surface, crash,
/// time or memory limit.
TetMesh run_tetgen(const Surface& surface, const std::string& switches, const TetrahedraliseSettings& settings,
                   const std::vector<Point>& holes = {}, SurfaceUse use = SurfaceUse::finger);

}  // namespace palpate
