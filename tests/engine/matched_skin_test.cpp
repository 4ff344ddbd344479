// Devices match the skin that touches, which is outside its nodes where it is curved between them.

#include <cstring>

#include "scenes/load/finger_model.h"
#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "scenes/run/state.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// A finger that comes down on an object at z = 0 to 5 N and more, rolled about its axis [degrees]. Its platform is
/// wide enough for a thumb's contact.
Simulation pressed(const std::string& finger, const std::string& object, double roll) {
    const std::string rotation = ", rotation_deg = [" + std::to_string(roll) + ", 0, 0] }";
    return make_simulation(
        load_scene_text("duration_s = 1\ndt_ms = 5\n[[object]]\n" + object + "\n[[finger]]\nname = \"f\"\n" + finger +
                            "\ndevice = { kind = \"serial-6dof\", platform_radius_mm = 15, non_contact = false }\n"
                            "track = [ { t_s = 0, position_mm = [0, 0, 12]" +
                            rotation + ", { t_s = 1, position_mm = [0, 0, 2]" + rotation + " ]\n",
                        "pressed.toml"),
        1);
}
const std::string ball = "kind = \"sphere\"\nradius_mm = 10\nposition_mm = [0, 0, -10]";
std::string preset(const std::string& name) { return "finger = \"" + name + "\""; }

Vec3<double> touching_skin(const ContactSurface& c, std::size_t s) {
    return transform(c.bone, c.bulge.empty() ? c.position[s] : c.position[s] + c.bulge[s]);
}

/// Calls visit(force) where the device has just matched a contact that bears half a newton to five.
template <class Visit>
int at_matches(Simulation& s, Visit visit) {
    int count = 0;
    while (s.world.time < s.scene.duration && s.world.contact_surfaces[0].normal_force < 5) {
        advance(s);
        const double force = s.world.contact_surfaces[0].normal_force;
        if (!s.world.matchings[0].fresh || !(force > 0.5) || force > 5) continue;
        visit(force);
        ++count;
    }
    return count;
}

/// How far the platform is turned from a plane at z = 0 [degrees].
double turned_from_level(const World& w) {
    const Matching& m = w.matchings[0];
    const Eigen::Vector3d n = m.model.mount.linear() * m.model.kind->platform(m.model, m.result.w).normal;
    const Vec3<double> normal =
        rotation_matrix(w.contact_surfaces[0].bone.rotation) * Vec3<double>{n.x(), n.y(), n.z()};
    return 180 / M_PI * std::atan2(std::hypot(normal.x, normal.y), std::abs(normal.z));
}

TEST(MatchedSkin, ThePlatformIsParallelToWhatAPresetLiesFlatOn) {
    int number = 0;
    for (const double roll : {0, 15, 30}) {
        double worst = 0;
        ++number;
        for (const std::string& name : finger_preset_names()) {
            if (!testing::is_tried(number++, 6)) continue;
            Simulation s = pressed(preset(name), "kind = \"plane\"", roll);
            double turned = 0;
            const int matches = at_matches(s, [&](double) { turned = std::max(turned, turned_from_level(s.world)); });
            EXPECT_GT(matches, 5) << name << " " << roll;
            EXPECT_LT(turned, 0.005) << name << " " << roll;
            worst = std::max(worst, turned);
        }
        std::printf("rolled by %.0f: %.5f degrees at worst\n", roll, worst);
    }
}

/// Nodes have more of the shape of a flat plate than the skin that touches a ball: what they leave is less, and wrong.
TEST(MatchedSkin, ThePlatformIsNearerToItThanOneThatMatchesNodes) {
    Simulation s = pressed(preset("index-median"), ball, 10);
    double of_skin = 0, of_nodes = 0;
    at_matches(s, [&](double) {
        const Matching& m = s.world.matchings[0];
        const ContactSurface& c = s.world.contact_surfaces[0];
        std::vector<MatchingPoint> nodes = m.points;
        for (std::size_t k = 0; k < nodes.size(); ++k)
            nodes[k].position =
                m.model.mount.inverse() * Eigen::Vector3d(c.position[k].x, c.position[k].y, c.position[k].z);
        const Coordinates w = match_constrained(m.model, nodes, m.settings, m.result.w).w;
        of_skin += matching_objective(m.model, m.points, m.settings, m.result.w, m.result.w).value;
        of_nodes += matching_objective(m.model, m.points, m.settings, w, w).value;
    });
    std::printf("from the skin: %.3f mm^2 of a match of skin, %.3f of one of nodes\n", of_skin, of_nodes);
    EXPECT_LT(of_skin, of_nodes);
}

/// Asleep, too, for what is matched next is what was touched last.
TEST(MatchedSkin, IsPartOfASavedState) {
    Simulation s = pressed(preset("index-median"), ball, 10), other = pressed(preset("index-median"), ball, 10);
    at_matches(s, [](double) {});
    std::vector<std::uint8_t> state;
    append_state(state, s);
    std::string why;
    ASSERT_TRUE(restore_state(other, state.data(), state.size(), why)) << why;
    const auto& a = s.world.contact_surfaces[0].bulge;
    const auto& b = other.world.contact_surfaces[0].bulge;
    ASSERT_EQ(a.size(), b.size());
    ASSERT_FALSE(a.empty());
    EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof a[0]), 0);
}

TEST(MatchedSkin, LiesOnWhatItTouches) {
    const std::string cylinder =
        "kind = \"cylinder\"\nradius_mm = 8\nlength_mm = 40\nposition_mm = [0, 0, -8]\nrotation_deg = [90, 0, 0]";
    for (const std::string& object : {std::string("kind = \"plane\""), ball, cylinder}) {
        Simulation s = pressed(preset("index-median"), object, 10);
        double skin = 0, nodes = 0;
        at_matches(s, [&](double) {
            const ContactSurface& c = s.world.contact_surfaces[0];
            const VirtualObject& o = s.world.shapes[0];
            const auto distance = [&](const Vec3<double>& x) { return surface_point(o.shape, o.pose, x).distance; };
            for (std::size_t k = 0; k < c.touches.size(); ++k) {
                if (!c.touches[k]) continue;
                skin = std::max(skin, std::abs(distance(touching_skin(c, k))));
                nodes = std::max(nodes, std::abs(distance(transform(c.bone, c.position[k]))));
            }
        });
        std::printf("%.15s: skin off by %.5f mm, nodes by %.5f\n", object.c_str(), 1e3 * skin, 1e3 * nodes);
        EXPECT_LT(skin, 5e-6) << object;
        EXPECT_GT(nodes, 2e-5) << object;
    }
}

TEST(MatchedSkin, IsAtTheNodesWhereSkinIsFlatBetweenThem) {
    Simulation s = pressed("shape = { finger = \"index\" }", "kind = \"plane\"", 0);
    advance(s);
    EXPECT_TRUE(s.world.contact_surfaces[0].bulge.empty());
}

}  // namespace
}  // namespace palpate
