// What strain limits hold: the same parts of a finger, whatever its mesh.

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include <Eigen/LU>

#include "scenes/load/scene.h"
#include "scenes/load/section.h"
#include "tests/scenes/named_finger.h"
#include "tests/support.h"

namespace palpate {
namespace {

using LimitsOf = FingerMeshRequest::LimitsOf;

TetMesh preset_mesh(int elements, bool limited, LimitsOf limits = LimitsOf::patches) {
    FingerModel m = testing::named("index-median");
    m.mesh.elements = elements;
    m.mesh.limits_of = limits;
    m.spec.has_limits = limited;
    return testing::built(m).mesh;
}

/// Centres of a mesh's limit patches, by number; with what of each element is in each.
std::map<int, Point> patch_centres(const TetMesh& mesh) {
    std::map<int, Point> sum;
    std::map<int, double> volume;
    std::vector<LimitShare> parts = mesh.limit_shares;
    for (std::size_t e = 0; e < mesh.tets.size(); ++e)
        if (mesh.limit_patches[e] >= 0 &&
            std::none_of(parts.begin(), parts.end(), [&](const LimitShare& s) { return s.tet == int(e); }))
            parts.push_back({int(e), mesh.limit_patches[e], 1});
    for (const auto& [tet, patch, share] : parts) {
        const auto e = std::size_t(tet);
        Eigen::Matrix3d edges;
        for (int k = 0; k < 3; ++k)
            for (int d = 0; d < 3; ++d)
                edges(d, k) = mesh.nodes[std::size_t(mesh.tets[e][std::size_t(k + 1)])][std::size_t(d)] -
                              mesh.nodes[std::size_t(mesh.tets[e][0])][std::size_t(d)];
        const double v = share * edges.determinant() / 6;
        volume[patch] += v;
        for (int i : mesh.tets[e])
            for (std::size_t d = 0; d < 3; ++d) sum[patch][d] += v * mesh.nodes[std::size_t(i)][d] / 4;
    }
    for (auto& [patch, centre] : sum)
        for (double& x : centre) x /= volume[patch];
    return sum;
}

/// Whatever the mesh, the same parts of the finger are limited, and as many.
TEST(LimitPatches, AreTheSamePartsOfTheFingerInEveryMesh) {
    std::map<int, Point> base;
    for (const int elements : {347, 1000, 2800}) {
        const TetMesh mesh = preset_mesh(elements, true);
        const auto centres = patch_centres(mesh);
        if (base.empty()) base = centres;
        EXPECT_NEAR(double(centres.size()), 22, 4) << elements;
        double off = 0, most = 0;
        for (const auto& [patch, c] : centres) {
            ASSERT_TRUE(base.count(patch));
            const Point& b = base[patch];
            const double d = std::hypot(c[0] - b[0], c[1] - b[1], c[2] - b[2]);
            off += d / double(centres.size()), most = std::max(most, d);
        }
        EXPECT_LT(off, 1.0e-3) << "patches are 5 mm wide";
        EXPECT_LT(most, 3e-3);
        for (std::size_t a = 0; a < mesh.tets.size(); ++a)  // none without what does not deform
            EXPECT_EQ(mesh.limit_patches[a] < 0, mesh.patches[a] < 0);
        for (std::size_t a = 1; a < mesh.tets.size(); ++a) {  // of whole patches of volume
            if (mesh.patches[a] != mesh.patches[a - 1]) continue;
            EXPECT_EQ(mesh.limit_patches[a], mesh.limit_patches[a - 1]);
        }
    }
    EXPECT_TRUE(preset_mesh(347, false).limit_patches.empty()) << "nothing is limited";
}

/// Bounds that cut elements are those of the coarse mesh: patches are nearer to where they are there.
TEST(LimitPatches, ThatCutElementsAreWhereTheyAre) {
    const auto base = patch_centres(preset_mesh(347, true, LimitsOf::regions));
    const auto off = [&](const TetMesh& mesh) {
        double sum = 0;
        const auto centres = patch_centres(mesh);
        EXPECT_EQ(centres.size(), base.size());
        for (const auto& [patch, c] : centres) {
            const Point& b = base.at(patch);
            sum += std::hypot(c[0] - b[0], c[1] - b[1], c[2] - b[2]) / double(centres.size());
        }
        return sum;
    };
    for (const int elements : {1000, 2800}) {
        const TetMesh mesh = preset_mesh(elements, true, LimitsOf::regions);
        // What is left is the skin beyond the coarse mesh's chords.
        EXPECT_LT(off(mesh), 0.7e-3) << elements;
        EXPECT_LT(off(mesh), 0.9 * off(preset_mesh(elements, true))) << elements;
        ASSERT_FALSE(mesh.limit_shares.empty());
        for (auto s = mesh.limit_shares.begin(); s != mesh.limit_shares.end();) {
            double sum = 0, most = 0;
            int main = -1;
            const int tet = s->tet;
            for (; s != mesh.limit_shares.end() && s->tet == tet; ++s) {
                EXPECT_GE(s->share, 0.1);
                sum += s->share;
                if (s->share > most) most = s->share, main = s->patch;
            }
            EXPECT_NEAR(sum, 1, 1e-12);
            EXPECT_EQ(mesh.limit_patches[std::size_t(tet)], main);
            EXPECT_TRUE(s == mesh.limit_shares.end() || s->tet > tet);
        }
    }
}

/// A finger file keeps them, and coarse meshes go further before their limits act.
TEST(LimitPatches, RegionsAndTheirSofteningAreWrittenAndRead) {
    FingerModel m = testing::named("index-median");
    m.mesh.limits_of = LimitsOf::regions, m.mesh.limit_softening = 0.5;
    testing::ScratchFolder scratch;
    write_finger_file(scratch.path / "regions.toml", m, {});
    const FingerModel read = testing::named((scratch.path / "regions.toml").string());
    EXPECT_EQ(read.mesh.limits_of, LimitsOf::regions);
    EXPECT_EQ(read.mesh.limit_softening, 0.5);
    const FingerSpec soft = testing::built(m);
    m.mesh.limit_softening = 0;
    const FingerSpec hard = testing::built(m);
    ASSERT_EQ(soft.element_low.size(), hard.element_low.size());
    const double power = softened_by(0.5, hard.mesh.tets.size());
    EXPECT_NEAR(power, 1.5, 0.02);
    EXPECT_EQ(hard.element_low_power, 3);
    for (std::size_t e = 0; e < hard.element_low.size(); ++e) {
        EXPECT_NEAR(soft.element_low[e], std::pow(hard.element_low[e], power), 1e-12);
        EXPECT_EQ(soft.element_high[e], hard.element_high[e]);
    }
    m.mesh.limits_of = LimitsOf::patches;
    EXPECT_EQ(testing::built(m).element_low_power, 2);
}

TEST(Patches, TissueThatTakesNoneIsSaidToLock) {
    const auto said = [](const std::string& mesh, const std::string& material, const std::string& finger = "") {
        return load_scene_text("duration_s = 0.1\n" + mesh +
                                   "\n[[finger]]\nname = \"f\"\nshape = { finger = \"index\" }\nmaterial = " +
                                   material + "\n" + finger,
                               "scene.toml")
            .warnings;
    };
    const std::string locks = "{ kind = \"neo-hookean\", poisson = 0.499 }",
                      fine = "{ kind = \"neo-hookean\", poisson = 0.3 }";
    for (const char* mesh : {"[mesh]\npatch = 5", ""}) {
        ASSERT_EQ(said(mesh, locks).size(), 1u) << mesh;
        for (const char* words : {"\"f\"", "neo-hookean tissue", "no patches", "poisson = 0.499", "lock"})
            EXPECT_NE(said(mesh, locks)[0].find(words), std::string::npos) << said(mesh, locks)[0];
        EXPECT_TRUE(said(mesh, locks, "mesh = { patch = 0 }").empty());
        EXPECT_TRUE(said(mesh, "{ poisson = 0.499 }").empty());
    }
    ASSERT_EQ(said("[mesh]\npatch = 5", fine).size(), 1u);
    EXPECT_NE(said("[mesh]\npatch = 5", fine)[0].find("[mesh] patch = 5 is not taken"), std::string::npos);
    EXPECT_EQ(said("[mesh]\npatch = 5", fine)[0].find("lock"), std::string::npos);
    EXPECT_TRUE(said("", fine).empty());
    EXPECT_TRUE(said("[mesh]\npatch = 0", locks).empty());
}

}  // namespace
}  // namespace palpate
