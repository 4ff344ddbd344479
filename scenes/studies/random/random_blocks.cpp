#include "scenes/studies/random/random_blocks.h"

namespace palpate {

Solid random_solid(Random& r, double smallest, double largest) {
    Solid s;
    const std::string kind = r.one_of({"box", "box", "sphere", "cylinder", "capsule"});
    const double radius = 0.5 * r.between(smallest, largest);
    s.width = s.height = 2 * radius;
    if (kind == "box") {
        s.width = r.between(smallest, largest);
        s.keys = {"kind = \"box\"",
                  line("size_mm = [%.3f, %.3f, %.3f]", r.between(smallest, largest), s.width, s.height)};
    } else if (kind == "sphere") {
        s.keys = {"kind = \"sphere\"", line("radius_mm = %.3f", radius)};
    } else {  // upright, so that it stands
        const double length = r.between(smallest, largest);
        s.height = length + (kind == "capsule" ? 2 * radius : 0);
        s.keys = {"kind = \"" + kind + "\"", line("radius_mm = %.3f", radius), line("length_mm = %.3f", length)};
    }
    return s;
}

Block object(const char* name, const Block& keys, double x, double y, double z) {
    Block b{"[[object]]", std::string("name = \"") + name + "\""};
    b.insert(b.end(), keys.begin(), keys.end());
    b.push_back(line("position_mm = [%.3f, %.3f, %.3f]", x, y, z));
    return b;
}

Block finger(Random& r, const std::string& name, int elements) {
    Block b{"[[finger]]", "name = \"" + name + "\"",
            line("shape = { finger = \"%s\" }", r.one_of({"thumb", "index", "middle", "ring", "little"})),
            line("elements = %d", elements)};
    if (r.chance(0.3))
        b.push_back(line("material = { young_kPa = %.2f, poisson = %.3f }", r.between(10, 80), r.between(0.1, 0.48)));
    if (r.chance(0.25)) b.push_back("device = { kind = \"chinello-3rrs\" }");
    return b;
}

Block any_finger(Random& r, const std::string& name) {
    const std::string kind = r.one_of({"preset", "conforming", "uniform", "layers"});
    if (kind == "uniform") return finger(r, name, random_scene_elements[r.integer(0, 2)]);
    Block b{"[[finger]]", "name = \"" + name + "\""};
    if (kind == "preset")
        b.push_back(line("finger = \"%s\"", r.one_of({"index-median", "little-small"})));
    else
        b.emplace_back("shape = { finger = \"index\" }");
    if (kind == "conforming") {
        b.emplace_back("elements = 350");
        b.emplace_back("mesh = { kind = \"conforming\", patch = 5 }");
    } else if (kind == "layers") {
        b.emplace_back("elements = 180");
        b.push_back(line("layer = [ { thickness_mm = 1.6, young_kPa = %.1f, low = 0.5, high = 1.5 } ]",
                         r.log_between(20, 400)));
    }
    if (r.chance(0.5))
        b.push_back(
            line("device = { kind = \"%s\", method = \"%s\" }",
                 r.one_of({"chinello-3rrs", "rrs-exact", "cable-3", "serial-3dof", "shear-2dof", "serial-5dof"}),
                 r.one_of({"constrained", "constrained", "unconstrained", "plane", "force"})));
    return b;
}

std::string keyframe(double t, double x, double y, double z, double roll, double pitch) {
    return line("    { t_s = %.4f, position_mm = [%.3f, %.3f, %.3f], rotation_deg = [%.2f, %.2f, 0] },", t, x, y, z,
                roll, pitch);
}

void add_matter(Random& r, Block& b, bool body, double friction) {
    if (friction > 0) b.push_back(line("friction = %.3f", friction));
    if (body) {
        b.push_back(line("mass_g = %.3f", r.log_between(1, 500)));
        if (r.chance(0.2)) b.push_back(line("restitution = %.2f", r.between(0, 0.9)));
    } else if (r.chance(0.1)) {
        b.push_back(line("stiffness_kPa_per_mm = %.2f", r.log_between(2, 500)));
    }
}

double random_friction(Random& r) { return r.chance(0.3) ? 0 : r.between(0.1, 1.5); }

}  // namespace palpate
