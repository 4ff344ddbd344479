// Surfaces, remeshing, TetGen in its helper, files: a failing and a passing twin of each bad input.

#include <cmath>
#include <cstring>
#include <fstream>

#include <set>

#include "meshes/conforming_mesh.h"
#include "meshes/finger_regions.h"
#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/mesh_quality.h"
#include "meshes/remesh.h"
#include "meshes/tetrahedralise.h"
#include "scenes/load/finger_mesh.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::ScratchFolder;

/// A cube of 20 mm as twelve triangles, in OBJ text with millimetres.
const char* const cube_vertices =
    "v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 0\nv 0 0 20\nv 20 0 20\nv 20 20 20\nv 0 20 20\n";
const char* const cube_faces =
    "f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n";

class SurfaceFiles : public ::testing::Test {
  protected:
    std::filesystem::path write(const std::string& name, const std::string& text) {
        const auto path = scratch_.path / name;
        std::ofstream(path, std::ios::binary) << text;
        return path;
    }
    /// The message a file is refused with; empty if it is accepted.
    std::string refusal(const std::string& name, const std::string& text, const std::string& unit = "mm") {
        try {
            read_surface(write(name, text), unit);
            return "";
        } catch (const InputError& error) { return error.what(); }
    }
    ScratchFolder scratch_;
};

#define EXPECT_REFUSED(message, part) EXPECT_NE((message).find(part), std::string::npos) << "found: " << (message)

TEST_F(SurfaceFiles, ACubeIsRead) {
    const SurfaceFile f = read_surface(write("cube.obj", std::string(cube_vertices) + cube_faces), "mm");
    EXPECT_NEAR(volume(f.surface), 8e-6, 1e-15);
    EXPECT_EQ(f.surface.vertices.size(), 8u);
    EXPECT_TRUE(read_surface(write("cube.obj", std::string(cube_vertices) + cube_faces)).unit_was_guessed);
    EXPECT_EQ(read_surface(write("cube.obj", std::string(cube_vertices) + cube_faces)).unit, "mm");
}

TEST_F(SurfaceFiles, BadObjIsRefused) {
    EXPECT_REFUSED(refusal("empty.obj", ""), "empty");
    EXPECT_REFUSED(refusal("nothing.obj", "# no geometry\n"), "0 triangles");
    EXPECT_REFUSED(refusal("index.obj", std::string(cube_vertices) + cube_faces + "f 1 2 9\n"), "line 21");
    EXPECT_REFUSED(refusal("nan.obj", "v 0 0 nan\n" + std::string(cube_vertices) + cube_faces), "line 1");
    EXPECT_REFUSED(refusal("cut.obj", std::string(cube_vertices) + "f 1 3\n"), "truncated");
    std::string open(cube_faces);
    EXPECT_REFUSED(refusal("open.obj", std::string(cube_vertices) + open.substr(open.find('\n') + 1)), "open");
    EXPECT_REFUSED(refusal("crowded.obj", std::string(cube_vertices) + "v 10 10 40\n" + cube_faces + "f 1 3 9\n"),
                   "non-manifold");
    EXPECT_REFUSED(refusal("huge.obj", std::string(cube_vertices) + cube_faces, "m"), "unit");
    EXPECT_REFUSED(refusal("unit.obj", std::string(cube_vertices) + cube_faces, "inch"), "unknown unit");
    EXPECT_THROW(read_surface(scratch_.path / "absent.obj"), InputError);
    EXPECT_REFUSED(refusal("kind.xyz", "1 2 3"), "unknown kind");
}

TEST_F(SurfaceFiles, WhatATriangleLacksIsNamed) {
    EXPECT_REFUSED(refusal("flat.obj", std::string(cube_vertices) + cube_faces + "f 1 1 2\n"),
                   "line 21: a face has vertex 1 twice");
    EXPECT_REFUSED(refusal("flat.obj", std::string(cube_vertices) + cube_faces + "f 1 -8 2\n"), "twice");
    std::string stl(84 + 50 * 2, '\0');
    stl[80] = 2;
    const float nothing = std::nanf("");
    std::memcpy(&stl[84 + 50 + 12 + 4], &nothing, sizeof nothing);
    EXPECT_REFUSED(refusal("nan.stl", stl), "triangle 2 of 2 has a corner that is no finite number");
}

