// Rigid bodies on objects of tissue: they slide as laws say, and what comes in between samples is said.

#include <cmath>

#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "scenes/run/summary.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// A slab of 20 kPa, its top at z = 0, that gravity is tilted by 20 degrees on, and a body that rests on it.
std::string on_tissue(const std::string& body, double height_mm, double friction, int elements, double dt_ms = 5) {
    char text[900];
    std::snprintf(text, sizeof text,
                  "duration_s = 0.18\ndt_ms = %g\ngravity_m_per_s2 = [3.35522, 0, -9.21838]\n"
                  "[[object]]\nname = \"slab\"\nkind = \"box\"\nsize_mm = [160, 60, 20]\nposition_mm = [0, 0, -10]\n"
                  "friction = %g\nsoft = { young_kPa = 20, elements = %d, fixed = \"bottom\" }\n"
                  "[[object]]\nname = \"thing\"\nposition_mm = [-40, 0, %g]\nfriction = %g\n%s\n"
                  "[[finger]]\nname = \"far\"\n"
                  "track = [ { t_s = 0, position_mm = [0, 0, 900] } ]\n",
                  dt_ms, friction, elements, height_mm, friction, body.c_str());
    return text;
}

Simulation slid(const std::string& text) {
    Simulation s = make_simulation(load_scene_text(text, "on_tissue.toml"), 1);
    while (s.world.time < 0.18 - 1e-9) advance(s);
    return s;
}

/// A slab looks the same everywhere: nothing holds a body on it but friction. (Nodes before a box, higher than its
/// bottom in the dent, met the face at its front: of 54 mm a box went 9, a puck 2.7; a capsule hung between nodes.)
TEST(Soft, BodiesSlideOnTissueAsCoulombSays) {
    struct Case {
        const char* body;
        double height_mm, friction;
        int elements;
        double within;
    };
    const char* box = "kind = \"box\"\nsize_mm = [20, 20, 10]\nmass_g = 50";
    const char* puck = "kind = \"cylinder\"\nradius_mm = 15\nlength_mm = 10\nmass_g = 50";
    const char* ball = "kind = \"sphere\"\nradius_mm = 10\nmass_g = 30";
    const char* rod = "kind = \"capsule\"\nradius_mm = 8\nlength_mm = 20\nmass_g = 30\nrotation_deg = [90, 0, 0]";
    int number = 0;
    for (const Case& c : {Case{box, 5, 0.2, 1000, 0.1}, Case{box, 5, 0, 3000, 0.05}, Case{ball, 10, 0, 1000, 0.05},
                          Case{puck, 5, 0, 3000, 0.05}, Case{rod, 8, 0, 1000, 0.05}, Case{box, 5, 0, 1000, 0.05}}) {
        if (!testing::is_tried(number++, 2)) continue;
        const Simulation s = slid(on_tissue(c.body, c.height_mm, c.friction, c.elements));
        const Vec3<double> at = s.world.shapes[1].pose.position;
        const double right = 0.5 * 0.18 * 0.18 * (3.35522 - c.friction * 9.21838), along = at.x + 0.04;
        std::printf("%.25s, friction %g, %d elements: %.1f mm along, %.1f aside, where %.1f is right\n", c.body,
                    c.friction, c.elements, 1e3 * along, 1e3 * at.y, 1e3 * right);
        EXPECT_NEAR(along, right, c.within * right) << c.body << c.elements;
        EXPECT_LT(std::abs(at.y), 0.05 * right) << c.body << c.elements;
        const Summary summary = summarise(s);
        EXPECT_GT(summary.soft_objects.at(0).converged_share, 0.85) << c.body;
        EXPECT_TRUE(summary.soft_objects[0].entered.empty()) << c.body;
    }
}

/// A ball far smaller than elements falls in between samples: nothing presses on it, and its steps do not say that
/// they have converged. So does one that a track leads into the slab, and a box all of whose samples are beside it.
TEST(Soft, WhatComesInBetweenSamplesIsSaid) {
    const char *ball = "kind = \"sphere\"\nradius_mm = 2\nmass_g = 1",
               *led =
                   "kind = \"sphere\"\nradius_mm = 2\ntrack = [ { t_s = 0, position_mm = [-40, 0, 3] }, "
                   "{ t_s = 0.1, position_mm = [-40, 0, -9] } ]";
    for (const char* body : {ball, led}) {
        std::string text = on_tissue(body, 2, 0.5, 1000);
        if (body == led) text.erase(text.find("position_mm = [-40, 0, 2]"), 25);
        const Simulation s = slid(text);
        EXPECT_GT(s.world.soft.all[0].entered_steps, 5) << body;
        EXPECT_EQ(s.world.soft.all[0].entered_by, 1) << body;
        const Summary summary = summarise(s);
        EXPECT_LT(summary.soft_objects.at(0).converged_share, 0.9) << body;
        EXPECT_NE(to_text(summary).find("first \"thing\""), std::string::npos) << to_text(summary);
        if (body == ball) { EXPECT_LT(summary.bodies.at(0).converged_share, 0.9); }
    }
}

/// What is too narrow for samples of tissue is said as it is loaded, with what mends it.
TEST(Soft, WhatIsTooNarrowForTissueIsSaid) {
    const auto warnings = [](const std::string& text) {
        std::string all;
        for (const std::string& w : load_scene_text(text, "narrow.toml").warnings) all += w + "\n";
        return all;
    };
    const std::string narrow = "kind = \"sphere\"\nradius_mm = 5\nmass_g = 5";
    const std::string said = warnings(on_tissue(narrow, 5, 0, 1000));
    for (const char* word : {"object \"thing\" is 10 mm wide", "soft object \"slab\" are", "mm apart",
                             "more soft.elements", "solver.sample_refinement"})
        EXPECT_NE(said.find(word), std::string::npos) << word << " in\n" << said;
    EXPECT_EQ(warnings(on_tissue(narrow, 5, 0, 8000)), "");
    EXPECT_EQ(warnings(on_tissue("kind = \"sphere\"\nradius_mm = 10\nmass_g = 30", 10, 0, 1000)), "");
    EXPECT_EQ(warnings(on_tissue("kind = \"sphere\"\nradius_mm = 5", 5, 0, 1000)), "");  // it never moves
    EXPECT_NE(warnings(on_tissue("kind = \"box\"\nsize_mm = [60, 8, 8]\nmass_g = 9", 4, 0, 1000)), "");
}

}  // namespace
}  // namespace palpate
