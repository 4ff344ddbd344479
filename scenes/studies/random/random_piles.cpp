#include "scenes/studies/random/random_piles.h"

#include <algorithm>

#include "scenes/studies/random/random_mesh.h"

namespace palpate {

namespace {

Block mesh_keys() { return {line("kind = \"mesh\"\nfile = \"%s\"", random_mesh_file)}; }

void add_body_keys(Random& r, Block& b) {
    b.push_back(line("mass_g = %.3f", r.log_between(5, 200)));
    if (r.chance(0.8)) b.push_back(line("friction = %.3f", r.between(0.1, 1)));
}

Block ground(Random& r) {
    return {"[[object]]", "name = \"ground\"", "kind = \"plane\"", line("friction = %.3f", r.between(0.1, 1))};
}

/// Turned about the vertical.
std::string yaw(double degrees) { return line("rotation_deg = [0, 0, %.2f]", degrees); }

/// What a stack is made of: all of it alike, of triangles or not.
Solid stacked_solid(Random& r, RandomScene& s, bool& is_bar) {
    is_bar = r.chance(0.4);
    const bool plate = !is_bar && r.chance(0.3);
    const double side = is_bar ? r.between(6, 12) : r.between(12, 28);
    const std::array<double, 3> size{is_bar ? r.between(40, 80) : side * r.between(0.8, 1.25), side,
                                     plate ? r.between(3, 6) : side};
    Solid out;
    out.width = size[1], out.height = size[2];
    if (r.chance(0.25)) {
        out.keys = {"kind = \"box\"", line("size_mm = [%.3f, %.3f, %.3f]", size[0], size[1], size[2])};
    } else if (is_bar || r.chance(0.7)) {
        s.mesh = box_mesh(size, r.integer(1, 4));
        out.keys = mesh_keys();
    } else {
        s.mesh = prism_mesh(r.integer(3, 9), 0.5 * side, size[2]);
        out.keys = mesh_keys();
    }
    return out;
}

}  // namespace

Solid any_solid(Random& r, RandomScene& s, double smallest, double largest) {
    if (!s.mesh.empty() || r.chance(0.5)) return random_solid(r, smallest, largest);
    Solid out;
    out.keys = mesh_keys();
    out.width = r.between(smallest, largest), out.height = r.between(smallest, largest);
    if (r.chance(0.5)) {
        s.mesh = box_mesh({r.between(smallest, largest), out.width, out.height}, r.integer(1, 4));
    } else {
        const int sides = 2 * r.integer(2, 6);  // flat where fingers come from, or an edge there
        s.mesh = prism_mesh(sides, 0.5 * out.width, out.height);
    }
    return out;
}

double draw_stack(Random& r, RandomScene& s) {
    bool is_bar = false;
    const Solid solid = stacked_solid(r, s, is_bar);
    const std::string base = r.one_of({"plane", "box", "mesh"});
    double top = 0;
    const double turned = r.between(-90, 90);
    if (base == "plane") {
        s.blocks.push_back(ground(r));
    } else {
        const double thickness = r.between(4, 20);
        const bool same = base == "mesh" && !s.mesh.empty();  // else there is no mesh yet, and it may be the base
        if (base == "mesh" && !same) s.mesh = box_mesh({50, 50, thickness}, r.integer(1, 6));
        const double height = same ? solid.height : thickness;
        Block b = object("base",
                         same             ? solid.keys
                         : base == "mesh" ? mesh_keys()
                                          : Block{"kind = \"box\"", line("size_mm = [50, 50, %.3f]", thickness)},
                         0, 0, -0.5 * height);
        b.push_back(yaw(turned));
        b.push_back(line("friction = %.3f", r.between(0.1, 1)));
        s.blocks.push_back(b);
    }
    const int bodies = r.integer(1, 3);
    for (int i = 0; i < bodies; ++i) {
        const double gap = r.chance(0.5) ? 0 : r.between(-0.3, 1), aside = is_bar ? 1 : 0.15 * solid.width;
        Block b = object(line("body %d", i).c_str(), solid.keys, r.between(-aside, aside), r.between(-aside, aside),
                         top + gap + 0.5 * solid.height);
        b.push_back(yaw(is_bar ? turned + 90 * (i + 1) + r.between(-30, 30) : r.between(-180, 180)));
        add_body_keys(r, b);
        s.blocks.push_back(b);
        top += gap + solid.height;
    }
    return top;
}

void draw_carried(Random& r, RandomScene& s, double duration) {
    const double thickness = r.between(3, 10);
    Block tray{"[[object]]", "name = \"tray\""};
    if (r.chance(0.4)) {
        s.mesh = box_mesh({60, 60, thickness}, r.integer(1, 6));
        tray.push_back(mesh_keys()[0]);
    } else {
        tray.push_back(line("kind = \"box\"\nsize_mm = [60, 60, %.3f]", thickness));
    }
    tray.push_back(line("friction = %.3f", r.between(0.1, 1)));
    tray.emplace_back("track = [");
    tray.push_back(keyframe(0, 0, 0, -0.5 * thickness, 0, 0));
    const double speed = r.log_between(10, 400), travel = speed * duration;  // mm/s
    for (int k = 1; k <= 2; ++k)
        tray.push_back(keyframe(0.5 * k * duration, r.between(-1, 1) * travel, r.between(-1, 1) * travel,
                                -0.5 * thickness + r.between(-0.5, 1) * travel, r.between(-10, 10),
                                r.between(-10, 10)));
    tray.emplace_back("]");
    s.blocks.push_back(tray);
    double top = 0;
    for (int i = 0, bodies = r.integer(1, 3); i < bodies; ++i) {
        const Solid solid = any_solid(r, s, 8, 20);
        Block b = object(line("body %d", i).c_str(), solid.keys, r.between(-3, 3), r.between(-3, 3),
                         top + 0.5 * solid.height);
        add_body_keys(r, b);
        s.blocks.push_back(b);
        top += solid.height;
    }
}

void draw_flight(Random& r, RandomScene& s) {
    for (int i = 0, bodies = r.integer(1, 3); i < bodies; ++i) {
        const Solid solid = any_solid(r, s, 8, 30);
        Block b = object(line("body %d", i).c_str(), solid.keys, 0, 200.0 * i, 0);
        b.push_back(line("mass_g = %.3f", r.log_between(0.5, 500)));
        b.push_back(
            line("rotation_deg = [%.2f, %.2f, %.2f]", r.between(-180, 180), r.between(-90, 90), r.between(-180, 180)));
        const double spin = r.log_between(0.1, 60), speed = r.between(0, 2);
        b.push_back(line("velocity_m_per_s = [%.3f, 0, %.3f]", r.between(-speed, speed), r.between(-speed, speed)));
        if (r.chance(0.8))
            b.push_back(line("spin_rad_per_s = [%.3f, %.3f, %.3f]", r.between(-spin, spin), r.between(-spin, spin),
                             r.between(-spin, spin)));
        s.blocks.push_back(b);
    }
}

void draw_overlap(Random& r, RandomScene& s) {
    const bool beside = r.chance(0.6), table = r.chance(0.7);
    if (table) s.blocks.push_back(ground(r));
    const int bodies = r.integer(2, 3);
    double end = 0;  // of what stands so far, along y or up
    for (int i = 0; i < bodies; ++i) {
        const Solid solid = any_solid(r, s, 8, 24);
        const double depth = i == 0 ? 0 : r.between(0.05, 1.9), extent = beside ? solid.width : solid.height;
        const double at = end - depth + 0.5 * extent, aside = r.between(-0.3, 0.3) * solid.width;
        // A free body may begin in the table as well.
        const double sunk = table && r.chance(0.2) ? r.between(0, 1.5) : 0;
        Block b = beside ? object(line("body %d", i).c_str(), solid.keys, aside, at, 0.5 * solid.height - sunk)
                         : object(line("body %d", i).c_str(), solid.keys, aside, 0, at - sunk);
        // One of them may be fixed, but not all.
        if (i != 1 || r.chance(0.8) || bodies == 2)
            add_body_keys(r, b);
        else
            b.push_back("friction = 0.5");
        s.blocks.push_back(b);
        end = at + 0.5 * extent;
    }
}

}  // namespace palpate