TEST_F(SurfaceFiles, InvertedAndCrossingSurfacesAreRefused) {
    std::string inward;
    for (const char* face : {"f 1 2 3", "f 1 3 4", "f 5 7 6", "f 5 8 7", "f 1 6 2", "f 1 5 6", "f 2 7 3", "f 2 6 7",
                             "f 3 8 4", "f 3 7 8", "f 4 5 1", "f 4 8 5"})
        inward += std::string(face) + "\n";
    EXPECT_REFUSED(refusal("inward.obj", std::string(cube_vertices) + inward), "inside out");
    // The top corner pushed through the bottom.
    std::string crossed(cube_vertices);
    crossed.replace(crossed.find("v 20 20 20"), 10, "v 5 5 -20");
    EXPECT_REFUSED(refusal("crossed.obj", crossed + cube_faces), "intersects itself");
    std::string two(cube_vertices);
    EXPECT_REFUSED(refusal("parts.obj", two + "v 30 0 0\nv 40 0 0\nv 30 10 0\nv 30 0 10\n" + cube_faces +
                                            "f 9 11 10\nf 9 10 12\nf 9 12 11\nf 10 11 12\n"),
                   "2 separate parts");
}

TEST_F(SurfaceFiles, TruncatedBinaryAndHeadersThatLieAreRefused) {
    std::string stl(84, '\0');
    stl[80] = 12;
    EXPECT_REFUSED(refusal("cut.stl", stl + std::string(100, '\0')), "truncated");
    EXPECT_REFUSED(refusal("ascii.stl", "solid x\nfacet normal 0 0 1\n"), "endsolid");
    EXPECT_REFUSED(refusal("liar.off", "OFF\n900000000 900000000 0\n0 0 0\n"), "truncated");
    EXPECT_REFUSED(
        refusal("liar.ply", "ply\nformat ascii 1.0\nelement vertex 1000000\nelement face 1000000\nend_header\n"),
        "truncated");
    EXPECT_REFUSED(refusal("not.off", "FFO\n1 1 0\n"), "expected 'OFF'");
    // The passing twin: a cube in OFF.
    std::string off = "OFF\n8 12 0\n0 0 0\n20 0 0\n20 20 0\n0 20 0\n0 0 20\n20 0 20\n20 20 20\n0 20 20\n";
    for (const char* f :
         {"0 2 1", "0 3 2", "4 5 6", "4 6 7", "0 1 5", "0 5 4", "1 2 6", "1 6 5", "2 3 7", "2 7 6", "3 0 4", "3 4 7"})
        off += std::string("3 ") + f + "\n";
    EXPECT_EQ(refusal("cube.off", off), "");
    EXPECT_NE(refusal("cut.off", off.substr(0, off.size() - 30)), "");
}

