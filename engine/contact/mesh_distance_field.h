#pragma once
// Inside of mesh distances: the exact search, the thickness of walls, and the smooth field made of both.

#include <vector>

#include "engine/contact/mesh_distance.h"

namespace palpate {

/// Nearest triangle to a point.
struct Found {
    Vec3<double> offset;  ///< from the nearest point to x [m]
    double distance2;     ///< [m^2]
    int triangle, feature;
};
/// Starts with a guess.
Found nearest_triangle(const DistanceMesh& mesh, const Vec3<double>& x, int guess);
/// Distance and normal at the point that `found` is nearest to.
MeshPoint signed_point(const DistanceMesh& mesh, const Found& found);

/// A point of the surface of a thin wall.
struct WallPoint {
    Vec3<double> point;  ///< [m]
    double thickness;    ///< [m]
};
/// Points about `spacing` apart, of those places of the surface behind which, less than `thickest` below, lies another
/// place that faces the other way: thin walls, but no edges where the surface folds.
std::vector<WallPoint> thin_walls(const DistanceMesh& mesh, double spacing, double thickest);

/// Grid of the smooth field, finer cells at thin walls. `smoothing` as in build_distance_mesh.
void build_field(DistanceMesh& mesh, double smoothing);

/// Points at which its contact with other objects is decided.
void set_points(DistanceMesh& mesh);

}  // namespace palpate
