// Scenes of what hands do with things: lift, move and turn them, stack them, press firmly and come back.

#include "scenes/studies/random/random_handled.h"

#include <algorithm>
#include <cmath>

#include "scenes/studies/random/random_piles.h"

namespace palpate {

namespace {

/// The scene's first block: step and duration.
void set_time(RandomScene& s, double dt_ms, double duration) {
    s.blocks[0] = {line("dt_ms = %g", dt_ms), line("duration_s = %.4f", duration)};
}

/// A pose of a hand's track, turned about any axis.
std::string hand_key(double t, const double (&at)[3], const double (&turn)[3]) {
    return line("    { t_s = %.4f, position_mm = [%.2f, %.2f, %.2f], rotation_deg = [%.1f, %.1f, %.1f] },", t, at[0],
                at[1], at[2], turn[0], turn[1], turn[2]);
}

/// Lifts, moves aside and turns what is held, in any order but for the lift. Returns when it has ended [s].
double add_hand(Random& r, RandomScene& s, double height, double held, double dt_ms) {
    // The finer the step, the less is turned slowly: some hundred steps show what there is to see.
    const double slowest = std::clamp(0.12 * dt_ms, 0.35, 2.0);
    double t = held, at[3] = {0, 0, height}, turn[3] = {0, 0, 0};
    Block hand{"[hand]", "track = [", hand_key(0, at, turn), hand_key(t, at, turn)};
    at[2] += r.between(10, 60);
    hand.push_back(hand_key(t += r.between(0.1, 0.3), at, turn));
    const bool turns_first = r.chance(0.5);
    for (const bool turns : {turns_first, !turns_first}) {
        if (!turns && r.chance(0.5)) continue;
        if (turns && r.chance(0.15)) continue;
        if (!turns) {
            at[0] += r.between(-60, 60), at[1] += r.between(-60, 60);
            hand.push_back(hand_key(t += r.between(0.1, 0.3), at, turn));
            continue;
        }
        if (r.chance(0.6))
            turn[r.integer(0, 2)] = (r.chance(0.5) ? 1 : -1) * r.between(20, 180);
        else
            for (double& angle : turn) angle = r.between(-90, 90);
        hand.push_back(hand_key(t += r.between(0.3, slowest), at, turn));
    }
    hand.emplace_back("]");
    s.blocks.push_back(hand);
    return t;
}

/// Two fingers from two sides, or one from one side and two from the other, take a body of any kind and carry it.
void draw_handled_grasp(Random& r, RandomScene& s, int fingers) {
    const double steps_ms[] = {2, 5, 5, 10, 10, 10, 20};
    const double dt_ms = steps_ms[r.integer(0, 6)];
    const Solid solid = any_solid(r, s, 16, 34);
    s.blocks.push_back({"[[object]]", "name = \"table\"", "kind = \"plane\"", "friction = 0.5"});
    Block body = object("body", solid.keys, 0, 0, 0.5 * solid.height);
    body.push_back(line("mass_g = %.3f", r.log_between(5, 200)));
    body.push_back(line("friction = %.3f", r.between(0.3, 1.5)));
    s.blocks.push_back(body);
    const double close = r.between(0.06, 0.15), squeeze = r.between(0.5, 3), from = 0.5 * solid.width;
    const bool three = fingers > 2;
    const double end = add_hand(r, s, 0.5 * solid.height, close + r.between(0.02, 0.06), dt_ms);
    set_time(s, dt_ms, end + 0.03);
    for (int i = 0; i < (three ? 3 : 2); ++i) {
        const double side = i == 0 ? -1 : 1, x = !three || i == 0 ? r.between(-2, 2) : i == 1 ? -8.5 : 8.5;
        Block b = r.chance(0.3) ? any_finger(r, line("finger %d", i))
                                : finger(r, line("finger %d", i), random_scene_elements[r.integer(0, 2)]);
        b.emplace_back("track = [");
        b.push_back(keyframe(0, x, side * (from + 11), 0, -90 * side, 0));
        b.push_back(keyframe(close, x, side * (from + 7.5 - squeeze), 0, -90 * side, 0));
        b.emplace_back("]");
        s.blocks.push_back(b);
    }
}

/// Down onto something, held there or moved aside, and up again to rest in the air.
void add_visit(Random& r, Block& b, double y, double top, double duration) {
    const double x = r.between(-3, 3), above = top + r.between(11, 14), depth = r.between(0.3, 3.5);
    const double roll = r.between(-15, 15), pitch = r.between(-20, 20);
    b.emplace_back("track = [");
    b.push_back(keyframe(0, x, y, above, roll, pitch));
    b.push_back(keyframe(0.25 * duration, x, y, top + 8 - depth, roll, pitch));
    const double aside = r.chance(0.5) ? r.between(-5, 5) : 0;
    b.push_back(keyframe(0.45 * duration, x + aside, y, top + 8 - depth, roll, pitch));
    if (r.chance(0.7)) b.push_back(keyframe(0.6 * duration, x + aside, y, above, roll + r.between(-20, 20), pitch));
    b.emplace_back("]");
}

void add_visitors(Random& r, RandomScene& s, int fingers, double top, double duration) {
    for (int i = 0; i < fingers; ++i) {
        Block b = r.chance(0.5) ? any_finger(r, line("finger %d", i))
                                : finger(r, line("finger %d", i), random_scene_elements[r.integer(0, 2)]);
        add_visit(r, b, 26.0 * (i - 0.5 * (fingers - 1)), top, duration);
        s.blocks.push_back(b);
    }
}

/// Fingers that press on what is fixed, a mesh or not, or on a body on a table, and come back.
void draw_visits(Random& r, RandomScene& s, int fingers, double duration) {
    const Solid solid = any_solid(r, s, 14, 30);
    const bool body = r.chance(0.4);
    s.blocks.push_back({"[[object]]", "name = \"table\"", "kind = \"plane\"", "friction = 0.6"});
    Block b = object("thing", solid.keys, 0, 0, 0.5 * solid.height);
    add_matter(r, b, body, random_friction(r));
    s.blocks.push_back(b);
    add_visitors(r, s, std::min(fingers, body ? 1 : 2), solid.height, duration);
}

}  // namespace

Block any_coupling(Random& r) {
    Block b{"[coupling]", line("stiffness_N_per_mm = %.3f", r.log_between(0.5, 10000))};
    if (r.chance(0.4)) b.push_back(line("max_force_N = %.3f", r.log_between(0.3, 50)));
    if (r.chance(0.3)) b.push_back(line("angular_stiffness_Nm_per_rad = %.4f", r.log_between(0.05, 100)));
    if (r.chance(0.3)) b.push_back(line("max_torque_Nm = %.4f", r.log_between(0.01, 4)));
    if (r.chance(0.2)) b.push_back(line("damping_Ns_per_m = %.3f", r.log_between(0.5, 50)));
    return b;
}

void draw_handled(Random& r, RandomScene& s, int fingers) {
    const double steps_ms[] = {1, 2, 5, 10, 20};
    const double dt_ms = steps_ms[r.integer(0, 4)];
    const double duration = 1e-3 * dt_ms * r.integer(20, 60);
    if (r.chance(0.6)) s.blocks.push_back(any_coupling(r));
    set_time(s, dt_ms, duration);
    const std::string kind = r.one_of({"grasp", "grasp", "grasp", "stack", "stack", "stack", "overlap", "overlap",
                                       "visit", "visit", "carried", "flight"});
    if (kind == "grasp") draw_handled_grasp(r, s, fingers);
    if (kind == "stack") {
        const double top = draw_stack(r, s);
        if (r.chance(0.5)) add_visitors(r, s, 1, top, duration);
    }
    if (kind == "overlap") {
        set_time(s, dt_ms, 0.16 + 0.02 * dt_ms);  // until what lies 2 mm deep is out, three times
        draw_overlap(r, s);
    }
    if (kind == "visit") draw_visits(r, s, fingers, duration);
    if (kind == "carried") draw_carried(r, s, duration);
    if (kind == "flight") draw_flight(r, s);
    if (std::none_of(s.blocks.begin(), s.blocks.end(), [](const Block& b) { return b[0] == "[[finger]]"; })) {
        Block aside = finger(r, "finger 0", random_scene_elements[0]);  // no scene is without
        aside.push_back("track = [ { t_s = 0, position_mm = [500, 0, 500] } ]");
        s.blocks.push_back(aside);
    }
}

}  // namespace palpate
