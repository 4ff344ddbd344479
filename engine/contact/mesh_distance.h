#pragma once
// Signed distance to a closed triangle mesh. Exact: nearest triangle by a tree of boxes, sign and normal by the
// pseudonormal of the nearest face, edge or vertex (Baerentzen & Aanaes 2005). For contact: a smooth field, because
// where nodes rest on the edges between facets, normals jump, and the solve chatters. On its surface the smooth field
// has a gradient of length one, so that a multiplier times it is as large as the multiplier.

#include <vector>

#include "engine/math/linear_algebra.h"
#include "meshes/surface.h"

namespace palpate {

struct DistanceMesh {
    struct Triangle {
        Vec3<double> corner, to_second, to_third;  ///< [m]
    };
    /// Four boxes; a child below 0 is a leaf: ~child = 8 x first triangle + triangles - 1.
    struct Node {
        std::array<std::array<float, 4>, 3> low, high;
        std::array<int, 4> child;
    };
    Surface surface;
    std::vector<Triangle> triangles;
    std::vector<std::array<Vec3<double>, 7>> normals;  ///< [triangle] face; edges 12, 23, 31; corners 1, 2, 3
    std::vector<Node> nodes;
    /// Exact distance and nearest triangle at the centres of a grid of cells. Quadratic B-splines over the distances
    /// are the smooth field; an exact search starts with the triangle.
    struct Grid {
        std::vector<float> distance;  ///< [m]
        std::vector<int> triangle;
    } grid;
    bool smooth = true;
    std::array<int, 3> cells{0, 0, 0};
    Vec3<double> grid_low{0, 0, 0};
    double cell = 0, per_cell = 0;  ///< edge [m], and one over it [1/m]
    /// Where walls are thinner than cells resolve: finer cells, in bricks of 8x8x8 near the surface; exact distances
    /// where those are too coarse, too. In between the fields are blended.
    struct Fine {
        static constexpr unsigned char thin = 1, thinnest = 2, some_thin = 4, all_thin = 8, some_thinnest = 16,
                                       all_thinnest = 32;
        double thinnest_wall = 0;  ///< all but a hundredth of the thin walls are thicker [m]; 0: none is thin
        double cell = 0;           ///< edge [m]; 0: no fine cells, thin walls are exact
        std::array<int, 3> bricks{0, 0, 0};
        std::vector<int> brick;           ///< [brick of the box] which; -1: none
        std::vector<float> distance;      ///< [brick][10][10][10] with one row of neighbours all around [m]
        std::vector<unsigned char> wall;  ///< [cell of `grid`] bits above; some, all: of the 27 cells around
    } fine;
    // As a body of density 1.
    double volume = 0;                            ///< [m^3]
    Vec3<double> centroid{0, 0, 0};               ///< [m]
    Mat3<double> inertia = Mat3<double>::zero();  ///< about the centroid [m^5]
    std::vector<Vec3<double>> support;            ///< outermost vertices in many directions: contact with planes
    struct Ball {
        Vec3<double> centre;  ///< [m]
        double radius;        ///< [m]
    };
    std::vector<Ball> balls;            ///< inside it, at these vertices and on faces: contact with other objects
    std::vector<Vec3<double>> corners;  ///< vertices that may stick between nodes of a skin
};

struct MeshPoint {
    double distance;      ///< [m] negative inside
    Vec3<double> normal;  ///< gradient of the distance; of length one, but for the smooth field off the surface
};

/// The surface must be closed (check_surface). `smoothing`: cells of the smooth field [m], edges become about as round;
/// 0: contact is exact; below 0: chosen by the size. Walls thinner than two cells get finer ones.
DistanceMesh build_distance_mesh(const Surface& surface, double smoothing = -1);

/// Exact.
MeshPoint mesh_distance(const DistanceMesh& mesh, const Vec3<double>& x);

/// What contact sees: the smooth field, or exact without smoothing. Farther out than 3 mm a distance that is too small,
/// but more than 3 mm.
MeshPoint mesh_contact_distance(const DistanceMesh& mesh, const Vec3<double>& x);

/// The same, but exact far out.
MeshPoint mesh_surface_distance(const DistanceMesh& mesh, const Vec3<double>& x);

}  // namespace palpate
