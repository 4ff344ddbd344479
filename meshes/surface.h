#pragma once
// Closed triangle surfaces: reading, checking, measuring.

#include <filesystem>
#include <string>

#include "meshes/tet_mesh.h"

namespace palpate {

/// Triangles with outward orientation. Lengths in metres unless said otherwise.
struct Surface {
    std::vector<Point> vertices;
    std::vector<std::array<int, 3>> triangles;
};

struct SurfaceFile {
    Surface surface;   ///< [m]
    std::string unit;  ///< "m", "cm" or "mm"
    bool unit_was_guessed = false;
};

/// What a surface is for: a finger is tetrahedralised, an object needs a signed distance alone.
enum class SurfaceUse { finger, object };

/// Reads OBJ, STL, PLY or OFF through OpenMesh; welds coincident vertices. `unit` is "m", "cm", "mm",
/// or empty to guess it from the size of a fingertip. Throws InputError for files that are missing,
/// empty, truncated, or hold anything else than a usable closed surface (see check_surface).
SurfaceFile read_surface(const std::filesystem::path& path, const std::string& unit = "",
                         SurfaceUse use = SurfaceUse::finger);

/// What keeps a surface from its use: not finite, degenerate, open, non-manifold, inconsistently oriented, inside out;
/// of a finger also several parts, self-intersecting. Empty if nothing does.
std::vector<std::string> check_surface(const Surface& surface, SurfaceUse use = SurfaceUse::finger);

/// Volume enclosed [m^3]; negative where the triangles face inward.
double volume(const Surface& surface);

/// Lower and upper corner of the axis-aligned bounds [m].
std::array<Point, 2> bounds(const std::vector<Point>& points);

}  // namespace palpate
