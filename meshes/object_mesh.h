#pragma once
// Tetrahedra that fill an object, and the stiffer or softer parts inside it.

#include <functional>

#include "meshes/tetrahedralise.h"

namespace palpate {

/// Closed surfaces around the origin, with edges of about the wanted length [m]; edges and rims stay sharp.
Surface box_surface(const Point& half, double edge_length);
Surface cylinder_surface(double radius, double half_length, double edge_length);  ///< along z
/// A capsule along z; without a length, a sphere. Its vertices lie so that it has the volume of the smooth one.
Surface capsule_surface(double radius, double half_length, double edge_length);

/// The surface of an object with edges of a wanted length [m].
using SurfaceOfSize = std::function<Surface(double)>;

/// A ball inside an object whose surface elements do not cross.
struct Inclusion {
    Point centre{0, 0, 0};
    double radius = 0;  ///< [m]
};

struct ObjectMesh {
    TetMesh mesh;                ///< without bone and pad nodes
    std::vector<int> inclusion;  ///< [tet] which one it lies in; -1: none
};

/// Fills a surface with about the wanted number of tetrahedra, as tetrahedralise does. Inclusions must lie inside,
/// apart from each other. Throws InputError when no size of elements gives a sound mesh.
ObjectMesh mesh_object(const SurfaceOfSize& surface, double volume, const std::vector<Inclusion>& inclusions,
                       const TetrahedraliseSettings& settings);

}  // namespace palpate
