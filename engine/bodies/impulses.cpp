// Impulses between objects at the end of a step: those that take the motion away by which overlaps were undone, and
// bounces with their friction.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"

namespace palpate {

namespace {

using Work = BodyWork;

/// Projected Gauss-Seidel: most sweeps over contacts, and the change of speeds at which it ends [m/s].
constexpr int most_sweeps = 200;
constexpr double settled = 1e-7;

/// A contact at the end of the step, as impulses see it.
struct Blow {
    const ContactBody *a, *b;
    Vec3<double> normal;        ///< of b
    Vec3<double> arm_a, arm_b;  ///< from the centres of mass to where they touch [m]
};
Blow blow_at(const Work& w, const BodyPair& p, const FeatureContact& c) {
    const ContactBody &a = w.s.objects[p.a], &b = w.s.objects[p.b];
    return {&a, &b, rotation_matrix(b.pose.rotation) * c.normal_now, c.terms[0].arm_of_a, c.terms[0].arm_of_b};
}

/// Angular velocity of a body with another angular momentum.
Vec3<double> spin_with(const RigidBody& body, const Vec3<double>& momentum, const ContactBody& o) {
    RigidBody turned = body;
    turned.angular_momentum = momentum;
    return angular_velocity(turned, o.pose.rotation);
}

/// Velocity of an object's point: now, or of bodies, before this step's contacts [m/s].
enum class When { before, now };
Vec3<double> point_velocity(const Work& w, const ContactBody& o, const Vec3<double>& arm, When when) {
    if (o.body < 0) {
        const Vec3<double> point = o.centre + arm;
        return (1 / w.solver.dt) * (point - transform(o.start, inverse_transform(o.pose, point)));
    }
    const RigidBody& body = w.bodies[o.body];
    const BodyProgress& b = w.s.bodies[o.body];
    if (when == When::before) return b.velocity_before + cross(spin_with(body, b.momentum_before, o), arm);
    return body.velocity + cross(angular_velocity(body, o.pose.rotation), arm);
}

/// Velocity of a's point relative to b's [m/s].
Vec3<double> parting(const Work& w, const Blow& at, When when) {
    return point_velocity(w, *at.a, at.arm_a, when) - point_velocity(w, *at.b, at.arm_b, when);
}

/// Change of the speed at which the objects part along a direction, by a unit impulse along it [1/kg].
double give_along(const Work& w, const Blow& at, const Vec3<double>& direction) {
    double give = 0;
    for (auto [o, arm] : {std::pair{at.a, at.arm_a}, std::pair{at.b, at.arm_b}}) {
        if (o->body < 0) continue;
        const RigidBody& body = w.bodies[o->body];
        const Vec3<double> turn = spin_with(body, cross(arm, direction), *o);
        give += 1 / body.mass + dot(cross(turn, arm), direction);
    }
    return give;
}

/// Pushes a with an impulse, and b against it.
void push(Work& w, const Blow& at, const Vec3<double>& impulse) {
    for (auto [o, arm, sign] : {std::tuple{at.a, at.arm_a, 1.0}, std::tuple{at.b, at.arm_b, -1.0}}) {
        if (o->body < 0) continue;
        RigidBody& body = w.bodies[o->body];
        body.velocity += (sign / body.mass) * impulse;
        body.angular_momentum += sign * cross(arm, impulse);
    }
}

/// Sweeps over pairs of objects, of each island until its speeds change no more: what is far away makes no difference.
/// sweep(pair) returns by how much speeds changed [m/s].
template <class Sweep>
void settle(Work& w, Sweep sweep) {
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[i].speed_change = HUGE_VAL;
    for (int k = 0; k < most_sweeps; ++k) {
        bool any = false;
        for (int i = 0; i < w.s.island_count; ++i) {
            Island& island = w.s.islands[i];
            island.settling = island.speed_change > settled;
            island.speed_change = 0;
            any |= island.settling;
        }
        if (!any) return;
        for (BodyPair& p : w.s.pairs) {
            if (p.a < 0) continue;
            Island& island = island_of_pair(w, p);
            if (island.settling) island.speed_change = std::max(island.speed_change, sweep(p));
        }
    }
}

// --- What undoes overlaps ---

/// Whether the motion of a contact out of an overlap is to be braked: of one that pushes, and where the solve has ended
/// early, also of one that has been thrown too far to push any more. What such a motion pushes in its turn goes no
/// faster.
bool is_braked(Work& w, const BodyPair& p, const FeatureContact& c) {
    if (c.normal_multiplier > 0) return true;
    return c.undone > 0 && !island_of_pair(w, p).progress.converged;
}

// --- Bounces ---

double restitution_of(const Work& w, const BodyPair& p) {
    double restitution = 0;
    if (p.a < 0) return restitution;
    for (int object : {p.a, p.b})
        if (w.s.objects[object].body >= 0)
            restitution = std::max(restitution, w.bodies[w.s.objects[object].body].restitution);
    return restitution;
}

/// Speed at which a contact that pushes met, along the normal that its impulses have: along that of the start, balls
/// that meet obliquely gained energy, always. 0: it does not bounce [m/s].
double speed_of_approach(const Work& w, const FeatureContact& c, const Blow& at) {
    if (!(c.normal_multiplier > 0)) return 0;
    const double speed = -dot(parting(w, at, When::before), at.normal);
    return speed >= fitted::least_bounce ? speed : 0;
}

/// Sets out the bounces of a step. Whether there are any.
bool begin_bounces(Work& w) {
    bool any = false;
    for (BodyPair& p : w.s.pairs) {
        const double restitution = restitution_of(w, p);
        if (restitution <= 0) continue;
        for (FeatureContact& c : p.contacts) {
            c.bounce = 0, c.bounce_friction = {0, 0, 0};
            c.parting = restitution * speed_of_approach(w, c, blow_at(w, p, c));
            any |= c.parting > 0;
        }
    }
    return any;
}

/// One contact's impulses, towards the speed at which it is to part, and against its slip. Returns by how much speeds
/// changed [m/s].
double bounce_once(Work& w, const BodyPair& p, FeatureContact& c) {
    const Blow at = blow_at(w, p, c);
    const double speed = dot(parting(w, at, When::now), at.normal), give = give_along(w, at, at.normal);
    const double impulse = std::max(0.0, c.bounce + (c.parting - speed) / give);
    double change = std::abs(impulse - c.bounce) * give;
    push(w, at, (impulse - c.bounce) * at.normal);
    c.bounce = impulse;
    if (p.friction <= 0) return change;
    const Vec3<double> velocity = parting(w, at, When::now), slip = velocity - dot(velocity, at.normal) * at.normal;
    const double slips = norm(slip), largest = p.friction * c.bounce;
    Vec3<double> friction = c.bounce_friction;
    const double give_slip = slips > 0 ? give_along(w, at, (1 / slips) * slip) : 1;
    if (slips > 0) friction -= (1 / give_slip) * slip;
    if (const double size = norm(friction); size > largest) friction = (largest / size) * friction;
    const Vec3<double> more = friction - c.bounce_friction;
    push(w, at, more);
    c.bounce_friction = friction;
    return std::max(change, norm(more) * give_slip);
}

/// Energy of motion of an island's bodies with a share of what bounces changed: energy + share (linear + share square).
struct BounceEnergy {
    double before = 0, linear = 0, square = 0, allowed = 0;  ///< [J]
};

/// Newton's law of restitution and Coulomb's of friction may together give more energy than they found (Kane and
/// Levinson 1985), and what has turned within the step meets another way than it came. Of what they change, bodies get
/// the share that gives them no more than they had.
void keep_energy(Work& w, const Island& island) {
    BounceEnergy e;
    for (int row : island.bodies) {
        if (row >= int(w.bodies.size())) continue;
        const RigidBody& body = w.bodies[row];
        const BodyProgress& b = w.s.bodies[row];
        const Vec3<double> dv = body.velocity - b.velocity_unbounced, dL = body.angular_momentum - b.momentum_unbounced;
        RigidBody unbounced = body, change = body;
        unbounced.velocity = b.velocity_unbounced, unbounced.angular_momentum = b.momentum_unbounced;
        change.velocity = dv, change.angular_momentum = dL;
        e.before += kinetic_energy(unbounced, b.pose.rotation);
        e.square += kinetic_energy(change, b.pose.rotation);
        e.linear += body.mass * dot(b.velocity_unbounced, dv) + dot(angular_velocity(unbounced, b.pose.rotation), dL);
        e.allowed += b.kinetic + dot(b.weight, b.pose.position - b.start.position);
    }
    const double spare = std::max(0.0, e.allowed - e.before);
    if (e.linear + e.square <= spare + 1e-12 * e.before || e.square <= 0) return;
    const double share =
        std::clamp((-e.linear + std::sqrt(e.linear * e.linear + 4 * e.square * spare)) / (2 * e.square), 0.0, 1.0);
    for (int row : island.bodies) {
        if (row >= int(w.bodies.size())) continue;
        RigidBody& body = w.bodies[row];
        const BodyProgress& b = w.s.bodies[row];
        body.velocity = b.velocity_unbounced + share * (body.velocity - b.velocity_unbounced);
        body.angular_momentum = b.momentum_unbounced + share * (body.angular_momentum - b.momentum_unbounced);
    }
}

}  // namespace

void mark_driven(BodyWork& w) {
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[i].driven = false;
    for (const BodyPair& p : w.s.pairs)
        if (p.a >= 0)
            for (int object : {p.a, p.b})
                if (w.s.objects[object].body < 0 && !w.s.objects[object].still) island_of_pair(w, p).driven = true;
}

bool is_recovering(const BodyPair& p) {
    return p.a >= 0 && std::any_of(p.contacts.begin(), p.contacts.end(),
                                   [](const FeatureContact& c) { return c.undone > 0 && c.normal_multiplier > 0; });
}

void brake_recovery(BodyWork& w) {
    if (!w.solver.inertia) return;
    auto for_each_recovering = [&](BodyPair& p, auto visit) {
        if (!island_of_pair(w, p).recovers) return;
        for (FeatureContact& c : p.contacts)
            if (is_braked(w, p, c)) {
                const Blow at = blow_at(w, p, c);
                visit(c, at, dot(parting(w, at, When::now), at.normal));
            }
    };
    bool any = false;
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[i].recovers = false;
    for (const BodyPair& p : w.s.pairs)
        if (p.a >= 0)
            for (const FeatureContact& c : p.contacts)
                if (c.undone > 0 && is_braked(w, p, c)) island_of_pair(w, p).recovers = any = true;
    if (!any) return;
    for (BodyPair& p : w.s.pairs)
        if (p.a >= 0)
            for_each_recovering(p, [&](FeatureContact& c, const Blow&, double speed) {
                c.brake = 0;
                c.parting = std::max(0.0, speed - c.undone / w.solver.dt);
                // Where a solve ends early, overlaps that contradict each other have thrown what was to be taken out of
                // them.
                if (c.undone > 0 && !island_of_pair(w, p).progress.converged)
                    c.parting = std::min(c.parting, std::max(0.0, -c.approach));
            });
    settle(w, [&](BodyPair& p) {
        double change = 0;
        for_each_recovering(p, [&](FeatureContact& c, const Blow& at, double speed) {
            const double give = give_along(w, at, at.normal);
            const double brake = std::min(0.0, c.brake + (c.parting - speed) / give);
            change = std::max(change, std::abs(brake - c.brake) * give);
            push(w, at, (brake - c.brake) * at.normal);
            c.brake = brake;
        });
        return change;
    });
}

void bounce(BodyWork& w) {
    if (!w.solver.inertia || !begin_bounces(w)) return;
    for (std::size_t row = 0; row < w.bodies.size(); ++row) {
        BodyProgress& b = w.s.bodies[row];
        b.velocity_unbounced = w.bodies[row].velocity, b.momentum_unbounced = w.bodies[row].angular_momentum;
    }
    settle(w, [&](BodyPair& p) {
        double change = 0;
        if (restitution_of(w, p) > 0)
            for (FeatureContact& c : p.contacts)
                if (c.parting > 0) change = std::max(change, bounce_once(w, p, c));
        return change;
    });
    // Islands that something driven has met may have its energy.
    mark_driven(w);
    for (int i = 0; i < w.s.island_count; ++i)
        if (!w.s.islands[i].driven) keep_energy(w, w.s.islands[i]);
    // Bounces are forces of contact, too.
    for (std::size_t row = 0; row < w.bodies.size(); ++row) {
        RigidBody& body = w.bodies[row];
        const BodyProgress& b = w.s.bodies[row];
        const Vec3<double> more = (1 / w.solver.dt) * (body.velocity - b.velocity_unbounced);
        body.acceleration += more;
        body.contact_force += body.mass * more;
        body.contact_torque += (1 / w.solver.dt) * (body.angular_momentum - b.momentum_unbounced);
    }
}

}  // namespace palpate
