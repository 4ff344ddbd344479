// The built-in finger: what a scene gets that says nothing of its mesh, and that it hardly depends on it.

#include <gtest/gtest.h>

#include <cmath>

#include "meshes/finger_shape.h"
#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

using Kind = FingerMeshRequest::Kind;

FingerMeshRequest mesh_of(const std::string& before, const std::string& finger) {
    const std::string scene =
        before + "\n[[finger]]\nname = \"f\"\n" + finger + "\ntrack = [ { t_s = 0, position_mm = [0, 0, 50] } ]\n";
    return load_scene_text(scene, "default.toml").finger_models.at(0).mesh;
}

TEST(DefaultFinger, HasWhatSuitsItsMeshUnlessSomethingIsSaid) {
    for (const std::string shape : {"", "shape = { finger = \"thumb\" }"})
        for (const std::string mesh : {"", "[mesh]\nkind = \"conforming\""}) {
            const FingerMeshRequest r = mesh_of(mesh, shape);
            EXPECT_EQ(r.kind, Kind::conforming);
            EXPECT_EQ(r.elements, usual_elements);
            EXPECT_EQ(r.shape.crease, usual_crease);
            EXPECT_EQ(r.softening, usual_softening);
        }
    // As it was before conforming meshes.
    const FingerMeshRequest uniform = mesh_of("[mesh]\nkind = \"uniform\"\npatch = 0", "");
    EXPECT_EQ(uniform.elements, 347);
    EXPECT_EQ(uniform.shape.crease, 0);
    EXPECT_EQ(uniform.softening, 0);
    const FingerMeshRequest said = mesh_of("[mesh]\nsoftening = 0.1", "elements = 347\nshape = { crease = 0 }");
    EXPECT_EQ(said.elements, 347);
    EXPECT_EQ(said.shape.crease, 0);
    EXPECT_EQ(said.softening, 0.1);
    EXPECT_EQ(mesh_of("", "elements = 347").softening, usual_softening);
    EXPECT_EQ(mesh_of("", "elements = 700").softening, 0.085);
    EXPECT_EQ(mesh_of("", "elements = 20000").softening, 0.12);
    // A finger's file says what it is.
    const FingerMeshRequest preset = mesh_of("", "finger = \"index-median\"");
    EXPECT_EQ(preset.elements, 347);
    EXPECT_EQ(preset.softening, 0.26);
    EXPECT_EQ(preset.shape.crease, 0.22);
    EXPECT_EQ(mesh_of("", "finger = \"index-median\"\nshape = { finger = \"thumb\" }").shape.crease, 0);
}

/// What meshes press too hard is taken off by size: those of 700 to 2,000 elements were 2 to 5 % too stiff.
TEST(DefaultFinger, PressesWithTheForceOfFinerOnes) {
    const auto force = [](const std::string& elements) {
        const std::string scene =
            "duration_s = 0.4\ndt_ms = 50\n[solver]\npreset = \"reference\"\n[[object]]\n"
            "name = \"table\"\nkind = \"plane\"\n[[finger]]\nname = \"f\"\nelements = " +
            elements +
            "\ntrack = [ { t_s = 0, position_mm = [0, 0, 9], rotation_deg = [0, 15, 0] }, "
            "{ t_s = 0.4, position_mm = [0, 0, 6.2], rotation_deg = [0, 15, 0] } ]\n";
        Simulation s = make_simulation(load_scene_text(scene, "press.toml"), 1);
        while (s.world.time < s.scene.duration - 1e-9) advance(s);
        return s.world.contact_surfaces[0].normal_force;
    };
    const double finest = force("6000");
    for (const char* elements : {"700", "1400", "2000"}) {
        const double f = force(elements);
        std::printf("%s elements: %.3f N, 6000: %.3f N\n", elements, f, finest);
        EXPECT_NEAR(f, finest, 0.015 * finest) << elements;
    }
    EXPECT_NEAR(force("400"), finest, 0.05 * finest);
}

/// Rolled to 50 degrees it touched with the cut end, where meshes are coarse: area was off by up to 20 %.
TEST(DefaultFinger, RollsAsOneOfAFinerMeshDoes) {
    double force[2], area[2];
    for (int k : {0, 1}) {
        std::vector<std::string> settings{"solver.preset=reference", "dt_ms=20"};
        if (k == 1) settings.emplace_back("finger.index.elements=1400");
        Simulation s = make_simulation(load_scene(testing::scenes + "roll.toml", settings), 1);
        while (s.world.time < s.scene.duration - 1e-9) advance(s);
        force[k] = s.world.contact_surfaces[0].normal_force;
        area[k] = s.world.contact_surfaces[0].touching_area;
    }
    std::printf("rolled by 50 degrees: %.3f and %.3f N on %.1f and %.1f mm2\n", force[0], force[1], 1e6 * area[0],
                1e6 * area[1]);
    EXPECT_NEAR(force[0], force[1], 0.05 * force[1]);
    EXPECT_NEAR(area[0], area[1], 0.08 * area[1]);
}

}  // namespace
}  // namespace palpate
