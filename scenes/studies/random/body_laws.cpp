#include "scenes/studies/random/body_laws.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "engine/bodies/body_contact.h"
#include "engine/bodies/fitted.h"
#include "engine/contact/fitted.h"
#include "scenes/run/grasp.h"
#include "scenes/studies/random/finger_laws.h"

namespace palpate {

namespace {

double turning_energy(const RigidBody& b, const Pose<double>& centre) {
    return 0.5 * dot(angular_velocity(b, centre.rotation), b.angular_momentum);
}

/// The turn from one rotation to another [rad].
Vec3<double> turn_between(const Quaternion<double>& from, const Quaternion<double>& to) {
    const Quaternion<double> q = to * conjugate(from);
    const double sine = norm(q.vector()), angle = 2 * std::atan2(sine, std::abs(q.w));
    return sine > 0 ? ((q.w < 0 ? -1 : 1) * angle / sine) * q.vector() : Vec3<double>{0, 0, 0};
}

/// The least of a body's moments of inertia [kg m^2].
double least_moment(const RigidBody& b) {
    Eigen::Matrix3d inertia;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) inertia(i, j) = b.inertia[i][j];
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    return solver.computeDirect(inertia, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
}

bool any_bounces(const World& w) {
    return std::any_of(w.bodies.begin(), w.bodies.end(), [](const RigidBody& b) { return b.restitution > 0; });
}

/// Whether an object overlapped another so deep before this step that it is taken out of it.
bool was_in_another(const Watched& v, int object) {
    const int n = int(v.s.world.shapes.size());
    for (int other = 0; other < n && !v.overlaps.empty(); ++other) {
        const int low = std::min(object, other), high = std::max(object, other);
        if (low != high && v.overlaps[std::size_t(low * n + high)].depth > 0.5 * fitted::overlap_ends) return true;
    }
    return false;
}

/// Whether fingers alone touch an object, each with friction to spare, and did in the step before. What slides or rolls
/// over something that is curved is pushed along its way by the contact at the end of a step, and what that gives it is
/// taken from its motion (brake_gain.cpp); what sticks has none of it.
bool sticks_to_fingers(const Watched& v, int object) {
    const World& w = v.s.world;
    const RigidBody& b = w.bodies[std::size_t(w.shapes[std::size_t(object)].body)];
    Vec3<double> others = b.contact_force;
    bool held = false;
    for (std::size_t i = 0; i < v.fingers.size(); ++i)
        for (const ObjectContact& o : v.fingers[i].objects) {
            if (o.object != object || o.normal_force <= 0) continue;
            if (v.before.empty() || !v.fingers[i].status.converged || !v.before[i].status.converged) return false;
            if (!sticks(o) || !stuck_before(v.before[i], o)) return false;
            others += o.force;
            held = true;
        }
    return held && norm(others) < 1e-2 * norm(b.contact_force);
}

/// Less is left by solves that end early, and is no overlap that is undone [m].
double overlap_allowed(const World& w) { return fitted::overlap_begins + 3 * w.solver.contact_tolerance; }

/// How deep features of one object lie in another, as their contact is decided; below zero: how far from it [m].
double feature_depth(const VirtualObject& a, const VirtualObject& b) {
    double depth = -1;
    for (const Feature& f : features_of(a.shape, b.shape.kind == ShapeKind::plane)) {
        depth = std::max(depth, -touch_of(f, a.pose, {}, b.shape, b.pose, 0).surface.distance);
    }
    return depth;
}

/// How deep two objects lie in each other now [m].
double depth_now(const Watched& v, int a, int b) {
    const VirtualObject &one = v.s.world.shapes[std::size_t(a)], &other = v.s.world.shapes[std::size_t(b)];
    return std::max(feature_depth(one, other), feature_depth(other, one));
}

}  // namespace

void see_bodies(Watched& v) {
    const World& w = v.s.world;
    v.bodies_before = std::move(v.bodies);
    v.bodies.assign(w.bodies.size(), {});
    for (std::size_t o = 0; o < w.shapes.size(); ++o) {
        const VirtualObject& shape = w.shapes[o];
        const int row = shape.body >= 0 ? shape.body : shape.held_body;
        if (row < 0) continue;
        const RigidBody& b = w.bodies[std::size_t(row)];
        v.bodies[std::size_t(row)] = {int(o), centre_pose(b, shape.pose), b.velocity, b.angular_momentum,
                                      shape.body >= 0 && !b.asleep};
    }
}

void check_flight(Watched& v, Findings& found) {
    const World& w = v.s.world;
    const double dt = w.solver.dt;
    v.flying_energy.resize(v.bodies.size(), -1);
    for (std::size_t row = 0; row < v.bodies.size() && !v.bodies_before.empty(); ++row) {
        const RigidBody& b = w.bodies[row];
        const BodyState &now = v.bodies[row], &before = v.bodies_before[row];
        double& energy = v.flying_energy[row];
        const bool flies = now.moves && before.moves && b.converged && !b.reset &&
                           dot(b.contact_force, b.contact_force) <= 0 && dot(b.contact_torque, b.contact_torque) <= 0;
        if (!flies) {
            energy = -1;
            continue;
        }
        RigidBody then = b;
        then.angular_momentum = before.angular_momentum;
        if (energy < 0) energy = turning_energy(then, before.centre);
        // As much as the solve may leave of its weight; of fingers in single precision that it flies among, more.
        const double rounded = w.chunks.floats.empty() ? 0 : fitted::own_rounding / b.mass;
        const double fall = dt * norm(w.gravity),
                     left = 1.1 * std::max(fitted::unbalanced_weight * 9.81, rounded) * dt + 1e-12;
        const double speed = norm(now.velocity - before.velocity - dt * w.gravity);
        // Near what it may touch as implicit Euler says, elsewhere along its parabola.
        const Vec3<double> moved = now.centre.position - before.centre.position;
        const double aside =
            std::min(norm(moved - dt * now.velocity), norm(moved - (0.5 * dt) * (now.velocity + before.velocity)));
        const double spin = norm(now.angular_momentum - before.angular_momentum);
        const double kick = b.mass * b.size * left;  // as much angular momentum as the solve may leave, in every step
        const std::string& name = w.shapes[std::size_t(now.object)].name;
        if (speed > left + 1e-9 * fall || aside > dt * left + 1e-9 * (norm(now.centre.position) + 1e-3))
            found.add("what nothing touches falls freely",
                      law_text("%.4f s: %s: %.3g m/s faster than gravity makes it, %.3g mm beside its way", w.time,
                               name.c_str(), speed, 1e3 * aside));
        if (spin > kick + 1e-9 * norm(before.angular_momentum))
            found.add("what nothing touches keeps its angular momentum",
                      law_text("%.4f s: %s: %.3g of %.3g kg m^2/s", w.time, name.c_str(), spin,
                               norm(before.angular_momentum)));
        const Vec3<double> first = angular_velocity(then, before.centre.rotation),
                           last = angular_velocity(b, now.centre.rotation);
        // The midpoint rule is of second order, and so is the mean of both: what is left is of the third in how far the
        // body turns about where it turns fastest, which is how fast its axes go round in a step.
        const double turn = dt * std::max(norm(first), norm(last)),
                     round = dt * norm(b.angular_momentum) / least_moment(b);
        const double off = norm(turn_between(before.centre.rotation, now.centre.rotation) - 0.5 * dt * (first + last));
        if (off > 0.5 * turn * round * round + 1e-7 + dt * kick / least_moment(b))
            found.add("what nothing touches turns as it spins",
                      law_text("%.4f s: %s: %.3g of %.3g rad in a step", w.time, name.c_str(), off, turn));
        const double most = std::sqrt(energy) + kick / std::sqrt(2 * least_moment(b));
        energy = most * most;
        if (turning_energy(b, now.centre) > energy * (1 + round * round + 1e-6) + 1e-15)
            found.add("what nothing touches gains no energy",
                      law_text("%.4f s: %s: %.6g J of turning, %.6g J before", w.time, name.c_str(),
                               turning_energy(b, now.centre), energy));
    }
}

void check_motion(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    if (v.bodies_before.empty() || any_bounces(w)) return;
    const double floor = w.chunks.floats.empty() ? fitted::own_rounding : 5 * fitted::own_rounding;
    for (std::size_t row = 0; row < v.bodies.size(); ++row) {
        const RigidBody& b = w.bodies[row];
        const BodyState &now = v.bodies[row], &before = v.bodies_before[row];
        if (!now.moves || !before.moves || !b.converged || b.reset) continue;
        if (was_in_another(v, now.object) || !sticks_to_fingers(v, now.object)) continue;
        const double rate = 1 / w.solver.dt;
        const Vec3<double> force = (rate * b.mass) * (now.velocity - before.velocity) - b.mass * w.gravity;
        const double off = norm(force - b.contact_force), size = norm(b.contact_force) + b.mass * norm(w.gravity);
        // A thousandth of its energy is known no better, either; nor is what contact gives to what turns far in a step,
        // which is taken away again (brake_gain.cpp): as much as an arc is longer than its chord.
        const double turn = norm(turn_between(before.centre.rotation, now.centre.rotation)),
                     arc = 0.5 * turn * turn * b.size * norm(b.contact_force),
                     moving = 0.5 * b.mass * dot(now.velocity, now.velocity) + turning_energy(b, now.centre);
        const double unknown = std::min(1.0, 1e-3 + arc / (arc + moving));
        const double left = std::max(fitted::own_residual, 3 * w.solver.tolerance) * size + floor +
                            unknown * rate * b.mass * (norm(now.velocity) + norm(before.velocity));
        const std::string& name = w.shapes[std::size_t(now.object)].name;
        if (off > left)
            found.add("bodies move with what is reported",
                      law_text("%.4f s: %s: %.4g N of %.4g N are not in its motion", w.time, name.c_str(), off, size));
        const Vec3<double> torque = rate * (now.angular_momentum - before.angular_momentum);
        const double spun = norm(now.angular_momentum) + norm(before.angular_momentum);
        if (norm(torque - b.contact_torque) > b.size * left + unknown * rate * spun)
            found.add("bodies turn with what is reported",
                      law_text("%.4f s: %s: %.4g Nmm of %.4g Nmm are not in its motion", w.time, name.c_str(),
                               1e3 * norm(torque - b.contact_torque), 1e3 * norm(b.contact_torque)));
    }
}

void see_overlaps(Watched& v) {
    const World& w = v.s.world;
    const int n = int(w.shapes.size());
    v.overlaps.resize(std::size_t(n) * std::size_t(n));
    auto rests = [&](int object) {
        const VirtualObject& o = w.shapes[std::size_t(object)];
        return o.body < 0 || w.bodies[std::size_t(o.body)].asleep;
    };
    auto settled = [&](int object) {
        const int body = w.shapes[std::size_t(object)].body;
        return body < 0 || (w.bodies[std::size_t(body)].converged && !w.bodies[std::size_t(body)].reset);
    };
    for (int a = 0; a < n; ++a)
        for (int b = a + 1; b < n; ++b) {
            if (w.shapes[std::size_t(a)].body < 0 && w.shapes[std::size_t(b)].body < 0) continue;
            if (w.shapes[std::size_t(a)].soft >= 0 || w.shapes[std::size_t(b)].soft >= 0) continue;
            PairOverlap& o = v.overlaps[std::size_t(a * n + b)];
            if (!(rests(a) && rests(b) && w.step > 1)) o.depth = depth_now(v, a, b);
            o.deepest = std::max(o.deepest, o.depth);
            if (o.depth <= overlap_allowed(w))
                o.since = -1;
            else if (o.since < 0)
                o.since = w.time;
            // Steps that say they have not converged promise nothing.
            else if (!settled(a) || !settled(b))
                o.since += w.solver.dt;
        }
}

/// Whether a body touches anything but one object.
constexpr double touching = 1e-5;  // [m]
bool touches_more(const Watched& v, std::size_t object, std::size_t but) {
    const std::size_t n = v.s.world.shapes.size();
    if (v.s.world.shapes[object].body < 0) return false;
    for (std::size_t i = 0; i < n; ++i)
        if (i != but && i != object && v.overlaps[std::min(i, object) * n + std::max(i, object)].depth > -touching)
            return true;
    return false;
}

void check_overlaps(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    const std::size_t n = w.shapes.size();
    for (std::size_t k = 0; k < v.overlaps.size(); ++k) {
        const PairOverlap& o = v.overlaps[k];
        if (touches_more(v, k / n, k % n) || touches_more(v, k % n, k / n)) continue;  // it may be squeezed
        const double time = 3 * o.deepest / w.solver.recovery_speed + 10 * w.solver.dt;
        if (o.since >= 0 && w.time - o.since > time)
            found.add("overlaps are undone",
                      law_text("%.4f s: %s and %s overlap by %.4g mm (%.4g mm at most), for %.3g s by now", w.time,
                               w.shapes[k / n].name.c_str(), w.shapes[k % n].name.c_str(), 1e3 * o.depth,
                               1e3 * o.deepest, w.time - o.since));
    }
}

double lifted_by_overlaps(const Watched& v) {
    double mass = 0, deep = 0;
    for (const RigidBody& b : v.s.world.bodies) mass += b.mass;
    for (const PairOverlap& o : v.overlaps) deep += o.deepest > overlap_allowed(v.s.world) ? o.deepest : 0;
    // What parts goes at the speed of recovery and rises by the overlap, or twice that where it turns about a corner or
    // leaves two overlaps (5201673).
    const double speed = deep > 0 ? 2 * v.s.world.solver.recovery_speed : 0;
    return mass * (norm(v.s.world.gravity) * 2 * deep + 0.5 * speed * speed);
}

/// Whether a hand let go of a body on purpose: since it gripped it most firmly, two of its fingers' bones have moved
/// apart, and the grip has fallen to less than a half. A step then ends what still had friction to spare (seeds
/// 2144490, 2148926). What slips out of bones that stay is no such thing.
bool hand_opened(const Simulation& s, std::size_t body) {
    constexpr double apart_mm = 0.2;
    const Series& b = s.body_series[body];
    const std::size_t fingers = s.fingers.size();
    const auto held = b.column("held");
    std::vector<std::vector<double>> grip;
    for (std::size_t i = 0; i < fingers; ++i) grip.push_back(b.column(s.scene.spec.fingers[i].name + "_grip_N"));
    auto total = [&](std::size_t row) {
        double sum = 0;
        for (const auto& g : grip) sum += g[row];
        return sum;
    };
    std::size_t last = 0, firmest = 0;
    for (std::size_t row = 0; row < held.size(); ++row) {
        if (held[row] <= 0) continue;
        last = row;
        if (total(row) > total(firmest)) firmest = row;
    }
    if (total(last) > 0.5 * total(firmest)) return false;
    auto distance = [&](std::size_t i, std::size_t j, std::size_t row) {
        double d = 0;
        for (const char* axis : {"bone_x_mm", "bone_y_mm", "bone_z_mm"})
            d = std::hypot(d, s.finger_series[i].column(axis)[row] - s.finger_series[j].column(axis)[row]);
        return d;
    };
    for (std::size_t i = 0; i < fingers; ++i)
        for (std::size_t j = 0; j < i; ++j)
            if (grip[i][firmest] > 0 && grip[j][firmest] > 0 &&
                distance(i, j, last) > distance(i, j, firmest) + apart_mm)
                return true;
    return false;
}

/// Whether two fingers ever gripped a body in the same step: one alone holds nothing, but may stop what flies, and what
/// rolls off one onto another (seed 1242751) is held by neither.
bool gripped_by_two(const Simulation& s, std::size_t body) {
    const Series& b = s.body_series[body];
    std::vector<int> grips(b.column("held").size(), 0);
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const auto grip = b.column(s.scene.spec.fingers[i].name + "_grip_N");
        for (std::size_t row = 0; row < grip.size(); ++row) grips[row] += grip[row] > 0;
    }
    return std::any_of(grips.begin(), grips.end(), [](int n) { return n >= 2; });
}

void check_drops(const Simulation& s, Findings& found) {
    const std::vector<BodySummary> bodies = summarise_bodies(s);
    for (std::size_t k = 0; k < bodies.size(); ++k) {
        const BodySummary& b = bodies[k];
        if (b.dropped_at_s < 0 || !gripped_by_two(s, k) || b.unsettled_steps > 0 || b.resets > 0 ||
            b.converged_share < 1 || hand_opened(s, k))
            continue;
        double used = 0;
        for (const GripSummary& g : b.grips) used = std::max(used, g.friction_use);
        // What has no friction has none to spare: pressed askew, it slips out (seed 2101647).
        for (std::size_t o = 0; o < s.world.shapes.size(); ++o)
            for (std::size_t i = 0; i < s.fingers.size() && s.world.shapes[o].name == b.name; ++i)
                for (const GripSummary& g : b.grips)
                    if (g.finger == s.scene.spec.fingers[i].name && friction_between(s, i, o) <= 0) used = 1;
        if (used < 0.9)
            found.add("what is held is not dropped",
                      law_text("%.4f s: %s, with %.3g of the friction used", b.dropped_at_s, b.name.c_str(), used));
    }
}

}  // namespace palpate
