// What fingers and boxes may not do in a step that says it has converged: pass through each other.

#include <cmath>

#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// On which side along x of a box each node of the first finger is: 1 or -1 on a face or before it, 0 elsewhere.
std::vector<int> sides_of_box(const Simulation& s) {
    const VirtualObject& box = s.world.shapes[0];
    const Vec3<double>& half = box.shape.size;
    std::vector<int> sides;
    for (const Point& p : finger_positions(s.world, s.fingers[0])) {
        const Vec3<double> x = inverse_transform(box.pose, {p[0], p[1], p[2]});
        const bool before = std::abs(x.y) < half.y && std::abs(x.z) < half.z && std::abs(x.x) > half.x - 5e-5;
        sides.push_back(!before ? 0 : x.x < 0 ? -1 : 1);
    }
    return sides;
}

TEST(Passing, SkinThatABlowHasWoundUpDoesNotLeapThroughAThickBox) {
    Simulation s = make_simulation(
        load_scene_text(
            "dt_ms = 1\nduration_s = 0.015\n[mesh]\nkind = \"uniform\"\npatch = 0\n"
            "[[object]]\nname = \"pusher\"\nkind = \"box\"\nsize_mm = [5.63, 30, 14]\nfriction = 0.607\n"
            "track = [ { t_s = 0, position_mm = [-20, 0, 8] }, { t_s = 0.014, position_mm = [-2.723, 1.447, 8] } ]\n"
            "[[finger]]\nname = \"middle\"\nshape = { finger = \"middle\" }\nelements = 180\n"
            "material = { young_kPa = 43.66, poisson = 0.264 }\n"
            "track = [ { t_s = 0, position_mm = [-3.09, 0.989, 30.827], rotation_deg = [17.11, -26.15, 0] }, "
            "{ t_s = 0.006, position_mm = [-3.09, 0.42, 16.833], rotation_deg = [17.11, -26.15, 0] } ]\n",
            "passing.toml"),
        1);
    int passed = 0;
    std::vector<int> before = sides_of_box(s);
    while (s.world.time < s.scene.duration - 1e-9) {
        advance(s);
        const std::vector<int> now = sides_of_box(s);
        for (std::size_t i = 0; i < now.size(); ++i) passed += now[i] * before[i] < 0;
        before = now;
    }
    EXPECT_EQ(passed, 0);
}

/// Steps of 20 ms: skin that is pressed onto a dome snaps off it within one, through it, and rests beside it with a
/// tenth of the force that it has in short steps, which keep it on top. That step says so, and all in which it rests
/// there.
TEST(Passing, SkinThatLeapsOffADomeSaysSo) {
    const auto dome = [](const char* dt_ms) {
        return make_simulation(
            load_scene_text(
                "dt_ms = " + std::string(dt_ms) +
                    "\nduration_s = 0.28\n[solver]\npreset = \"reference\"\ncontact_iterations = 4\n"
                    "[limits]\nlow = 0.763\nhigh = 1.6\n"
                    "[[object]]\nname = \"dome\"\nkind = \"capsule\"\nradius_mm = 4.855\nlength_mm = "
                    "12.808\nposition_mm = [-0.603, 0, 0]\n"
                    "[[finger]]\nname = \"middle\"\nshape = { finger = \"middle\" }\nelements = 250\n"
                    "track = [ { t_s = 0, position_mm = [0.712, 0, 24.727], rotation_deg = [-10.37, -17.73, 0] }, "
                    "{ t_s = 0.15, position_mm = [0.712, 0, 15.865], rotation_deg = [-10.37, -17.73, 0] }, "
                    "{ t_s = 0.2, position_mm = [3.913, 4.356, 15.865], rotation_deg = [-10.37, -17.73, 0] } ]\n",
                "dome.toml"),
            1);
    };
    const auto leaps = [](Simulation& s) {
        int said = 0;
        while (s.world.time < s.scene.duration - 1e-9) {
            advance(s);
            const SkinStatus& status = skin_status(s.world, s.fingers[0]);
            said += status.wrong_sides > 0;
            EXPECT_FALSE(status.wrong_sides > 0 && status.converged);
        }
        return said;
    };
    Simulation longer = dome("20"), shorter = dome("5");
    EXPECT_EQ(leaps(shorter), 0);
    const int said = leaps(longer);
    const double kept = shorter.world.contact_surfaces[0].normal_force,
                 rests = longer.world.contact_surfaces[0].normal_force;
    EXPECT_GT(kept, 1);
    const bool says_so = said > 0 && !skin_status(longer.world, longer.fingers[0]).converged;
    EXPECT_TRUE(says_so || std::abs(rests - kept) < 0.05 * kept) << rests << " instead of " << kept << " N, unsaid";
}

/// The end of a box comes in where the skin rides on its bone, and touches nothing, and stays under the pad's rim.
TEST(Passing, ABoxThatHasComeInBesideThePadIsSaid) {
    Simulation s = make_simulation(
        load_scene_text(
            "dt_ms = 20\nduration_s = 0.26\ngravity_m_per_s2 = [0.37, -5.11, -2.66]\n"
            "[limits]\nlow = 0.722\nhigh = 1.368\n"
            "[[object]]\nname = \"pusher\"\nkind = \"box\"\nsize_mm = [5.53, 30, 14]\nfriction = 0.939\n"
            "track = [ { t_s = 0, position_mm = [-20, 0, 8] }, { t_s = 0.17, position_mm = [-1.889, -2.44, 8] } ]\n"
            "[[finger]]\nname = \"index\"\nshape = { finger = \"index\" }\nelements = 180\n"
            "layer = [ { thickness_mm = 1.6, young_kPa = 329.4, low = 0.5, high = 1.5 } ]\n"
            "track = [ { t_s = 0, position_mm = [0.188, 21.588, 14.674], rotation_deg = [-81.32, -24.46, 0] }, "
            "{ t_s = 0.11, position_mm = [0.188, 12.871, 11.837], rotation_deg = [-81.32, -24.46, 0] }, "
            "{ t_s = 0.29, position_mm = [0.188, 21.588, 14.674], rotation_deg = [-81.32, -24.46, 0] } ]\n",
            "beside.toml"),
        1);
    while (s.world.time < s.scene.duration - 1e-9) {
        advance(s);
        if (s.world.time < 0.09) continue;
        const SkinStatus& status = skin_status(s.world, s.fingers[0]);
        EXPECT_GT(status.wrong_sides, 0) << s.world.time;
        EXPECT_FALSE(status.converged) << s.world.time;
    }
}

}  // namespace
}  // namespace palpate
