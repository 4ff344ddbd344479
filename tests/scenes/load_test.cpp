// Scene files: every kind of mistake gives a message with place and remedy; its twin without it loads.

#include <fstream>

#include "meshes/input_error.h"
#include "scenes/scene.h"
#include "tests/support.h"

namespace palpate {
namespace {

const std::string good = R"(
title = "test"
duration_s = 0.1
[[object]]
name = "table"
kind = "plane"
[[finger]]
name = "index"
elements = 100
shape = { finger = "index" }
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [0, 0, 9] }, { t_s = 0.1, position_mm = [0, 0, 7] } ]
)";

class SceneFiles : public ::testing::Test {
  protected:
    std::string refusal(const std::string& text, const std::vector<std::string>& overrides = {}) {
        const auto path = scratch_.path / "scene.toml";
        std::ofstream(path) << text;
        try {
            load_scene(path, overrides);
            return "";
        } catch (const InputError& error) { return error.what(); }
    }
    static std::string replaced(std::string text, const std::string& from, const std::string& to) {
        text.replace(text.find(from), from.size(), to);
        return text;
    }
    testing::ScratchFolder scratch_;
};

#define EXPECT_SAYS(message, part) EXPECT_NE((message).find(part), std::string::npos) << "found: " << (message)

TEST_F(SceneFiles, TheGoodTwinLoads) { EXPECT_EQ(refusal(good), ""); }

TEST_F(SceneFiles, SyntaxTypesAndUnknownKeys) {
    EXPECT_SAYS(refusal("title = \n"), ":1:");
    EXPECT_SAYS(refusal(replaced(good, "duration_s", "duratoin_s")), "did you mean 'duration_s'?");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = \"many\"")),
                "finger[0].elements: expected a whole number");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = \"many\"")), "scene.toml:9:");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = 3")), "from 20");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, 9]")), "three numbers");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, nan, 9]")), "three numbers");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, 0, 9e9]")), "of at most");
    EXPECT_SAYS(refusal(replaced(good, "duration_s = 0.1", "duration_s = inf")), "expected a number");
    EXPECT_SAYS(refusal(replaced(good, "duration_s = 0.1", "duration_s = -1")), "found -1");
    EXPECT_SAYS(refusal(replaced(good, "kind = \"plane\"", "kind = \"torus\"")),
                "plane, box, sphere, capsule, cylinder");
    EXPECT_SAYS(refusal(replaced(good, "kind = \"plane\"", "kind = \"sphere\"")), "a sphere needs it");
    EXPECT_SAYS(refusal(replaced(good, "[[finger]]", "[[fingre]]")), "at least one");
    EXPECT_SAYS(refusal(replaced(good, "chinello-3rrs", "stewart")), "chinello-3rrs");
    EXPECT_SAYS(refusal(replaced(good, "t_s = 0.1", "t_s = 0")), "follow each other");
    EXPECT_SAYS(refusal(good + "limits = { low = 1.2 }\n"), "low");
    EXPECT_SAYS(refusal(good + "follow = \"index\"\n"), "no [recording]");
    EXPECT_SAYS(refusal(replaced(good, "name = \"index\"", "name = \"a/b\"")), "no slashes");
    EXPECT_SAYS(refusal(replaced(good, "{ kind = \"chinello-3rrs\" }",
                                 "{ kind = \"chinello-3rrs\", joint_min_deg = 20, joint_max_deg = 10 }")),
                "below the upper");
}

TEST_F(SceneFiles, BodiesFrictionsAndFilters) {
    auto with = [&](const std::string& object, const std::string& rest = "") {
        return refusal(
            replaced(good, "[[finger]]", "[[object]]\nname = \"thing\"\n" + object + "\n" + rest + "[[finger]]"));
    };
    const std::string box = "kind = \"box\"\nsize_mm = [20, 20, 20]\n";
    EXPECT_EQ(with(box + "mass_g = 20\nrestitution = 0.5\nvelocity_m_per_s = [0, 1, 0]"), "");
    EXPECT_EQ(with(box + "density_kg_per_m3 = 500\nspin_rad_per_s = [0, 0, 3]",
                   "[[friction]]\nfirst = \"thing\"\nsecond = \"table\"\ncoefficient = 0.1\n"),
              "");
    EXPECT_SAYS(with(box + "mass_g = 0"), "object[1].mass_g: expected a number from 0.001");
    EXPECT_SAYS(with(box + "mass_g = 20\ndensity_kg_per_m3 = 500"), "not both");
    EXPECT_SAYS(with(box + "restitution = 0.5"), "only an object with mass_g");
    EXPECT_SAYS(with("kind = \"plane\"\nmass_g = 20"), "a plane has no end");
    EXPECT_SAYS(with(box + "mass_g = 20\ntrack = [ { t_s = 0, position_mm = [0, 0, 0] } ]"),
                "either a track or a mass");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"thing\"\nsecond = \"chair\"\n"), "found \"chair\"");
    EXPECT_EQ(with(box, "[[friction]]\nfirst = \"index\"\nsecond = \"thing\"\ncoefficient = 0.1\n"), "");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"index\"\nsecond = \"index\"\n"), "do not touch each other");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"thing\"\nsecond = \"thing\"\n"), "does not touch itself");
    EXPECT_SAYS(with(box + "release_s = 1"), "only an object with mass_g");
    EXPECT_SAYS(with("kind = \"mesh\""), "needs the name of a file");
    EXPECT_SAYS(with("kind = \"mesh\"\nfile = \"nothing.obj\"\nmass_g = 5"), "no such file");
    EXPECT_SAYS(with(box, "[[object]]\nname = \"thing\"\n"), "two objects are called 'thing'");
    EXPECT_EQ(refusal(good, {"filter.min_cutoff_Hz=3"}), "");
    EXPECT_SAYS(refusal(good, {"filter.min_cutoff_Hz=0"}), "filter.min_cutoff_Hz: expected a number from 0.001");
    EXPECT_SAYS(refusal(good, {"solver.sample_refinement=0"}), "sample_refinement");
    EXPECT_EQ(refusal(good, {"finger.index.device.mode=force", "finger.index.device.max_force_N=3"}), "");
    EXPECT_SAYS(refusal(good, {"finger.index.device.mode=force", "finger.index.device.driver=maestro",
                               "finger.index.device.channels=[0, 1, 2]"}),
                "cannot limit their force");
    EXPECT_EQ(refusal(good, {"finger.index.device.mode=force", "finger.index.device.driver=dynamixel",
                             "finger.index.device.port=/dev/ttyUSB0", "finger.index.device.channels=[1, 2, 3]"}),
              "");
    EXPECT_SAYS(refusal(good, {"finger.index.device.mode=force", "finger.index.device.kind=shear-2dof"}),
                "cannot push its platform");
}

