#include "scenes/studies/random/random_scene.h"

#include <algorithm>
#include <cmath>

#include "scenes/studies/random/random_handled.h"
#include "scenes/studies/random/random_odd.h"

namespace palpate {

namespace {

/// Of fingers that say nothing else: what was found with a seed is found again.
const Block plain_meshes{"[mesh]", "kind = \"uniform\"", "patch = 0"};

/// Down onto something whose top is at `top`, aside, and up again or not. Pads lie some 7 mm below a finger's origin.
void add_press(Random& r, Block& b, double x, double y, double top, double dt) {
    const double above = top + r.between(12, 14), depth = r.between(0.3, 3.5), pitch = r.between(-20, 20);
    const double down = dt * r.integer(4, 15), roll = r.between(-15, 15);
    b.emplace_back("track = [");
    b.push_back(keyframe(0, x, y, above, roll, pitch));
    b.push_back(keyframe(down, x, y, top + 8 - depth, roll, pitch));
    if (r.chance(0.6)) {
        const double aside = r.between(-6, 6), along = r.between(-6, 6);
        b.push_back(keyframe(down + dt * r.integer(3, 15), x + along, y + aside, top + 8 - depth, roll, pitch));
    }
    if (r.chance(0.3)) b.push_back(keyframe(down + 16 * dt + 0.01, x, y, above + 5, roll, pitch));
    b.emplace_back("]");
}

/// Each finger above an object of its own, or all above one plate or plane.
void draw_press(Random& r, RandomScene& s, int fingers, int elements, double dt) {
    const bool common = r.chance(0.35);
    const double friction = random_friction(r);
    double top = 0;
    if (common) {
        Block b{"[[object]]", "name = \"ground\""};
        if (r.chance(0.5)) {
            b.emplace_back("kind = \"plane\"");
        } else {
            const double thickness = r.log_between(0.8, 20);
            b.emplace_back("kind = \"box\"");
            b.push_back(line("size_mm = [%.2f, %.2f, %.3f]", r.between(20, 60), 24.0 * fingers + 20, thickness));
            top = 0.5 * thickness;
        }
        add_matter(r, b, false, friction);
        s.blocks.push_back(b);
    }
    for (int i = 0; i < fingers; ++i) {
        const double x = r.between(-3, 3), y = 26.0 * (i - 0.5 * (fingers - 1));
        double own_top = top;
        if (!common) {
            const Solid solid = random_solid(r, 8, 24);
            Block b = object(line("object %d", i).c_str(), solid.keys, x + r.between(-2, 2), y, 0);
            add_matter(r, b, false, friction);
            s.blocks.push_back(b);
            own_top = 0.5 * solid.height;
        }
        Block b = finger(r, line("finger %d", i), elements);
        add_press(r, b, x, y, own_top, dt);
        s.blocks.push_back(b);
    }
}

/// Two fingers from two sides, or more around it, take a body from a table and lift it.
void draw_grasp(Random& r, RandomScene& s, int fingers, int elements, double dt) {
    const Solid solid = random_solid(r, 14, 34);
    const double friction = r.between(0.3, 1.2), close = dt * r.integer(8, 20), squeeze = r.between(0.5, 3);
    s.blocks.push_back({"[[object]]", "name = \"table\"", "kind = \"plane\"", "friction = 0.5"});
    Block body = object("body", solid.keys, 0, 0, 0.5 * solid.height);
    add_matter(r, body, true, friction);
    if (r.chance(0.2)) body.push_back(line("release_s = %.4f", dt * r.integer(5, 30)));
    s.blocks.push_back(body);
    if (r.chance(0.7))
        s.blocks.push_back({"[hand]", "track = [",
                            line("    { t_s = %.4f, position_mm = [0, 0, %.3f] },", close + 5 * dt, 0.5 * solid.height),
                            line("    { t_s = %.4f, position_mm = [0, 0, %.3f] },", close + 25 * dt,
                                 0.5 * solid.height + r.between(2, 20)),
                            "]"});
    else
        s.blocks.push_back(
            {"[hand]", "track = [", line("    { t_s = 0, position_mm = [0, 0, %.3f] },", 0.5 * solid.height), "]"});
    for (int i = 0; i < std::max(2, fingers); ++i) {
        const int pair = i / 2, pairs = std::max(2, fingers) / 2;
        const double side = i % 2 ? 1 : -1, x = 20.0 * pair - 10.0 * (pairs - 1);
        const double from = 0.5 * solid.width;
        Block b = finger(r, line("finger %d", i), elements);
        b.emplace_back("track = [");
        b.push_back(keyframe(0, x, side * (from + 11), 0, -90 * side, 0));
        b.push_back(keyframe(close, x, side * (from + 7.5 - squeeze), 0, -90 * side, 0));
        b.emplace_back("]");
        s.blocks.push_back(b);
    }
}

/// Bodies dropped beside and on each other, fingers poke them.
void draw_pile(Random& r, RandomScene& s, int fingers, int elements, double dt) {
    Block table{"[[object]]", "name = \"table\"", "kind = \"plane\"", line("friction = %.3f", r.between(0, 1))};
    const bool last = r.chance(0.5);  // the order in which objects are declared must not matter
    if (!last) s.blocks.push_back(table);
    const int bodies = r.integer(1, 9);
    double top = 0;
    for (int i = 0; i < bodies; ++i) {
        const Solid solid = random_solid(r, 8, 20);
        const double gap = r.between(0, 3), x = r.between(-2, 2), y = r.between(-2, 2);
        Block b = object(line("body %d", i).c_str(), solid.keys, x, y, top + gap + 0.5 * solid.height);
        add_matter(r, b, true, random_friction(r));
        s.blocks.push_back(b);
        top += gap + solid.height;
    }
    if (last) s.blocks.push_back(table);
    for (int i = 0; i < fingers; ++i) {
        Block b = finger(r, line("finger %d", i), elements);
        add_press(r, b, r.between(-10, 10), 26.0 * (i - 0.5 * (fingers - 1)), top + r.between(0, 3), dt);
        s.blocks.push_back(b);
    }
}

/// A body falls on fingers that lie still, pads up or down.
void draw_drop(Random& r, RandomScene& s, int fingers, int elements) {
    for (int i = 0; i < fingers; ++i) {
        const double y = 26.0 * (i - 0.5 * (fingers - 1));
        Block b = finger(r, line("finger %d", i), elements);
        b.push_back(line("track = [ { t_s = 0, position_mm = [0, %.2f, 0], rotation_deg = [180, 0, 0] } ]", y));
        s.blocks.push_back(b);
        const Solid solid = random_solid(r, 12, 24);
        Block body = object(line("body %d", i).c_str(), solid.keys, r.between(-2, 2), y,
                            10 + r.between(1, 30) + 0.5 * solid.height);
        body.push_back(line("mass_g = %.3f", r.log_between(1, 200)));
        if (r.chance(0.5)) body.push_back(line("friction = %.3f", r.between(0.1, 1)));
        s.blocks.push_back(body);
    }
    if (r.chance(0.3)) s.blocks.push_back({"[coupling]", line("stiffness_N_per_mm = %.3f", r.log_between(0.5, 500))});
}

/// Fingers against each other, two by two: pad to pad or askew, pressed, sheared, turned; of some pairs one stays.
void draw_pinch(Random& r, RandomScene& s, int fingers, int elements, double dt) {
    if (r.chance(0.8)) s.blocks.push_back({"[contact]", line("skin_friction = %.3f", random_friction(r))});
    for (int i = 0; i < std::max(2, fingers); ++i) {
        const int pair = i / 2;
        const double side = i % 2 ? 1 : -1, x = 30.0 * pair, close = dt * r.integer(5, 15);
        const double aside = r.between(-3, 3), up = r.between(-3, 3), roll = -90 * side + r.between(-20, 20);
        const double pitch = r.between(-15, 15), pressed = 8 - r.between(0.3, 2);
        Block b = finger(r, line("finger %d", i), elements);
        b.emplace_back("track = [");
        b.push_back(keyframe(0, x + aside, 13 * side, up, roll, pitch));
        b.push_back(keyframe(close, x + aside, pressed * side, up, roll, pitch));
        if (r.chance(0.5))
            b.push_back(keyframe(close + dt * r.integer(3, 15), x + aside + r.between(-4, 4), pressed * side,
                                 up + r.between(-4, 4), roll + r.between(-10, 10), pitch));
        if (r.chance(0.3)) b.push_back(keyframe(close + 20 * dt, x + aside, 14 * side, up, roll, pitch));
        b.emplace_back("]");
        s.blocks.push_back(b);
    }
}

/// A thing with its top at `top`: a mesh, a rod, a card, something that gives way or that a script moves.
Block any_thing(Random& r, RandomScene& s, const std::string& name, double y, double dt, double& top) {
    Block b{"[[object]]", "name = \"" + name + "\""};
    const std::string kind = r.one_of({"mesh", "rod", "card", "soft", "moved"});
    double x = r.between(-2, 2);
    if (kind == "mesh") {
        if (s.mesh.empty()) s.mesh = lumpy_ball(r);
        b.push_back(line("kind = \"mesh\"\nfile = \"%s\"", random_mesh_file));
        if (r.chance(0.4)) b.push_back(line("smoothing_mm = %.2f", r.chance(0.5) ? 0 : r.between(0.3, 2)));
        top = 14;
    } else if (kind == "rod") {
        const double radius = r.between(1.5, 5);
        b.push_back(line("kind = \"%s\"\nradius_mm = %.3f\nlength_mm = 30", r.one_of({"capsule", "cylinder"}), radius));
        b.push_back(line("rotation_deg = [90, 0, %.1f]", r.between(-90, 90)));
        top = radius;
    } else {
        const double thickness = kind == "card" ? r.log_between(0.2, 3) : r.between(5, 20);
        b.push_back(
            line("kind = \"box\"\nsize_mm = [%.2f, %.2f, %.3f]", r.between(15, 40), r.between(15, 25), thickness));
        top = 0.5 * thickness;
    }
    if (kind == "soft") b.push_back(line("stiffness_kPa_per_mm = %.2f", r.log_between(2, 500)));
    if (kind == "moved") {
        b.emplace_back("track = [");
        b.push_back(keyframe(0, x, y, 0, 0, 0));
        b.push_back(
            keyframe(dt * r.integer(20, 60), x + r.between(-8, 8), y + r.between(-4, 4), r.between(-2, 2), 0, 0));
        b.emplace_back("]");
    } else {
        b.push_back(line("position_mm = [%.3f, %.3f, 0]", x, y));
    }
    if (r.chance(0.6)) b.push_back(line("friction = %.3f", r.between(0.1, 1.2)));
    return b;
}

/// Any finger on any thing, side by side.
void draw_things(Random& r, RandomScene& s, int fingers, double dt) {
    for (int i = 0; i < fingers; ++i) {
        const double y = 26.0 * (i - 0.5 * (fingers - 1));
        double top = 0;
        s.blocks.push_back(any_thing(r, s, line("thing %d", i), y, dt, top));
        Block b = any_finger(r, line("finger %d", i));
        add_press(r, b, r.between(-2, 2), y, top, dt);
        s.blocks.push_back(b);
    }
}

/// Something of tissue that stands with its middle at z = 0, its top at `top`: soft or firm, in limits or not, with a
/// nodule or not, held at its bottom.
Block any_tissue(Random& r, const std::string& name, double width, double y, double dt, double& top) {
    Block b{"[[object]]", "name = \"" + name + "\""};
    const std::string kind = r.one_of({"box", "box", "sphere", "cylinder", "capsule"});
    const double radius = r.between(9, 13), length = r.between(8, 16), x = r.between(-2, 2);
    top = 0.5 * length;
    if (kind == "box") {
        b.push_back(line("kind = \"box\"\nsize_mm = [%.2f, %.2f, %.2f]", r.between(24, 40), width, length));
    } else if (kind == "sphere") {
        top = radius;
        b.push_back(line("kind = \"sphere\"\nradius_mm = %.2f", radius));
    } else {
        if (kind == "capsule") top += radius;
        b.push_back(line("kind = \"%s\"\nradius_mm = %.2f\nlength_mm = %.2f", kind.c_str(), radius, length));
    }
    std::string soft = line("soft = { young_kPa = %.2f, poisson = %.3f, elements = %d, fixed = \"bottom\"",
                            r.log_between(2, 100), r.between(0.2, 0.49), r.integer(150, 500));
    if (kind != "box") soft += line(", fixed_mm = %.2f", r.between(0.4, 0.6) * top);
    if (r.chance(0.4)) soft += line(", limits = { low = %.2f, high = %.2f }", r.between(0.5, 0.8), r.between(1.2, 1.6));
    if (kind == "box" && r.chance(0.3))
        soft += line(", nodule = [ { centre_mm = [0, 0, 0], radius_mm = %.2f, young_kPa = %.2f } ]",
                     r.between(0.2, 0.35) * length, r.log_between(2, 300));
    b.push_back(soft + " }");
    if (r.chance(0.2)) {
        b.emplace_back("track = [");
        b.push_back(keyframe(0, x, y, 0, 0, 0));
        b.push_back(
            keyframe(dt * r.integer(20, 60), x + r.between(-4, 4), y + r.between(-3, 3), r.between(-1, 1), 0, 0));
        b.emplace_back("]");
    } else {
        b.push_back(line("position_mm = [%.3f, %.3f, 0]", x, y));
    }
    if (r.chance(0.6)) b.push_back(line("friction = %.3f", r.between(0.1, 1.2)));
    return b;
}

/// Fingers on tissue, each on its own or all on one; sometimes a body lies on it.
void draw_tissue(Random& r, RandomScene& s, int fingers, int elements, double dt) {
    const bool common = fingers > 1 && r.chance(0.3);
    double top = 0;
    for (int i = 0; i < fingers; ++i) {
        const double y = 26.0 * (i - 0.5 * (fingers - 1));
        if (!common)
            s.blocks.push_back(any_tissue(r, line("tissue %d", i), 24, y, dt, top));
        else if (i == 0)
            s.blocks.push_back(any_tissue(r, "tissue", 26.0 * fingers + 4, 0, dt, top));
        Block b = finger(r, line("finger %d", i), elements);
        add_press(r, b, r.between(-2, 2), y, top, dt);
        s.blocks.push_back(b);
    }
    if (!common && r.chance(0.25)) {
        const Solid solid = random_solid(r, 6, 10);
        Block b = object("body", solid.keys, -8, 26.0 * (0.5 * (fingers - 1)), top + 1 + 0.5 * solid.height);
        b.push_back(line("mass_g = %.3f", r.log_between(1, 20)));
        s.blocks.push_back(b);
    }
}

bool has_table(const RandomScene& s, const char* header) {
    return std::any_of(s.blocks.begin(), s.blocks.end(), [&](const Block& b) { return b[0] == header; });
}

/// Now and then, settings that few touch.
void add_settings(Random& r, RandomScene& s) {
    if (r.chance(0.1))
        s.blocks[0].push_back(
            line("gravity_m_per_s2 = [%.2f, %.2f, %.2f]", r.between(-6, 6), r.between(-6, 6), r.between(-15, 0)));
    Block& solver = s.blocks[1];
    if (r.chance(0.15)) solver.push_back(line("newton_iterations = %d", r.integer(2, 4)));
    if (r.chance(0.1)) solver.push_back(line("contact_iterations = %d", r.integer(0, 4)));
    if (r.chance(0.15)) solver.push_back(line("stiffness_steps = %d", r.integer(1, 20)));
    if (r.chance(0.1)) solver.push_back(line("steadying_iterations = %d", r.integer(0, 8)));
    if (r.chance(0.1)) solver.push_back(line("recovery_speed_mm_per_s = %.1f", r.log_between(5, 500)));
    if (r.chance(0.25) && !has_table(s, "[coupling]")) {
        Block coupling{"[coupling]"};
        if (r.chance(0.7)) coupling.push_back(line("stiffness_N_per_mm = %.3f", r.log_between(0.1, 300)));
        if (r.chance(0.3)) coupling.push_back(line("damping_Ns_per_m = %.3f", r.log_between(0.1, 50)));
        if (r.chance(0.3)) coupling.push_back(line("angular_stiffness_Nm_per_rad = %.4f", r.log_between(0.05, 30)));
        if (r.chance(0.2)) coupling.push_back(line("max_speed_m_per_s = %.3f", r.log_between(0.05, 5)));
        if (r.chance(0.2)) coupling.push_back(line("max_force_N = %.3f", r.log_between(1, 100)));
        s.blocks.push_back(coupling);
    }
    if (r.chance(0.05) && !has_table(s, "[contact]")) s.blocks.push_back({"[contact]", "fingers = false"});
}

/// Objects that stand anywhere, turned: bodies about the vertical, what is fixed in every direction.
void turn_objects(Random& r, RandomScene& s) {
    for (Block& b : s.blocks) {
        const auto has = [&](const char* key) {
            return std::any_of(b.begin(), b.end(), [&](const std::string& l) { return l.rfind(key, 0) == 0; });
        };
        if (b[0] != "[[object]]" || has("kind = \"plane\"") || has("rotation_deg") || has("track")) continue;
        if (!r.chance(0.4)) continue;
        const double tilt = has("mass_g") || has("soft") ? 0 : 20;
        b.push_back(line("rotation_deg = [%.2f, %.2f, %.2f]", r.between(-tilt, tilt), r.between(-tilt, tilt),
                         r.between(-180, 180)));
    }
}

}  // namespace

RandomScene random_scene_fingers(bool other, bool uniform) {
    RandomScene s;
    s.blocks.push_back({"duration_s = 0.01"});
    if (uniform) s.blocks.push_back(plain_meshes);
    int i = 0;
    auto add = [&](Block b) {
        b.insert(b.begin(), {"[[finger]]", line("name = \"finger %d\"", i)});
        b.push_back(line("track = [ { t_s = 0, position_mm = [0, %d, 0] } ]", 40 * i++));
        s.blocks.push_back(b);
    };
    for (const char* name : {"thumb", "index", "middle", "ring", "little"}) {
        for (int elements : random_scene_elements)
            add({line("shape = { finger = \"%s\" }", name), line("elements = %d", elements)});
        if (uniform) continue;
        for (int elements : random_scene_conforming_elements)
            add({line("shape = { finger = \"%s\" }", name), line("elements = %d", elements)});
    }
    if (!other) return s;
    for (const char* preset : {"index-median", "little-small"}) add({line("finger = \"%s\"", preset)});
    add({"shape = { finger = \"index\" }", "elements = 350", "mesh = { kind = \"conforming\", patch = 5 }"});
    return s;
}

RandomScene random_scene(unsigned seed) {
    Random r{seed};
    for (int i = 0; i < 4; ++i) r.next();
    RandomScene s;
    const double steps_ms[] = {0.5, 1, 2, 5, 10, 20};
    const double dt_ms = steps_ms[r.integer(0, 5)];
    const bool brief = is_short_scene(seed);
    const int fingers = r.chance(0.5) ? 1 : r.integer(2, r.chance(0.2) ? (brief ? 6 : 10) : (brief ? 3 : 5));
    const int steps = brief ? r.integer(8, 18) : r.integer(30, 60);
    s.blocks.push_back({line("dt_ms = %g", dt_ms), line("duration_s = %g", 1e-3 * dt_ms * steps)});
    Block solver{"[solver]",
                 line("preset = \"%s\"", r.one_of({"fast", "balanced", "accurate", "reference", "reference"}))};
    if (r.chance(0.35)) solver.emplace_back("precision = \"float\"");
    if (r.chance(0.2)) solver.emplace_back("detail = \"auto\"");
    if (r.chance(0.15)) solver.emplace_back("sample_refinement = 2");
    s.blocks.push_back(solver);
    const bool uniform = seed < first_seed_of_conforming || (brief && seed % 3 == 0);
    if (uniform) s.blocks.push_back(plain_meshes);
    if (r.chance(0.6))
        s.blocks.push_back(
            {"[limits]", line("low = %.3f", r.between(0.5, 0.9)), line("high = %.3f", r.between(1.1, 1.6))});
    const int size = (uniform ? random_scene_elements : random_scene_conforming_elements)[r.integer(0, 2)];
    const double kind = r.between(0, 1), dt = (brief ? 0.5e-3 : 1e-3) * dt_ms;
    // Every tenth is of fingers alone, every tenth of other fingers and things, every twentieth of tissue.
    if (seed >= first_seed_of_handled)
        draw_handled(r, s, fingers);
    else if (seed >= first_seed_of_odd)
        draw_odd(r, s, std::min(fingers, 3), dt);
    else if (seed % 10 == 9)
        draw_pinch(r, s, fingers, size, dt);
    else if (has_other_fingers(seed))
        draw_things(r, s, std::min(fingers, 3), dt);
    else if (seed % 20 == 12)
        draw_tissue(r, s, std::min(fingers, 2), size, dt);
    else if (kind < 0.4)
        draw_press(r, s, fingers, size, dt);
    else if (kind < 0.65)
        draw_grasp(r, s, fingers, size, dt);
    else if (kind < 0.85)
        draw_pile(r, s, std::min(fingers, 3), size, dt);
    else
        draw_drop(r, s, fingers, size);
    if (brief) add_settings(r, s);
    if (brief && seed < first_seed_of_odd && !(kind >= 0.85 && fingers > 1))
        turn_objects(r, s);  // bodies that fall side by side would overlap
    // Drawn last, so that all else is as without.
    if (seed >= first_seed_of_deadlines && seed % 12 == 7)
        s.blocks[1].push_back(line("deadline_ms = %.3f", r.log_between(0.02, 2)));
    return s;
}

std::string to_text(const RandomScene& scene) {
    std::string text;
    for (const auto& block : scene.blocks) {
        for (const auto& l : block) text += l + "\n";
        text += "\n";
    }
    return text;
}

}  // namespace palpate