/// A cube in every way in which PLY and OFF say it, and what OpenMesh's readers take for one, or never leave.
TEST_F(SurfaceFiles, PlyAndOffAreLookedThroughBeforeTheyAreRead) {
    const std::vector<std::array<float, 3>> corners{{0, 0, 0},  {20, 0, 0},  {20, 20, 0},  {0, 20, 0},
                                                    {0, 0, 20}, {20, 0, 20}, {20, 20, 20}, {0, 20, 20}};
    const std::vector<std::array<int, 4>> sides{{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                                {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
    const std::string properties =
        "element vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 6\nproperty list uchar "
        "int "
        "vertex_indices\nend_header\n";
    std::string text = "ply\nformat ascii 1.0\ncomment a cube\n" + properties;
    std::string little = "ply\nformat binary_little_endian 1.0\n" + properties;
    std::string big = "ply\nformat binary_big_endian 1.0\n" + properties;
    auto put = [&](const void* value) {
        const char* p = static_cast<const char*>(value);
        little.append(p, 4);
        for (int k = 3; k >= 0; --k) big += p[k];
    };
    for (const auto& c : corners)
        for (int k = 0; k < 3; ++k) {
            put(&c[std::size_t(k)]);
            text.append(std::to_string(c[std::size_t(k)])).append(k < 2 ? " " : "\n");
        }
    for (const auto& f : sides) {
        little += '\4', big += '\4';
        text.append("4");
        for (int i : f) put(&i), text.append(" ").append(std::to_string(i));
        text.append("\n");
    }
    EXPECT_EQ(refusal("text.ply", text), "");
    EXPECT_EQ(refusal("little.ply", little), "");
    EXPECT_EQ(refusal("big.ply", big), "");
    auto with = [](std::string s, const std::string& from, const std::string& to) {
        return s.replace(s.find(from), from.size(), to);
    };
    for (const std::string& whole : {text, little, big})
        for (std::size_t cut : {3u, 10u, 40u}) EXPECT_NE(refusal("cut.ply", whole.substr(0, whole.size() - cut)), "");
    EXPECT_REFUSED(refusal("key.ply", with(text, "element face", "elephant face")),
                   "line 8 is no line of a PLY header");
    EXPECT_REFUSED(refusal("format.ply", with(text, "ascii 1.0", "asci 1ertex 4")), "line 2 is no line");
    EXPECT_REFUSED(refusal("type.ply", with(text, "float y", "flaot y")), "line 6 is no line");
    EXPECT_REFUSED(refusal("twice.ply", with(text, "element face 6", "element vertex 6")), "line 8");
    EXPECT_REFUSED(refusal("endless.ply", with(text, "end_header", "endheader")), "line 10 is no line");
    EXPECT_REFUSED(refusal("index.ply", with(text, "4 0 3 2 1", "4 0 3 2 9")),
                   "line 19: expected a vertex that exists");
    EXPECT_REFUSED(refusal("corners.ply", with(text, "4 0 3 2 1", "2 0 3")), "at least three");
    EXPECT_REFUSED(refusal("nan.ply", with(text, "20.0", "nan.")), "finite");
    EXPECT_REFUSED(refusal("list.ply", with(text, "vertex_indices", "corner_numbers")), "no list 'vertex_indices'");
    std::string huge = little;
    huge[little.size() - 17] = '\xff';
    EXPECT_REFUSED(refusal("huge.ply", huge), "ends before");
    const std::string off = "OFF\n4 4 0\n0 0 0\n20 0 0\n0 20 0\n0 0 20\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    EXPECT_EQ(refusal("tetrahedron.off", off), "");
    EXPECT_REFUSED(refusal("face.off", with(off, "3 0 3 2", "314444444444444444 0 3 2")), "line 9: expected a face's");
    EXPECT_REFUSED(refusal("vertex.off", with(off, "3 0 3 2", "3 0 3 -2")), "a vertex that exists");
    EXPECT_REFUSED(refusal("binary.off", with(off, "OFF", "OFF BINARY")), "expected 'OFF' alone");
}

TEST(Finger, ShapesAreClosedSoundAndSymmetric) {
    for (const char* name : {"thumb", "index", "middle", "ring", "little"}) {
        const Surface s = finger_surface(finger_shape(name));
        EXPECT_TRUE(check_surface(s).empty()) << name;
        EXPECT_GT(volume(s), 1.5e-6);
        const auto box = bounds(s.vertices);
        EXPECT_NEAR(box[0][1], -box[1][1], 1e-12);
    }
    EXPECT_THROW(finger_shape("toe"), InputError);
    FingerShape bad;
    bad.length = 1;
    EXPECT_THROW(finger_surface(bad), InputError);
}

TEST(Remesh, KeepsVolumeAndTopology) {
    const Surface finger = finger_surface(finger_shape("index"));
    const TriangleTree tree(finger);
    for (double edge : {0.0042, 0.0024}) {
        const Surface s = remesh(tree, edge);
        EXPECT_TRUE(check_surface(s).empty());
        EXPECT_NEAR(volume(s), volume(finger), 1e-6 * volume(finger));
        EXPECT_EQ(int(s.vertices.size()) - int(s.triangles.size()) / 2, 2);  // Euler, genus 0
    }
}

TEST(Tetrahedralise, WantedCountAndQuality) {
    const Surface finger = finger_surface(finger_shape("middle"));
    for (int wanted : {347, 2000}) {
        const TetMesh mesh = tetrahedralise(finger, {.elements = wanted});
        EXPECT_NEAR(double(mesh.tets.size()), wanted, 0.1 * wanted);
        const MeshQuality q = measure_quality(mesh);
        EXPECT_NEAR(q.volume, volume(finger), 1e-3 * volume(finger));
        EXPECT_GT(q.worst_dihedral_deg, 10);
        EXPECT_TRUE(check_tets(mesh).empty());
    }
    EXPECT_THROW(tetrahedralise(finger, {.elements = 3}), InputError);
}

TEST(ConformingMesh, IsOneFingerAtEverySize) {
    const Surface skin = finger_surface(finger_shape("index"));
    const FingerRegions regions;
    const auto box = bounds(skin.vertices);
    const double thickness = box[1][2] - box[0][2], nail = box[0][2] + regions.nail * thickness;
    const double radius = regions.phalanx_radius * thickness;
    const Surface phalanx = phalanx_surface(skin, regions);
    const double tissue = volume(skin) - volume(phalanx);
    for (int wanted : {347, 1000, 4000}) {
        if (wanted == 1000 && !testing::is_tried(1, 2)) continue;
        const TetMesh mesh = conforming_mesh(skin, regions, {}, {.elements = wanted});
        EXPECT_NEAR(double(mesh.tets.size()), wanted, 0.1 * wanted);
        EXPECT_TRUE(check_tets(mesh).empty());
        const MeshQuality q = measure_quality(mesh);
        EXPECT_GT(q.worst_dihedral_deg, 5) << wanted;
        // Chords cut the back, where edges are long.
        EXPECT_NEAR(q.volume, tissue, (wanted < 1000 ? 0.3 : wanted < 4000 ? 0.15 : 0.06) * tissue) << wanted;
        double lowest = 1;
        for (int i : mesh.pad_nodes) lowest = std::min(lowest, mesh.nodes[i][2]);
        EXPECT_NEAR(lowest, box[0][2], 1e-4) << wanted;
        int inside = 0;
        for (int i : mesh.bone_nodes) {
            const Eigen::Vector3d x(mesh.nodes[i][0], mesh.nodes[i][1], mesh.nodes[i][2]);
            const double from_axis =
                std::hypot(x[1] - 0.5 * (box[0][1] + box[1][1]), x[2] - box[0][2] - regions.phalanx_height * thickness);
            const bool in_phalanx = from_axis < 1.02 * radius && x[0] < box[0][0] + 0.71 * (box[1][0] - box[0][0]);
            EXPECT_TRUE(in_phalanx || x[2] > nail - 1e-8);
            inside += in_phalanx;
        }
        EXPECT_GE(inside, 8);
        for (const auto& t : mesh.surface) {  // the nail's edge runs along edges
            bool above = false, below = false;
            for (int i : t) above |= mesh.nodes[i][2] > nail + 1e-8, below |= mesh.nodes[i][2] < nail - 1e-8;
            EXPECT_FALSE(above && below);
        }
    }
}

TEST(ConformingMesh, APhalanxThatLeavesTheSkinIsRefusedWithItsPlace) {
    const Surface skin = finger_surface(finger_shape("index"));
    auto refusal = [&](const FingerRegions& r) -> std::string {
        try {
            conforming_mesh(skin, r, {}, {.elements = 347});
        } catch (const InputError& error) { return error.messages.front(); }
        return "";
    };
    EXPECT_NE(refusal({.phalanx_radius = 0.45}).find("mm"), std::string::npos);
    EXPECT_NE(refusal({.phalanx_height = 0.95}).find("skin at ("), std::string::npos);
    EXPECT_NE(refusal({.phalanx_length = 1.0}).find("skin at ("), std::string::npos);
    EXPECT_NE(refusal({.phalanx_length = 0.2}).find("too short"), std::string::npos);
}

TEST(Tetgen, AHostileSurfaceOrATimeLimitIsAMessage) {
    const Surface finger = finger_surface(finger_shape("middle"));
    EXPECT_THROW(run_tetgen(Surface{}, "pY", {}), InputError);
    Surface open = finger;
    open.triangles.pop_back();
    EXPECT_THROW(run_tetgen(open, "pY", {}), InputError);
    try {
        run_tetgen(finger, "pYq1.1a1e-15", {.time_limit_s = 0.3});
        FAIL() << "a tetrahedralisation of millions of elements in 0.3 s";
    } catch (const InputError& error) { EXPECT_NE(std::string(error.what()).find("TetGen"), std::string::npos); }
    EXPECT_GT(run_tetgen(remesh(TriangleTree(finger), 0.004), "pY", {}).tets.size(), 50u);  // and works again
}

TEST(TetFiles, VtuRoundTrip) {
    ScratchFolder scratch;
    TetMesh mesh = testing::block_mesh(2, 2, 2, 0.005);
    write_vtu(scratch.path / "a.vtu", mesh, {{"x", 1, std::vector<double>(mesh.nodes.size(), 1.5)}}, {});
    const TetMesh back = read_tet_mesh(scratch.path / "a.vtu", "mm");
    ASSERT_EQ(back.nodes.size(), mesh.nodes.size());
    EXPECT_EQ(back.tets, mesh.tets);
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i)
        for (int d = 0; d < 3; ++d) EXPECT_NEAR(back.nodes[i][d], mesh.nodes[i][d], 1e-10);
    EXPECT_FALSE(std::filesystem::exists(scratch.path / "a.vtu.part"));
    EXPECT_THROW(write_vtu(scratch.path / "no" / "such.vtu", mesh, {}, {}), InputError);
}

TEST(TetFiles, WhatIsNoPlainFileIsWrittenToAndNotReplaced) {
    namespace fs = std::filesystem;
    const ScratchFolder scratch;
    const fs::path file = scratch.path / "file", link = scratch.path / "link", full = scratch.path / "full";
    std::ofstream(file) << "before";
    fs::create_symlink(file, link);
    write_file(link, "now");
    EXPECT_TRUE(fs::is_symlink(link));
    std::string text;
    std::ifstream(file) >> text;
    EXPECT_EQ(text, "now");
    // A device by its link, so that nothing but the link could be lost.
    fs::create_symlink("/dev/full", full);
    EXPECT_THROW(write_file(full, "lost"), std::runtime_error);
    EXPECT_TRUE(fs::is_symlink(full));
}

TEST(TetFiles, TetgenAndGmsh) {
    ScratchFolder scratch;
    auto write = [&](const char* name, const std::string& text) {
        std::ofstream(scratch.path / name) << text;
        return scratch.path / name;
    };
    const std::string nodes = "5 3 0 0\n1 0 0 0\n2 10 0 0\n3 0 10 0\n4 0 0 10\n5 10 10 10\n",
                      tets = "2 4 0\n1 1 2 3 4\n2 2 3 4 5 \n";
    write("a.node", nodes);
    write("a.ele", tets);
    EXPECT_EQ(read_tet_mesh(scratch.path / "a.node", "mm").tets.size(), 2u);
    write("a.ele", "2 4 0\n1 1 2 3 4\n2 2 3 5 4\n");
    try {
        read_tet_mesh(scratch.path / "a.ele", "mm");
        FAIL() << "the second element is inverted";
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("is inverted"), std::string::npos) << error.what();
    }
    const std::string msh2 =
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 10 0 0\n3 0 10 0\n4 0 0 "
        "10\n$EndNodes\n$Elements\n2\n1 2 2 1 1 1 2 3\n2 4 2 1 1 1 2 3 4\n$EndElements\n";
    EXPECT_EQ(read_tet_mesh(write("b.msh", msh2), "mm").tets.size(), 1u);
    const std::string msh4 =
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n10 0 0\n0 10 0\n0 0 "
        "10\n$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";
    EXPECT_EQ(read_tet_mesh(write("c.msh", msh4), "mm").tets.size(), 1u);
    for (const std::string& bad : {msh2.substr(0, 90), std::string("$Nodes\n"), std::string("")})
        EXPECT_THROW(read_tet_mesh(write("bad.msh", bad), "mm"), InputError);
    EXPECT_THROW(read_tet_mesh(write("d.msh", msh2), "m"), InputError);  // 10 m large
    std::string flat = msh2;
    flat.replace(flat.find("4 0 0 10"), 8, "4 5 5 00");
    EXPECT_THROW(read_tet_mesh(write("flat.msh", flat), "mm"), InputError);
}

TEST(RealFingers, MeshAtBothResolutions) {
    PALPATE_NEED_SHARED_DATA(data);
    for (const char* name : {"mh_index_distal.obj", "webxr_thumb_distal.obj"})
        for (int wanted : {350, 2000}) {
            FingerMeshRequest r;
            r.source = FingerMeshRequest::Source::surface;
            r.file = (data / "fingers" / name).string();
            r.elements = wanted;
            FingerTemplates templates;
            std::string note;
            const TetMesh mesh = make_finger_mesh(r, templates, note);
            EXPECT_NEAR(double(mesh.tets.size()), wanted, 0.1 * wanted) << note;
            EXPECT_TRUE(check_tets(mesh).empty());
            EXPECT_NE(note.find("guessed"), std::string::npos);
            // Not every scan has room for a phalanx: a sound mesh, or a refusal.
            r.kind = FingerMeshRequest::Kind::conforming;
            try {
                const TetMesh conforming = make_finger_mesh(r, templates, note);
                EXPECT_NEAR(double(conforming.tets.size()), wanted, 0.3 * wanted) << note;
                EXPECT_TRUE(check_tets(conforming).empty());
            } catch (const InputError& error) { EXPECT_FALSE(error.messages.empty()); }
        }
}

/// What all sizes come through is gone through once, in whatever order they are asked for.
TEST(Remesher, OfSeveralSizesMakesWhatEachAloneWould) {
    const TriangleTree tree(finger_surface(finger_shape("index")));
    auto graded = [](const Eigen::Vector3d& x) { return x[2] > 0 ? 0.004 : 0.0022; };
    Remesher shared(tree);
    for (const double edge : {0.004, 0.0015, 0.0025, 0.0005, 0.006}) {
        const Surface a = shared(edge), b = remesh(tree, edge);
        EXPECT_EQ(a.vertices, b.vertices) << edge;
        EXPECT_EQ(a.triangles, b.triangles) << edge;
    }
    const Surface a = shared(graded), b = Remesher(tree)(graded);
    EXPECT_EQ(a.vertices, b.vertices);
    EXPECT_EQ(a.triangles, b.triangles);
}

TEST(PadShape, SwellsRisesAndComesBack) {
    const FingerShape shape = finger_shape("index");
    FingerShape swollen = shape, creased = shape;
    swollen.pad_bulge = 0.3, creased.crease = 0.2;
    const std::vector<Point> before = finger_surface(shape).vertices, risen = finger_surface(creased).vertices;
    for (const FingerShape& wanted : {swollen, creased}) {
        std::vector<Point> nodes = before, made = finger_surface(wanted).vertices;
        change_pad(nodes, shape, wanted);
        for (std::size_t i = 0; i < nodes.size(); ++i) EXPECT_NEAR(nodes[i][2], made[i][2], 1e-12);
        change_pad(nodes, wanted, shape);
        for (std::size_t i = 0; i < nodes.size(); ++i) EXPECT_NEAR(nodes[i][2], before[i][2], 1e-12);
    }
    EXPECT_LT(bounds(finger_surface(swollen).vertices)[0][2], 1.05 * bounds(before)[0][2]);
    // A crease moves nothing but the pad side near the cut, whose lowest place then is a fifth higher.
    double low = 0, low_before = 0;
    for (std::size_t i = 0; i < before.size(); ++i) {
        if (before[i][0] > -0.2 * shape.length) { EXPECT_EQ(risen[i][2], before[i][2]); }
        if (before[i][0] < -0.499 * shape.length)
            low = std::min(low, risen[i][2]), low_before = std::min(low_before, before[i][2]);
    }
    EXPECT_NEAR(low, 0.8 * low_before, 1e-5);
}

}  // namespace
}  // namespace palpate
