// Meshes that were made once are the same when they are read, and a damaged one is made anew.

#include "meshes/mesh_cache.h"

#include <cstdlib>
#include <fstream>
#include <thread>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "scenes/load/finger_mesh.h"
#include "tests/support.h"

namespace palpate {
namespace {

bool same(const TetMesh& a, const TetMesh& b) {
    return a.nodes == b.nodes && a.tets == b.tets && a.surface == b.surface && a.bone_nodes == b.bone_nodes &&
           a.pad_nodes == b.pad_nodes && a.patches == b.patches;
}

/// With a cache of its own.
class MeshCache : public ::testing::Test {
  protected:
    void SetUp() override {
        if (const char* was = std::getenv("XDG_CACHE_HOME")) before = was;
        setenv("XDG_CACHE_HOME", scratch.path.c_str(), 1);
    }
    void TearDown() override {
        if (before.empty()) unsetenv("XDG_CACHE_HOME");
        if (!before.empty()) setenv("XDG_CACHE_HOME", before.c_str(), 1);
    }
    TetMesh once(double of) {
        return made_once(MeshKey("test").add(of), [&] {
            ++made;
            TetMesh mesh;
            mesh.nodes = {{of, 1, 2}, {3, 4, 5}};
            mesh.tets = {{0, 1, 2, 3}};
            mesh.surface = {{0, 1, 2}, {1, 2, 3}};
            mesh.bone_nodes = {7};
            mesh.patches = {1, 1, 0};
            return mesh;
        });
    }
    std::vector<std::filesystem::path> files() const {
        std::vector<std::filesystem::path> out;
        for (const auto& entry : std::filesystem::directory_iterator(scratch.path / "palpate" / "meshes"))
            out.push_back(entry.path());
        return out;
    }
    testing::ScratchFolder scratch;
    std::string before;
    int made = 0;
};

TEST_F(MeshCache, WhatWasMadeOnceIsReadWithTheSameBits) {
    const TetMesh first = once(0.1), again = once(0.1);
    EXPECT_EQ(made, 1);
    EXPECT_TRUE(same(first, again));
    EXPECT_FALSE(same(first, once(0.1 + 1e-17 + 1e-16)));  // another number, another mesh
    EXPECT_EQ(made, 2);
    EXPECT_EQ(files().size(), 2u);
}

TEST_F(MeshCache, ADamagedFileIsMadeAnew) {
    const TetMesh first = once(1);
    const auto file = files().at(0);
    const auto size = std::filesystem::file_size(file);
    for (std::uintmax_t at = 0; at < size; ++at) {  // any byte
        std::fstream f(file, std::ios::binary | std::ios::in | std::ios::out);
        f.seekg(std::streamoff(at));
        const char turned = char(f.get() ^ 0x20);
        f.seekp(std::streamoff(at));
        f.put(turned);
        f.close();
        EXPECT_TRUE(same(first, once(1)));
        EXPECT_EQ(made, int(at) + 2);
    }
    const int before_cuts = made;
    for (const std::uintmax_t length : {std::uintmax_t(0), std::uintmax_t(7), size / 2, size - 1}) {
        std::filesystem::resize_file(file, length);
        EXPECT_TRUE(same(first, once(1))) << length;
    }
    EXPECT_EQ(made, before_cuts + 4);
}

TEST_F(MeshCache, WhereNothingCanBeKeptMeshesAreMadeAsBefore) {
    setenv("XDG_CACHE_HOME", "/dev/null", 1);
    once(1), once(1);
    EXPECT_EQ(made, 2);
    setenv("XDG_CACHE_HOME", scratch.path.c_str(), 1);
    EXPECT_THROW(made_once(MeshKey("test"), []() -> TetMesh { throw InputError("no"); }), InputError);
    EXPECT_EQ(made_once(MeshKey("test"), [] { return TetMesh{}; }).nodes.size(), 0u);  // a refusal is not kept
}

TEST_F(MeshCache, ManyAtOnceKeepWholeFilesAndOldOnesGo) {
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
        threads.emplace_back([this] {
            for (int i = 0; i < 120; ++i)
                for (const double of : {double(i), 1e3 + i, 2e3 + i, 3e3 + i}) {
                    TetMesh wanted;
                    wanted.nodes = {{of, 0, 0}};
                    EXPECT_TRUE(same(made_once(MeshKey("test").add(of), [&] { return wanted; }), wanted));
                }
        });
    for (std::thread& t : threads) t.join();
    EXPECT_LE(files().size(), 400u);
    EXPECT_GT(files().size(), 390u);
    for (const auto& file : files()) EXPECT_NE(file.extension(), ".draft");
}

/// A finger's mesh, through what loads scenes: read from the cache, it has the bits that the mesher gives.
TEST_F(MeshCache, AFingerIsTheSameMadeOrRead) {
    for (const auto kind : {FingerMeshRequest::Kind::conforming, FingerMeshRequest::Kind::uniform}) {
        FingerMeshRequest r;
        r.kind = kind;
        r.source = FingerMeshRequest::Source::surface;
        r.file = (scratch.path / "finger.stl").string();
        r.keep_frame = true;
        r.elements = 400;
        std::ofstream stl(r.file);
        const Surface s = finger_surface(finger_shape("index"));
        stl << "solid finger\n";
        for (const auto& t : s.triangles) {
            stl << "facet normal 0 0 0\nouter loop\n";
            for (const int i : t)
                stl << "vertex " << 1e3 * s.vertices[i][0] << " " << 1e3 * s.vertices[i][1] << " "
                    << 1e3 * s.vertices[i][2] << "\n";
            stl << "endloop\nendfacet\n";
        }
        stl << "endsolid\n";
        stl.close();
        FingerTemplates templates;
        std::string note;
        const std::size_t kept = kind == FingerMeshRequest::Kind::conforming ? 0 : 1;
        const TetMesh made_now = make_finger_mesh(r, templates, note);
        EXPECT_EQ(files().size(), kept + 1);
        EXPECT_TRUE(same(made_now, make_finger_mesh(r, templates, note)));
        EXPECT_EQ(files().size(), kept + 1);
    }
}

}  // namespace
}  // namespace palpate
