// Meshes and files of meshes are the same in a program whose decimal point is a comma.

#include <fstream>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/object_mesh.h"
#include "tests/comma_locale.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// A tetrahedron with corners that are no whole numbers, in each kind of file.
const char* const obj_text =
    "v 0.25 0.5 -0.125\nv 20.5 0.1 0.3\nv 0.7 19.3 0.2\nv 0.1 0.4 18.9\n"
    "f 1 3 2\nf 1/7 2/7/7 4//7\nf -3 -2 -1\nf 3 1 4\n";
const char* const off_text =
    "OFF\n4 4 6\n0.25 0.5 -0.125\n20.5 0.1 0.3\n0.7 19.3 0.2\n0.1 0.4 18.9\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
const char* const ply_text =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    "0.25 0.5 -0.125\n20.5 0.1 0.3\n0.7 19.3 0.2\n0.1 0.4 18.9\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
const char* const gmsh_text =
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0.25 0.5 -0.125\n2 20.5 0.1 0.3\n3 0.7 19.3 0.2\n"
    "4 0.1 0.4 18.9\n$EndNodes\n$Elements\n1\n1 4 2 0 1 1 2 3 4\n$EndElements\n";

std::string stl_text() {
    const char* corners[] = {"0.25 0.5 -0.125", "20.5 0.1 0.3", "0.7 19.3 0.2", "0.1 0.4 18.9"};
    std::string out = "solid t\n";
    for (const auto& f : {std::array{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}) {
        out += "facet normal 0.0 0.0 1.0\nouter loop\n";
        for (int k : f) out += std::string("vertex ") + corners[k] + "\n";
        out += "endloop\nendfacet\n";
    }
    return out + "endsolid t\n";
}

struct Everything {
    TetMesh slab;
    std::vector<Surface> surfaces;
    TetMesh gmsh;
    std::string vtu, complaint;
};

Everything made_in(const std::filesystem::path& folder) {
    Everything e;
    const auto box = [](double edge) { return box_surface({0.02525, 0.02825, 0.00925}, edge); };
    e.slab = mesh_object(box, 0.0505 * 0.0565 * 0.0185, {}, {.elements = 300}).mesh;
    for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
             {"t.obj", obj_text}, {"t.off", off_text}, {"t.ply", ply_text}, {"t.STL", stl_text()}}) {
        std::ofstream(folder / name, std::ios::binary) << text;
        e.surfaces.push_back(read_surface(folder / name, "mm").surface);
    }
    std::ofstream(folder / "t.msh") << gmsh_text;
    e.gmsh = read_tet_mesh(folder / "t.msh", "mm");
    write_vtu(folder / "t.vtu", e.gmsh, {{"half", 1, {0.5, 1.5, 2.5, 1234567.5}}}, {});
    e.vtu = read_file(folder / "t.vtu");
    try {
        read_surface(folder / "t.obj", "cm");
    } catch (const InputError& error) { e.complaint = error.what(); }
    return e;
}

TEST(Locale, MeshesAndTheirFilesAreTheSameWhereTheDecimalPointIsAComma) {
    const testing::ScratchFolder scratch;
    const Everything plain = made_in(scratch.path);
    EXPECT_DOUBLE_EQ(20.5e-3, std::max({plain.surfaces[0].vertices[0][0], plain.surfaces[0].vertices[1][0],
                                        plain.surfaces[0].vertices[2][0]}));
    const testing::CommaLocale locale;
    const Everything comma = made_in(scratch.path);
    EXPECT_EQ(plain.slab.nodes, comma.slab.nodes);
    EXPECT_EQ(plain.slab.tets, comma.slab.tets);
    for (std::size_t k = 0; k < plain.surfaces.size(); ++k) {
        EXPECT_EQ(plain.surfaces[k].vertices, comma.surfaces[k].vertices) << k;
        EXPECT_EQ(plain.surfaces[k].triangles, comma.surfaces[k].triangles) << k;
        EXPECT_EQ(4u, plain.surfaces[k].vertices.size()) << k;
    }
    EXPECT_EQ(plain.gmsh.nodes, comma.gmsh.nodes);
    EXPECT_EQ(plain.vtu, comma.vtu);
    EXPECT_NE(std::string::npos, plain.complaint.find("its bounds measure 33"));
    EXPECT_EQ(plain.complaint, comma.complaint);
    if (!locale.c_too)
        std::printf("no locale with a comma is installed, nor can one be compiled: C++'s alone was tried\n");
}

/// Notepad and spreadsheets mark text as UTF-8 by three bytes at its beginning.
TEST(TextFiles, MayBeginWithAByteOrderMark) {
    const testing::ScratchFolder scratch;
    const auto marked = [&](const char* name, const std::string& text) {
        std::ofstream(scratch.path / name, std::ios::binary) << "\xef\xbb\xbf" << text;
        return scratch.path / name;
    };
    for (const auto& [name, text] : std::vector<std::pair<const char*, std::string>>{
             {"t.obj", obj_text}, {"t.off", off_text}, {"t.ply", ply_text}}) {
        std::ofstream(scratch.path / (std::string("plain_") + name)) << text;
        EXPECT_EQ(read_surface(scratch.path / (std::string("plain_") + name), "mm").surface.vertices,
                  read_surface(marked(name, text), "mm").surface.vertices);
    }
    EXPECT_EQ(4u, read_tet_mesh(marked("t.msh", gmsh_text), "mm").nodes.size());
}

}  // namespace
}  // namespace palpate
