#include "scenes/load/load_solver.h"

#include <algorithm>

#include "scenes/load/presets.h"

namespace palpate {

namespace {

/// What is left out where a scene asks for levels of detail.
void read_level_of_detail(Section& s, SolverSettings& v) {
    using namespace solver_bounds;
    bool automatic = false;
    double tolerance = 0.02e-3, penetration = 0.1e-3, error = 0.01;
    int level = 0;
    s.choice({"level_of_detail", "detail"}, level, {"full", "auto"},
             "\"auto\" leaves out what adds less than the three errors below; \"full\" computes everything.");
    automatic = level == 1;
    s.number(
        {"level_of_detail_tolerance_mm", "detail_tolerance_mm"}, tolerance, unit::mm, in(unit::mm, detail_tolerance),
        "With \"auto\": skin near no object, and off its rest shape by less than this, moves with its bone as one. "
        "0: never.");
    s.number({"level_of_detail_penetration_mm", "detail_penetration_mm"}, penetration, unit::mm,
             in(unit::mm, detail_penetration),
             "With \"auto\": samples between nodes count only where they would be deeper in an object than this. 0: "
             "always.");
    s.number({"level_of_detail_error", "detail_error"}, error, unit::one, detail_error,
             "With \"auto\": tissue stays linear while this adds no larger an error, relative to the contact force. 0: "
             "never.");
    v.detail_tolerance = automatic ? tolerance : 0;
    v.detail_error = automatic ? error : 0;
    v.detail_penetration = automatic ? penetration : 0;
}

/// What nothing is said of: grasps on fingers whose elements share changes of volume, but have limits of their own, do
/// not come to rest without it; on others it costs time and changes little (bench/README.md, "Meshes").
int steadying_where_needed(const Scene& scene) {
    constexpr int enough = 8;
    const auto& fingers = scene.spec.fingers;
    const bool patched = std::any_of(fingers.begin(), fingers.end(), [](const FingerSpec& f) {
        return !f.mesh.patches.empty() && f.mesh.limit_patches.empty();
    });
    return patched ? enough : 0;
}

}  // namespace

void read_solver(Section s, Scene& scene) {
    using namespace solver_bounds;
    SolverSettings& v = scene.spec.solver;
    s.choice(
        "preset", scene.preset, preset_names(),
        "Settings that belong together, from a step's lowest cost to its highest accuracy; the keys below override "
        "single ones.",
        {{"real-time", "balanced"}});
    apply_preset(scene.preset, v);
    v.steadying_iterations = steadying_where_needed(scene);
    s.number("deadline_ms", scene.deadline, unit::ms, {0, 1e4},
             "A step's iterations are cut short by this, and the next step has a lower preset; a higher one again "
             "when there is slack. 0: never.");
    s.integer("newton_iterations", v.newton_iterations, newton_iterations, "Most linear solves in one step.");
    if (s.has("newton_iterations")) v.unbalanced_share = 0;  // who asks for so many means them
    s.number(
        "unbalanced_share", v.unbalanced_share, unit::one, unbalanced_share,
        "Iterations after a step's first are spent only while more than this share of the contact force is "
        "unbalanced (of 0.33 N at least where a step is 1 ms or shorter, of as much less as it is longer, and of "
        "less in "
        "tissue softer than skin), or where "
        "a body or soft object is touched, which could be shaken. 0: all, until tolerances are met. Where nothing "
        "is said: 0.03 with preset \"fast\" and 0.003 with \"balanced\", and their own `newton_iterations`, else 0.");
    s.number("tolerance", v.tolerance, unit::one, tolerance, "Force residual, relative to the forces acting.");
    s.number("multiplier_tolerance", v.multiplier_tolerance, unit::one, multiplier_tolerance,
             "Change of contact forces and limit stresses that may be pending, relative to the forces acting.");
    s.number("multiplier_gate", v.multiplier_gate, unit::one, multiplier_gate,
             "Multipliers are updated once the residual is below this share of the change that the update brings.");
    s.integer("contact_iterations", v.contact_iterations, contact_iterations,
              "Most linear solves that follow contacts along one Newton direction.");
    s.number("contact_share", v.contact_share, unit::one, contact_share,
             "Contacts are followed while they leave more than this share of the residual.");
    s.integer("stiffness_steps", v.stiffness_steps, stiffness_steps,
              "Steps for which the tissue's part of a Newton matrix is kept where little changes: steps are then up to "
              "three times as fast, by the same forces. 1: assembled in every iteration.");
    s.integer(
        "steadying_iterations", v.steadying_iterations, steadying_iterations,
        "Most linear solves more in a step that would shake a body held by tissue at its strain limits, so that a "
        "grasp comes to rest. 0: none. Where nothing is said: 8 where a finger's mesh has patches but limits of "
        "elements, else 0. A step that `deadline_ms` sends to another preset has none.");
    s.integer("sample_refinement", v.sample_refinement, sample_refinement,
              "1: contact is decided at nodes; n: at n times as many points along every edge of the pad's faces. Soft "
              "objects in scenes with bodies have 3 at least.");
    s.number("limit_tolerance", v.limit_tolerance, unit::one, limit_tolerance,
             "Relative excess allowed over a strain limit.");
    s.number("contact_tolerance_um", v.contact_tolerance, unit::um, in(unit::um, contact_tolerance),
             "Penetration allowed.");
    s.number("recovery_speed_mm_per_s", v.recovery_speed, unit::mm_per_s, in(unit::mm_per_s, recovery_speed),
             "Speed at which objects that overlap part; it is no velocity afterwards.");
    s.number("sleep_speed_um_per_s", v.sleep_speed, unit::um_per_s, in(unit::um_per_s, sleep_speed),
             "A finger near no object that moves slower than this, and whose target is still, is skipped. 0: never.");
    read_level_of_detail(s, v);
    bool statics = !v.inertia;
    s.boolean("static", statics,
              "Static equilibrium in every step: no inertia, no damping, of bodies either. A body that nothing holds "
              "has none: "
              "it sinks a little in each step, which the summary says.");
    v.inertia = !statics;
    int precision = 0;
    s.choice("precision", precision, {"double", "float"}, "Arithmetic of the skin; \"float\" is faster.");
    for (FingerSpec& f : scene.spec.fingers) f.single_precision = precision == 1;
    s.finish();
}

}  // namespace palpate
