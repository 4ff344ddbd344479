#pragma once
// OBJ and ASCII STL without OpenMesh's readers: those read numbers through streams of their own, whose decimal point is
// that of the locale of the program that embeds this.

#include <array>
#include <istream>
#include <vector>

namespace palpate {

/// Corners by vertex, in the file's order. Coordinates are rounded as OpenMesh does.
struct TextSurface {
    std::vector<std::array<float, 3>> vertices;
    std::vector<std::vector<int>> faces;
};

/// Both read what scan_surface_file (surface_scan.h) has found sound.
TextSurface read_obj(std::istream& in);
/// Coincident vertices are one.
TextSurface read_text_stl(std::istream& in);

}  // namespace palpate
