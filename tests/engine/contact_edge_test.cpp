// Where contact ends between nodes: the rule along an edge, and what areas and outlines make of it.

#include "engine/contact/contact_edge.h"

#include "engine/contact/fitted.h"
#include "engine/step.h"
#include "scenes/load/scene.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

TEST(ContactEdge, LiesWherePressureAndGapMeet) {
    constexpr double length = 3e-3, modulus = 40e3;
    // A pressure A sqrt(s) and a gap 4 A / (3 E*) t^(3/2), but for what nodes make of a gap.
    for (const double reach : {0.001, 0.1, 0.5, 0.9, 0.999}) {
        const double slope = 2e5, s = reach * length, t = length - s;
        const double gap = 4 * slope / (3 * modulus) * std::pow(t, 1.5) / fitted::nodal_gap;
        EXPECT_NEAR(reach_along_edge(slope * std::sqrt(s), gap, length, modulus), reach, 1e-9);
    }
    EXPECT_EQ(reach_along_edge(0, 1e-4, length, modulus), 0);
    EXPECT_EQ(reach_along_edge(1000, 0, length, modulus), 1);
    EXPECT_EQ(reach_along_edge(1000, HUGE_VAL, length, modulus), 0);
    double last = 0;
    for (double pressure = 1; pressure < 1e7; pressure *= 2) {
        const double reach = reach_along_edge(pressure, 1e-4, length, modulus);
        EXPECT_GT(reach, last);
        EXPECT_LT(reach, 1);
        last = reach;
    }
}

/// Two faces over a square of 2 x 2 mm; the corner at the origin touches, all others have the same gap.
ContactSurface one_corner() {
    ContactSurface c;
    c.position = {{0, 0, 0}, {2e-3, 0, 0}, {2e-3, 2e-3, 0}, {0, 2e-3, 0}};
    c.faces = {{0, 1, 2}, {0, 2, 3}};
    c.area.resize(4, 1e-6);
    c.touches = {1, 0, 0, 0};
    c.pressing = {{0, 0, 0.01}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    c.gap = {0, 1e-4, 1e-4, 1e-4};
    c.modulus = 40e3;
    return c;
}

TEST(ContactEdge, OutlineEnclosesTheArea) {
    ContactSurface c = one_corner();
    const double side = 2e-3 * reach_along_edge(1e4, 1e-4, 2e-3, c.modulus);
    const double middle = std::sqrt(8.0) * 1e-3 * reach_along_edge(1e4, 1e-4, std::sqrt(8.0) * 1e-3, c.modulus);
    EXPECT_NEAR(area_in_contact(c), side * middle * std::sqrt(0.5), 1e-12);
    const std::vector<Vec3<double>> outline = contact_outline(c);
    ASSERT_EQ(outline.size(), 4u);
    EXPECT_NEAR(norm(outline[0] - Vec3<double>{side, 0, 0}), 0, 1e-12);
    EXPECT_NEAR(norm(outline[3] - Vec3<double>{0, side, 0}), 0, 1e-12);
    EXPECT_NEAR(norm(outline[1] - outline[2]), 0, 1e-12);  // the diagonal, seen from both faces
    c.touches = {1, 1, 1, 1};
    EXPECT_NEAR(area_in_contact(c), 4e-6, 1e-15);
    EXPECT_TRUE(contact_outline(c).empty());
    c.touches = {0, 0, 0, 0};
    EXPECT_EQ(area_in_contact(c), 0);
}

/// More faces than are asked at once, with one, two, or three samples that touch.
TEST(ContactEdge, AreaIsThatOfThePartsThatOthersRead) {
    constexpr int side = 9;
    ContactSurface c;
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            c.position.push_back({1e-3 * x + 1e-4 * y, 1e-3 * y, 1e-4 * x * y});
            c.touches.push_back((x * x + 3 * y + x * y) % 5 < 2);
            c.pressing.push_back({0, 0, c.touches.back() ? std::pow(10.0, (x + 2 * y) % 7 - 8) : 0});
            c.gap.push_back(c.touches.back() ? 0 : std::pow(10.0, (2 * x + y) % 9 - 12));
            if (x == 0 || y == 0) continue;
            const int i = y * side + x;
            c.faces.push_back({i - side - 1, i - side, i});
            c.faces.push_back({i - side - 1, i, i - 1});
        }
    c.gap[3] = HUGE_VAL;
    c.area.resize(c.position.size(), 1e-6);
    c.modulus = 40e3;
    double parts = 0;
    for (int face = 0; face < int(c.faces.size()); ++face) {
        const PressedFace pressed = pressed_part(c, face);
        for (int k = 0; k < pressed.count; ++k) {
            std::array<Vec3<double>, 3> x;
            for (std::size_t i = 0; i < 3; ++i) x[i] = face_point(c, face, pressed.part[std::size_t(k)].corner[i]);
            parts += 0.5 * norm(cross(x[1] - x[0], x[2] - x[0]));
        }
    }
    EXPECT_GT(parts, 1e-5);
    EXPECT_NEAR(area_in_contact(c), parts, 1e-11 * parts);
}

TEST(ContactEdge, ANodeThatBeginsToTouchChangesNoArea) {
    ContactSurface c = one_corner();
    c.gap[1] = 1e-12;
    const double before = area_in_contact(c);
    c.touches[1] = 1, c.gap[1] = 0, c.pressing[1] = {0, 0, 1e-12};
    EXPECT_NEAR(area_in_contact(c), before, 1e-3 * before);
}

/// Largest change of the area in one step, as a share of it, above a tenth of a newton: the area in contact, and that
/// of whole nodes.
std::array<double, 2> largest_leaps(const std::string& mesh) {
    Scene scene = load_scene_text(
        "duration_s = 0.62\ndt_ms = 1\n[solver]\npreset = \"reference\"\n"
        "[[object]]\nname = \"table\"\nkind = \"plane\"\n"
        "[[finger]]\nname = \"index\"\nshape = { finger = \"index\" }\n" +
            mesh +
            "track = [ { t_s = 0, position_mm = [0, 0, 9.2], rotation_deg = [0, 20, 0] },\n"
            "          { t_s = 0.6, position_mm = [0, 0, 7], rotation_deg = [0, 20, 0] } ]\n",
        "press.toml");
    Simulation s = make_simulation(std::move(scene), 1);
    std::array<double, 2> last{}, leap{};
    while (s.world.time < 0.6) {
        advance(s);
        const ContactSurface& c = s.world.contact_surfaces[0];
        double nodes = 0;
        for (std::size_t k = 0; k < c.area.size(); ++k) nodes += c.touches[k] ? c.area[k] : 0;
        const std::array<double, 2> now{c.touching_area, nodes};
        for (std::size_t k = 0; k < 2; ++k) {
            if (c.normal_force > 0.1 && last[k] > 0) leap[k] = std::max(leap[k], std::abs(now[k] / last[k] - 1));
            last[k] = now[k];
        }
    }
    return leap;
}

TEST(ContactEdge, AreaIsContinuousInASmoothPress) {
    for (const std::string mesh : {"", "mesh = { kind = \"conforming\", patch = 5 }\n"}) {
        const auto [area, nodes] = largest_leaps(mesh);
        std::printf("%s: steps change the area by up to %.1f %%, that of whole nodes by up to %.1f %%\n",
                    mesh.empty() ? "uniform" : "conforming", 100 * area, 100 * nodes);
        EXPECT_LT(area, 0.03);
        EXPECT_GT(nodes, 2 * area);
    }
}

}  // namespace
}  // namespace palpate
