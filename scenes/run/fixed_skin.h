#pragma once
// Skin that does not touch: nodes of the surface that ride on the bone (nail, back, the rim of the cut).

#include <vector>

#include "engine/world.h"

namespace palpate {

/// Of one finger: its nodes of the surface that are bone nodes, in the finger frame [m], and a ball around them.
struct FixedSkin {
    std::vector<Vec3<double>> nodes;
    Vec3<double> centre{0, 0, 0};
    double radius = 0;  ///< [m]
};
FixedSkin fixed_skin_of(const TetMesh& mesh);

/// How deep the deepest of them is in an object that does not give way [m]; 0: none is. Nothing pushes it out.
double fixed_skin_depth(const FixedSkin& skin, const Pose<double>& bone, const Table<VirtualObject>& shapes);

}  // namespace palpate
