// Scenes that fewer people write: bodies that are meshes, fly and spin, are pushed, lie on tissue; any finger from any
// side.

#include "scenes/studies/random/random_odd.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate {

namespace {

/// Something with its middle at z = 0 and how far it reaches [mm].
struct Thing {
    double reach = 12, lift = 0;  ///< what fingers go for is so far above z = 0
};

Block mesh_body(Random& r, RandomScene& s, double z) {
    if (s.mesh.empty()) s.mesh = lumpy_ball(r);
    Block b{"[[object]]", "name = \"thing\"", line("kind = \"mesh\"\nfile = \"%s\"", random_mesh_file),
            line("position_mm = [0, 0, %.3f]", z)};
    if (r.chance(0.3)) b.push_back(line("smoothing_mm = %.2f", r.between(0.3, 2)));
    return b;
}

/// A mesh, or a solid that spins and flies, alone or above a table.
Thing draw_body(Random& r, RandomScene& s) {
    const bool table = r.chance(0.6);
    if (table) s.blocks.push_back({"[[object]]", "name = \"table\"", "kind = \"plane\"", "friction = 0.6"});
    Thing thing;
    Block b;
    if (r.chance(0.5)) {
        thing.reach = 16, thing.lift = table ? 21 + r.between(0, 5) : 0;
        b = mesh_body(r, s, thing.lift);
    } else {
        const Solid solid = random_solid(r, 12, 28);
        thing.reach = 0.5 * std::hypot(solid.width, solid.height);
        thing.lift = table ? 0.5 * solid.height + r.between(0, 8) : 0;
        b = object("thing", solid.keys, 0, 0, thing.lift);
    }
    add_matter(r, b, true, random_friction(r));
    if (r.chance(0.5))
        b.push_back(line("velocity_m_per_s = [%.3f, %.3f, %.3f]", r.between(-0.5, 0.5), r.between(-0.5, 0.5),
                         r.between(-0.5, 0.5)));
    if (r.chance(0.5))
        b.push_back(
            line("spin_rad_per_s = [%.2f, %.2f, %.2f]", r.between(-20, 20), r.between(-20, 20), r.between(-20, 20)));
    if (r.chance(0.2)) b.push_back(line("release_s = %.4f", r.between(0, 0.05)));
    s.blocks.push_back(b);
    return thing;
}

/// A body on a table that a moved box pushes.
Thing draw_pushed(Random& r, RandomScene& s, double dt) {
    s.blocks.push_back(
        {"[[object]]", "name = \"table\"", "kind = \"plane\"", line("friction = %.2f", r.between(0, 1))});
    const Solid solid = random_solid(r, 10, 24);
    Block body = object("thing", solid.keys, 0, 0, 0.5 * solid.height);
    add_matter(r, body, true, random_friction(r));
    s.blocks.push_back(body);
    Block box{"[[object]]",
              "name = \"pusher\"",
              "kind = \"box\"",
              line("size_mm = [%.2f, 30, 14]", r.log_between(0.5, 10)),
              line("friction = %.3f", r.between(0, 1)),
              "track = ["};
    const double from = -0.5 * std::max(solid.width, 24.0) - 8;
    box.push_back(keyframe(0, from, 0, 8, 0, 0));
    box.push_back(keyframe(dt * r.integer(8, 30), from + r.between(4, 24), r.between(-3, 3), 8, 0, 0));
    box.emplace_back("]");
    s.blocks.push_back(box);
    return {0.5 * std::hypot(solid.width, solid.height), 0.5 * solid.height};
}

/// Tissue with a body on it.
Thing draw_on_tissue(Random& r, RandomScene& s) {
    const double height = r.between(8, 16);
    s.blocks.push_back({"[[object]]", "name = \"tissue\"", "kind = \"box\"",
                        line("size_mm = [%.2f, %.2f, %.2f]", r.between(20, 40), r.between(20, 50), height),
                        line("position_mm = [0, 0, %.3f]", -0.5 * height),
                        line("soft = { young_kPa = %.2f, poisson = %.3f, elements = %d, fixed = \"bottom\" }",
                             r.log_between(2, 100), r.between(0.2, 0.45), r.integer(150, 500)),
                        line("friction = %.3f", r.between(0, 1))});
    const Solid solid = random_solid(r, 10, 20);
    Block body = object("thing", solid.keys, 0, 0, 0.5 * solid.height + r.between(0, 3));
    body.push_back(line("mass_g = %.3f", r.log_between(1, 100)));
    if (r.chance(0.7)) body.push_back(line("friction = %.3f", r.between(0.1, 1)));
    s.blocks.push_back(body);
    return {0.5 * std::hypot(solid.width, solid.height), 0.5 * solid.height};
}

/// A finger that goes for the middle of a thing from any side, with its pad, askew, or with its nail.
Block from_a_side(Random& r, const std::string& name, const Thing& thing, double angle, double dt) {
    Block b = any_finger(r, name);
    const double a = angle * std::numbers::pi / 180, far = thing.reach + r.between(12, 16),
                 near = 0.85 * thing.reach + 7 - r.between(0, 5), x = r.between(-4, 4);
    const double roll = -angle + (r.chance(0.15) ? 180 : r.between(-30, 30)), pitch = r.between(-30, 30);
    const double close = dt * r.integer(5, 16);
    auto pose = [&](double t, double from, double aside) {
        return keyframe(t, x + aside, from * std::sin(a), thing.lift + from * std::cos(a), roll, pitch);
    };
    b.emplace_back("track = [");
    b.push_back(pose(0, far, 0));
    b.push_back(pose(close, near, 0));
    if (r.chance(0.5)) b.push_back(pose(close + dt * r.integer(4, 15), near, r.between(-5, 5)));
    if (r.chance(0.3)) b.push_back(pose(close + dt * r.integer(16, 24), far, 0));
    b.emplace_back("]");
    return b;
}

}  // namespace

void draw_odd(Random& r, RandomScene& s, int fingers, double dt) {
    const std::string kind = r.one_of({"body", "body", "pushed", "on tissue"});
    const Thing thing = kind == "body"     ? draw_body(r, s)
                        : kind == "pushed" ? draw_pushed(r, s, dt)
                                           : draw_on_tissue(r, s);
    for (int i = 0; i < fingers; ++i) {
        const double angle = fingers == 1 ? r.between(-90, 90) : -80 + 160.0 * i / (fingers - 1) + r.between(-10, 10);
        s.blocks.push_back(from_a_side(r, line("finger %d", i), thing, angle, dt));
    }
}

}  // namespace palpate
