#pragma once
// Tetrahedral meshes from and to files.

#include <filesystem>

#include "meshes/tet_mesh.h"

namespace palpate {

/// Reads TetGen .node (with .ele beside it) or .ele, Gmsh .msh (ASCII, 2.x or 4.1) or VTK .vtu (ASCII).
/// Only tetrahedra are kept; elements are turned to positive orientation where all are turned alike.
/// `unit` is "m", "cm" or "mm". Bone and pad nodes are left empty. Throws InputError with file and line.
TetMesh read_tet_mesh(const std::filesystem::path& path, const std::string& unit);

/// One value, or three, per node or per element.
struct VtuField {
    std::string name;    ///< with its unit, for example "displacement_mm"
    int components = 1;  ///< 1 or 3
    std::vector<double> values;
};

/// Writes a VTK unstructured grid (ASCII XML, for ParaView), coordinates in millimetres. The file is
/// complete or absent. Throws as throw_unwritable.
void write_vtu(const std::filesystem::path& path, const TetMesh& mesh, const std::vector<VtuField>& node_fields,
               const std::vector<VtuField>& element_fields);

/// Throws what is wrong with a file that cannot be written, by errno: std::runtime_error where the machine is at fault
/// (the disk is full or broken, a quota or file size limit is reached), InputError where the path is.
[[noreturn]] void throw_unwritable(const std::filesystem::path& path, int error);

/// Writes text to a file under a temporary name, then renames it: the file is complete or absent. Throws as
/// throw_unwritable.
void write_file(const std::filesystem::path& path, const std::string& text);
/// A whole file. Throws InputError where it cannot be read.
std::string read_file(const std::filesystem::path& path);

}  // namespace palpate
