// The end of the bodies' step: velocities, statuses, bounces, sleep.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"
#include "engine/contact/fitted.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/solve/progress.h"
#include "engine/systems.h"

namespace palpate {

namespace {

using Work = BodyWork;

/// Velocity of an object's point at the end of the step [m/s].
Vec3<double> point_velocity(const Work& w, const ContactBody& o, const Vec3<double>& point) {
    if (o.body < 0) return (1 / w.solver.dt) * (o.pose.position - o.start.position);
    const RigidBody& body = w.bodies[o.body];
    return body.velocity + cross(angular_velocity(body, o.pose.rotation), point - o.centre);
}

/// What an impulse between two objects meets at a contact.
struct Blow {
    Vec3<double> normal, point;
    double speed;  ///< at which the objects part there [m/s]
    double give;   ///< change of that speed by a unit impulse [1/kg]
};
Blow blow_at(const Work& w, const BodyPair& p, const FeatureContact& c) {
    const ContactBody &a = w.s.objects[p.a], &b = w.s.objects[p.b];
    Blow out{rotation_matrix(b.pose.rotation) * c.normal_now, a.centre + c.terms[0].arm_of_a, 0, 0};
    out.speed = dot(point_velocity(w, a, out.point) - point_velocity(w, b, out.point), out.normal);
    for (const ContactBody* o : {&a, &b}) {
        if (o->body < 0) continue;
        RigidBody turned = w.bodies[o->body];
        const Vec3<double> arm = out.point - o->centre;
        turned.angular_momentum = cross(arm, out.normal);
        out.give += 1 / turned.mass + dot(cross(angular_velocity(turned, o->pose.rotation), arm), out.normal);
    }
    return out;
}

/// Pushes the two objects of a pair apart at a contact.
void push_apart(Work& w, const BodyPair& p, const Blow& at, double impulse) {
    for (auto [object, sign] : {std::pair{p.a, 1.0}, std::pair{p.b, -1.0}}) {
        const ContactBody& o = w.s.objects[object];
        if (o.body < 0) continue;
        RigidBody& body = w.bodies[o.body];
        body.velocity += (sign * impulse / body.mass) * at.normal;
        body.angular_momentum += cross(at.point - o.centre, (sign * impulse) * at.normal);
    }
}

bool is_recovering(const BodyPair& p) {
    return p.a >= 0 && std::any_of(p.contacts.begin(), p.contacts.end(),
                                   [](const FeatureContact& c) { return c.undone > 0 && c.normal_multiplier > 0; });
}

/// Whether the motion of a contact out of an overlap is to be braked: of one that pushes, and where the solve has ended
/// early, also of one that has been thrown too far to push any more. What such a motion pushes in its turn goes no
/// faster.
bool is_braked(Work& w, const BodyPair& p, const FeatureContact& c) {
    if (c.normal_multiplier > 0) return true;
    return c.undone > 0 && !island_of_pair(w, p).progress.converged;
}

/// The motion that undid overlaps is no velocity: takes its share of the speed at which objects part away again, by
/// impulses that pull (projected Gauss-Seidel; the nearest velocities, by kinetic energy, that part no faster, so that
/// none is gained).
void brake_recovery(Work& w) {
    if (!w.solver.inertia) return;
    auto for_each_recovering = [&](auto visit) {
        for (BodyPair& p : w.s.pairs)
            if (p.a >= 0 && island_of_pair(w, p).recovers)
                for (FeatureContact& c : p.contacts)
                    if (is_braked(w, p, c)) visit(p, c, blow_at(w, p, c));
    };
    bool any = false;
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[i].recovers = false;
    for (const BodyPair& p : w.s.pairs)
        if (p.a >= 0)
            for (const FeatureContact& c : p.contacts)
                if (c.undone > 0 && is_braked(w, p, c)) island_of_pair(w, p).recovers = any = true;
    if (!any) return;
    for_each_recovering([&](BodyPair& p, FeatureContact& c, const Blow& at) {
        c.brake = 0;
        c.parting = std::max(0.0, at.speed - c.undone / w.solver.dt);
        // Where a solve ends early, overlaps that contradict each other have thrown what was to be taken out of them.
        if (c.undone > 0 && !island_of_pair(w, p).progress.converged)
            c.parting = std::min(c.parting, std::max(0.0, -c.approach));
    });
    for (int sweep = 0; sweep < 30; ++sweep)
        for_each_recovering([&](BodyPair& p, FeatureContact& c, const Blow& at) {
            const double brake = std::min(0.0, c.brake + (c.parting - at.speed) / at.give);
            push_apart(w, p, at, brake - c.brake);
            c.brake = brake;
        });
}

double restitution_of(const Work& w, const BodyPair& p) {
    double restitution = 0;
    if (p.a < 0) return restitution;
    for (int object : {p.a, p.b})
        if (w.s.objects[object].body >= 0)
            restitution = std::max(restitution, w.bodies[w.s.objects[object].body].restitution);
    return restitution;
}

bool bounces(const FeatureContact& c) { return c.normal_multiplier > 0 && c.approach >= 0.05; }

/// Bounces: gives bodies back a share of the speed at which they met, by impulses that push (projected Gauss-Seidel:
/// the nearest velocities, by kinetic energy, that part so fast. Sums of impulses, not each addition, push: velocities
/// are then the same in whatever order contacts come).
void bounce(Work& w) {
    constexpr int most_sweeps = 200;
    constexpr double settled = 1e-7;  // [m/s]
    for (BodyPair& p : w.s.pairs)
        if (restitution_of(w, p) > 0)
            for (FeatureContact& c : p.contacts) c.bounce = 0;
    double change = 1;
    for (int sweep = 0; sweep < most_sweeps && change > settled; ++sweep) {
        change = 0;
        for (BodyPair& p : w.s.pairs) {
            const double restitution = restitution_of(w, p);
            if (restitution <= 0) continue;
            for (FeatureContact& c : p.contacts) {
                if (!bounces(c)) continue;
                const Blow at = blow_at(w, p, c);
                const double impulse = std::max(0.0, c.bounce + (restitution * c.approach - at.speed) / at.give);
                change = std::max(change, std::abs(impulse - c.bounce) * at.give);
                push_apart(w, p, at, impulse - c.bounce);
                c.bounce = impulse;
            }
        }
    }
}

/// Lanes of a failed island: those that are not finite; where all are, the fault is a body's.
unsigned failed_lanes(const Work& w, int coupled) {
    unsigned failed = 0;
    with_chunk(w, coupled, [&](auto& c, const auto&) {
        for (int lane = 0; lane < c.width; ++lane) {
            const int i = island_of(w, coupled, lane);
            if (i < 0 || !w.s.islands[i].progress.failed) continue;
            const LaneReport& r = c.exchange.lanes[lane];
            if (!std::isfinite(r.energy + r.residual + r.pending)) failed |= 1u << lane;
        }
    });
    return failed;
}

/// A finger that was reset presses on nothing; nor does any other, then, press on it.
void let_go_of_reset_fingers(Work& w) {
    if (w.pairs.near.empty()) return;
    auto was_reset = [&](int finger) {
        const Skin& skin = w.skins[std::size_t(finger)];
        return w.chunks.with(skin.single_precision, skin.chunk,
                             [&](auto& c) { return c.status[std::size_t(skin.lane)].reset; });
    };
    for (FingerPair& p : w.pairs.near) p.touching = p.touching && !was_reset(p.a) && !was_reset(p.b);
    for_each_lane(w, [&](auto& c, int lane, const Island&) {
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
            const LaneContact o = c.contacts.at(slot, lane);
            if (o.finger < 0 || !was_reset(o.finger)) continue;
            erase_contact(c, lane, slot);
            insert_contact(c, lane, slot, o);
        }
    });
}

void end_lanes(Work& w) {
    for (int k = 0; k < int(w.s.coupled.size()); ++k) {
        const unsigned failed = failed_lanes(w, k);
        with_chunk(w, k, [&](auto& c, const auto& kernel) {
            const unsigned converged = lanes_where(w, k, [](const Island& i) { return i.progress.converged; });
            const unsigned reset = kernel.end(c, w.solver, failed, converged);
            for (int lane = 0; lane < c.width; ++lane) {
                if (island_of(w, k, lane) < 0) continue;
                const LaneReport& r = c.exchange.lanes[lane];
                Evaluation<double> e;
                e.residual = r.residual, e.violation = r.violation, e.penetration = r.penetration;
                e.contact_force = r.contact_force, e.limited = r.limited;
                c.status[lane] = detail::status_of<double>(e, w.s.islands[island_of(w, k, lane)].progress, w.solver,
                                                           (reset >> lane) & 1u);
            }
            end_slots(c, w.solver);
            settle_lanes(c, w.solver);
        });
    }
    let_go_of_reset_fingers(w);
}

void end_bodies(Work& w) {
    for (std::size_t object = 0; object < w.shapes.size(); ++object) {
        VirtualObject& shape = w.shapes[object];
        if (shape.body < 0) continue;
        RigidBody& body = w.bodies[shape.body];
        BodyProgress& b = w.s.bodies[shape.body];
        if (body.asleep) {
            body.iterations = 0;
            continue;
        }
        const detail::LaneProgress<double>& p = w.s.islands[b.island].progress;
        body.iterations = int(p.iterations);
        body.converged = p.converged;
        const Vec3<double> way = b.pose.position - b.start.position;
        body.reset = !std::isfinite(dot(way, way) + b.gradient.squaredNorm() + b.pose.rotation.w);
        if (body.reset) {
            b.pose = b.start;
            body.velocity = body.angular_momentum = body.contact_force = body.contact_torque = body.acceleration = {};
        } else {
            const Motion contact = b.inertia.gradient - b.gradient;
            const double share = std::max(fitted::own_residual, 3 * w.solver.tolerance);
            body.converged &=
                b.gradient.head<3>().norm() <= std::max(share * contact.head<3>().norm(), fitted::own_rounding);
            const Vec3<double> before = body.velocity;
            body.velocity = (w.solver.inertia ? 1 / w.solver.dt : 0) * way;
            body.acceleration = (1 / w.solver.dt) * (body.velocity - before);
            for (int k = 0; k < 3; ++k) {
                body.contact_force[k] = contact[k];
                body.contact_torque[k] = contact[3 + k];
                body.angular_momentum[k] += w.solver.inertia ? w.solver.dt * b.inertia.gradient[3 + k] : 0;
            }
        }
        shape.pose = object_pose(body, b.pose);
    }
}

/// Bodies whose whole island has been at rest for a while, without a finger near, fall asleep.
void put_to_sleep(Work& w) {
    for (int i = 0; i < w.s.island_count; ++i) {
        Island& island = w.s.islands[i];
        bool still = island.progress.converged && w.solver.inertia && w.solver.sleep_speed > 0;
        for (int b : island.bodies) {
            if (is_plane(w, b)) continue;
            const RigidBody& body = w.bodies[b];
            const double spin = norm(angular_velocity(body, w.s.bodies[b].pose.rotation));
            still = still && norm(body.velocity) + spin * body.size < w.solver.sleep_speed;
        }
        island.following = still;
    }
    for_each_lane(w, [](auto&, int, Island& i) { i.following = false; });
    for (const BodyPair& p : w.s.pairs)
        if (is_recovering(p)) island_of_pair(w, p).following = false;
    for (const BodyPair& p : w.s.pairs)  // on something that moves
        if (p.a >= 0)
            for (int object : {p.a, p.b})
                if (w.shapes[object].body < 0 && !w.s.objects[object].still) island_of_pair(w, p).following = false;
    for (int i = 0; i < w.s.island_count; ++i)
        for (int b : w.s.islands[i].bodies) {
            if (is_plane(w, b)) continue;
            RigidBody& body = w.bodies[b];
            body.still_steps = w.s.islands[i].following ? body.still_steps + 1 : 0;
            body.asleep = body.still_steps >= fitted::steps_to_sleep;
            if (body.asleep) body.velocity = body.angular_momentum = body.acceleration = {0, 0, 0};
        }
}

/// Forces that are no result are no load to begin the next step with, either: penalties grow with loads, and what those
/// make of an overlap that is still there would be the next step's load.
void forget_no_results(Work& w) {
    auto is_none = [&](int object) {
        const int body = w.s.objects[object].body;
        return body >= 0 && misses_what_acted(w.bodies[body], w.s.bodies[body], fitted::no_load);
    };
    for (BodyPair& p : w.s.pairs)
        if (p.a >= 0 && (is_none(p.a) || is_none(p.b)))
            for (FeatureContact& c : p.contacts)
                c.normal_multiplier = c.friction_radius = 0, c.tangential_multiplier = {0, 0, 0};
}

}  // namespace

void end_body_step(BodyWork& w) {
    end_lanes(w);
    for (std::size_t k = 0; k < w.pairs.near.size(); ++k) w.pairs.near[k].pose = w.s.bodies[w.bodies.size() + k].pose;
    end_bodies(w);
    brake_recovery(w);
    brake_gains(w);
    bounce(w);
    forget_no_results(w);
    put_to_sleep(w);
}

void end_objects(Table<VirtualObject>& shapes) {
    for (VirtualObject& shape : shapes) shape.previous = shape.pose;
}

}  // namespace palpate
