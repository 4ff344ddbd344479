// What is wrong with a plain description of a scene.

#include <algorithm>
#include <sstream>

#include "engine/build.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

/// Sentences about what is wrong, each after whose it is.
struct Complaints {
    std::vector<std::string>& wrong;
    std::string who;
    void need(bool ok, const std::string& sentence) {
        if (!ok) wrong.push_back(sentence);
    }
    void within(const std::string& what, double value, const Range& bounds, const char* unit) {
        if (bounds.holds(value)) return;
        PlainText sentence;
        sentence << who << what << " must be between " << bounds.low << " and " << bounds.high << unit << ", found "
                 << value;
        wrong.push_back(sentence.str());
    }
};

void check_tissue(const FingerSpec& f, Complaints& c) {
    c.need(!f.mesh.tets.empty() && f.mesh.bone_nodes.size() >= 3,
           c.who + "its mesh needs tetrahedra and at least three bone nodes");
    c.need(std::any_of(f.mesh.tets.begin(), f.mesh.tets.end(),
                       [&](const auto& tet) {
                           return std::any_of(tet.begin(), tet.end(), [&](int node) {
                               const auto& bone = f.mesh.bone_nodes;
                               return std::find(bone.begin(), bone.end(), node) == bone.end();
                           });
                       }),
           c.who + "all its nodes are bone nodes: nothing is left to deform");
    c.need(
        f.mesh.patches.empty() || (f.mesh.patches.size() == f.mesh.tets.size() && f.material == Material::corotational),
        c.who + "patches must be one number per element, and need corotational tissue");
    c.need(f.mesh.limit_patches.empty() ||
               (f.mesh.limit_patches.size() == f.mesh.tets.size() && f.material == Material::corotational),
           c.who + "limit patches must be one number per element, and need corotational tissue");
    const auto& shares = f.mesh.limit_shares;
    c.need(std::all_of(shares.begin(), shares.end(),
                       [&](const LimitShare& s) {
                           return s.tet >= 0 && std::size_t(s.tet) < f.mesh.limit_patches.size() && s.patch >= 0 &&
                                  s.share > 0 && s.share <= 1;
                       }) &&
               std::is_sorted(shares.begin(), shares.end(),
                              [](const LimitShare& a, const LimitShare& b) { return a.tet < b.tet; }),
           c.who + "shares of limit patches must be of its elements, ascending, and between 0 and 1");
    c.need(f.mesh.membrane_patches.empty() || f.mesh.membrane_patches.size() == f.mesh.tets.size(),
           c.who + "membrane patches must be one number per element");
    c.need(f.skin_modulus == 0 || finger_bounds::young_modulus.holds(f.skin_modulus),
           c.who + "the skin's modulus must be one of tissue, or 0 for that of the finger");
    auto within = [&](const char* what, double value, const Range& bounds, const char* unit) {
        c.within(what, value, bounds, unit);
    };
    within("Young's modulus", f.young_modulus, finger_bounds::young_modulus, " Pa");
    within("Poisson's ratio", f.poisson_ratio, finger_bounds::poisson_ratio, "");
    within("the density", f.density, finger_bounds::density, " kg/m^3");
    if (f.has_limits) {
        // Wider than what files may ask for: limits of almost exactly 1 are among the extremes that are tried.
        c.need(f.limit_low > 0.01 && f.limit_low < 1, c.who + "the lower strain limit must be between 0.01 and 1");
        c.need(f.limit_high > 1 && f.limit_high < 100, c.who + "the upper strain limit must be between 1 and 100");
    }
    auto all_within = [&](const std::vector<double>& values, const Range& bounds) {
        return values.empty() || (values.size() == f.mesh.tets.size() &&
                                  std::all_of(values.begin(), values.end(), [&](double v) { return bounds.holds(v); }));
    };
    c.need(all_within(f.element_young, finger_bounds::young_modulus) &&
               all_within(f.element_low, finger_bounds::limit_low) &&
               all_within(f.element_high, finger_bounds::limit_high),
           c.who + "values per element must be one per element, inside the bounds of those for all");
    c.need(f.element_membrane.size() == f.element_normal.size() &&
               all_within(f.element_membrane, {0, finger_bounds::young_modulus.high}),
           c.who + "membranes must be one per element, each with a modulus that is not negative and a normal");
}

void check_coupling(const Coupling& c, Complaints& complaints) {
    complaints.within("the coupling's stiffness", c.stiffness, coupling_bounds::stiffness, " N/m");
    complaints.within("the coupling's angular stiffness", c.angular_stiffness, coupling_bounds::angular_stiffness,
                      " N m/rad");
    complaints.within("the coupling's damping", c.damping, coupling_bounds::damping, " N s/m");
    complaints.within("the coupling's angular damping", c.angular_damping, coupling_bounds::angular_damping,
                      " N m s/rad");
    complaints.within("the coupling's largest force", c.max_force, coupling_bounds::max_force, " N");
    complaints.within("the coupling's largest torque", c.max_torque, coupling_bounds::max_torque, " N m");
    complaints.within("the coupling's largest speed", c.max_speed, coupling_bounds::max_speed, " m/s");
    complaints.within("the coupling's largest spin", c.max_spin, coupling_bounds::max_spin, " rad/s");
}

}  // namespace

std::vector<std::string> SceneSpec::validate() const {
    std::vector<std::string> wrong = solver.validate();
    auto need = [&](bool ok, const std::string& sentence) {
        if (!ok) wrong.push_back(sentence);
    };
    for (const FingerSpec& f : fingers) {
        Complaints c{wrong, "finger '" + f.name + "': "};
        check_tissue(f, c);
        check_coupling(f.coupling, c);
    }
    for (const ObjectSpec& o : objects) {
        if (!o.tissue) continue;
        Complaints c{wrong, "object '" + o.name + "': "};
        check_tissue(*o.tissue, c);
        c.need(!o.body, c.who + "a soft object is held by its fixed part: it cannot have a mass that forces move");
    }
    need(friction_bounds.holds(skin_friction), "the friction of skin on skin must be between 0 and 100");
    for (const ObjectSpec& o : objects)
        need(friction_bounds.holds(o.friction), "object '" + o.name + "': friction must be between 0 and 100");
    for (const FingerFriction& f : finger_frictions)
        need(f.finger >= 0 && f.finger < int(fingers.size()) && f.object >= 0 && f.object < int(objects.size()) &&
                 friction_bounds.holds(f.friction),
             "a friction of a finger against an object must name one of each, and be between 0 and 100");
    for (const ThimbleSpec& t : thimbles) {
        need(t.finger >= 0 && t.finger < int(fingers.size()), "a thimble names a finger that does not exist");
        for (const auto& sentence : palpate::validate(t.model))
            wrong.push_back("device of finger '" +
                            (t.finger >= 0 && t.finger < int(fingers.size()) ? fingers[t.finger].name : "?") +
                            "': " + sentence);
    }
    return wrong;
}

}  // namespace palpate