TEST_F(SceneFiles, AllProblemsInOnePass) {
    const std::string message = refusal(replaced(
        replaced(replaced(good, "elements = 100", "elements = 1"), "kind = \"plane\"", "kind = 3"), "title", "titel"));
    EXPECT_SAYS(message, "elements");
    EXPECT_SAYS(message, "object[0].kind");
    EXPECT_SAYS(message, "titel");
    EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 2) << message;
}

TEST_F(SceneFiles, MissingFiles) {
    EXPECT_THROW(load_scene(scratch_.path / "absent.toml"), InputError);
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { surface = \"absent.obj\" }")),
                "no such file");
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { tets = \"absent.msh\" }")),
                "no such file");
    EXPECT_SAYS(refusal(good + "[recording]\nfile = \"absent.jsonl\"\n"), "no such file");
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { }")), "either surface");
}

TEST_F(SceneFiles, Overrides) {
    const auto path = scratch_.path / "scene.toml";
    std::ofstream(path) << good;
    const Scene scene = load_scene(path, {"finger.index.material.young_kPa=44", "solver.newton_iterations=3",
                                          "title=changed", "object.0.friction=0.2"});
    EXPECT_EQ(scene.spec.fingers[0].young_modulus, 44e3);
    EXPECT_EQ(scene.spec.solver.newton_iterations, 3);
    EXPECT_EQ(scene.title, "changed");
    EXPECT_EQ(scene.spec.objects[0].friction, 0.2);
    EXPECT_SAYS(refusal(good, {"nothing"}), "--set nothing");
    EXPECT_SAYS(refusal(good, {"finger.pinky.elements=50"}), "there is no 'pinky'");
    EXPECT_SAYS(refusal(good, {"solver.newton_iteration=3"}), "did you mean 'newton_iterations'?");
}

TEST_F(SceneFiles, FingersOfOneShapeFamilyShareAMesh) {
    const auto path = scratch_.path / "scene.toml";
    std::ofstream(path) << good << "\n[[finger]]\nname = \"thumb\"\nelements = 100\nshape = { finger = \"thumb\" }\n";
    const Scene scene = load_scene(path);
    EXPECT_EQ(scene.spec.fingers[0].mesh.tets, scene.spec.fingers[1].mesh.tets);
    EXPECT_NE(scene.spec.fingers[0].mesh.nodes, scene.spec.fingers[1].mesh.nodes);
}

TEST_F(SceneFiles, JsonLinesRecording) {
    auto line = [](double t, double z, bool valid) {
        std::string joints;
        for (int j = 0; j < 26; ++j)
            joints += std::string(j ? "," : "") + "[" + std::to_string(0.01 * j) + "," + std::to_string(z) +
                      ",0,0,0,0,1,0.008]";
        return "{\"t\":" + std::to_string(t) + ",\"hand\":\"right\",\"valid\":" + (valid ? "true" : "false") +
               ",\"joints\":[" + joints + "]}\n";
    };
    const std::string header = "{\"units\":\"m\",\"up\":\"y\"}\n";
    const auto path = scratch_.path / "hand.jsonl";
    std::ofstream(path) << header << line(10, 0.10, true) << line(10.05, 0.12, true) << line(10.1, 0.14, false)
                        << line(10.3, 0.14, true) << line(10.35, 0.14, true);
    const HandRecording r = read_hand_recording(path, "right");
    ASSERT_EQ(r.frames.size(), 5u);
    EXPECT_NEAR(sample_recording(r, 1, 0.025).pose.position.z, 0.11, 1e-12);  // y up became z up
    EXPECT_TRUE(sample_recording(r, 1, 0.025).valid);
    EXPECT_FALSE(sample_recording(r, 1, 0.09).valid);  // marked invalid
    EXPECT_FALSE(sample_recording(r, 1, 0.2).valid);   // gap
    EXPECT_FALSE(sample_recording(r, 1, 5).valid);     // past the end
    // Fingers point along -z of the joint: distal is +y of the upright world.
    const Mat3<double> R = rotation_matrix(sample_recording(r, 1, 0.0).pose.rotation);
    EXPECT_NEAR(R[1][0], 1, 1e-9);
    EXPECT_NEAR(R[2][2], 1, 1e-9);
    for (const std::string& bad :
         {header + line(1, 0, true), header + "{\"t\":1,\"joints\":[1]}\n",
          header + line(2, 0, true) + line(1, 0, true), header + line(1, 0, true) + "{\"t\": 2, \"joi"}) {
        std::ofstream(path) << bad;
        EXPECT_THROW(read_hand_recording(path, "right"), InputError);
    }
    EXPECT_THROW(read_hand_recording(path, "left"), InputError);
}

}  // namespace
}  // namespace palpate
