#pragma once
// What is wrong with a surface file, before OpenMesh reads it: its readers report success for truncated and empty
// files, drop faces with bad indices, replace NaN, allocate what a header claims, and read some files without end.

#include <cstdint>
#include <filesystem>
#include <istream>
#include <string>

namespace palpate {

/// Throws InputError with the file and what is wrong.
[[noreturn]] void refuse_file(const std::filesystem::path& path, const std::string& what);

/// Looks through an OBJ, STL, PLY or OFF file. Returns the triangles it declares (polygons count as the triangles they
/// are cut into), to be compared with what the reader gives. Throws InputError with what is wrong, and where.
long scan_surface_file(const std::filesystem::path& path);

/// Of an STL file: whether its size is that of as many triangles as a binary one declares.
bool is_binary_stl(std::istream& in, std::uintmax_t size);

/// ".obj" of "A.OBJ".
std::string lower_extension(const std::filesystem::path& path);

}  // namespace palpate
