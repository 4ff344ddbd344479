// The end of the bodies' step: velocities, statuses, bounces, sleep.

#include <algorithm>
#include <cmath>

#include "engine/bodies/anchors.h"
#include "engine/bodies/islands.h"
#include "engine/contact/fitted.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/solve/progress.h"
#include "engine/systems.h"

namespace palpate {

namespace {

using Work = BodyWork;

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
        b.velocity_before = body.velocity, b.momentum_before = body.angular_momentum;
        if (body.asleep) {
            body.iterations = 0;
            continue;
        }
        const detail::LaneProgress<double>& p = w.s.islands[b.island].progress;
        body.iterations = int(p.iterations);
        body.converged = p.converged;
        const double moment_left = b.gradient.tail<3>().norm();
        // Nothing acts on it: what the solve has left of its turn is not taken from its angular momentum.
        if (p.converged && (b.inertia.gradient - b.gradient).isZero(0))
            b.inertia.gradient.tail<3>().setZero(), b.gradient.tail<3>().setZero();
        const Vec3<double> displacement = b.pose.position - b.start.position;
        body.reset = !std::isfinite(dot(displacement, displacement) + b.gradient.squaredNorm() + b.pose.rotation.w);
        if (body.reset) {
            b.pose = b.start;
            body.velocity = body.angular_momentum = body.contact_force = body.contact_torque = body.acceleration = {};
        } else {
            const Motion contact = b.inertia.gradient - b.gradient;
            const double share = std::max(fitted::own_residual, 3 * w.solver.tolerance);
            const double force = contact.head<3>().norm();
            body.converged &= b.gradient.head<3>().norm() <= std::max(share * force, fitted::own_rounding);
            // Its moment, too: what is balanced to a hair's breadth may be left turned.
            const double moment = std::max(force * body.size, contact.tail<3>().norm());
            body.converged &= moment_left <= std::max(share * moment, fitted::own_rounding * body.size);
            const Vec3<double> before = body.velocity;
            body.velocity = (1 / w.solver.dt) * displacement;
            if (b.flies) body.velocity += (0.5 * w.solver.dt / body.mass) * b.weight;
            body.acceleration = (1 / w.solver.dt) * (body.velocity - before);
            for (int k = 0; k < 3; ++k) {
                body.contact_force[k] = contact[k];
                body.contact_torque[k] = contact[3 + k];
                body.angular_momentum[k] += w.solver.dt * b.inertia.gradient[3 + k];
            }
            if (!w.solver.inertia) end_static_body(w, body, b);
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
/// make of an overlap that is still there would be the next step's load. Nor are they what is reported (1e7 N on a box
/// of 4 g in a falling tower, steps of 20 ms: random scene 1293977).
void forget_no_results(Work& w) {
    auto is_none = [&](int object) {
        const int body = w.s.objects[object].body;
        return body >= 0 && misses_what_acted(w.bodies[body], w.s.bodies[body], fitted::no_load);
    };
    for (BodyPair& p : w.s.pairs)
        if (p.a >= 0 && (is_none(p.a) || is_none(p.b)))
            for (FeatureContact& c : p.contacts)
                c.normal_multiplier = c.friction_radius = 0, c.tangential_multiplier = {0, 0, 0};
    if (!w.solver.inertia) return;
    for (std::size_t row = 0; row < w.bodies.size(); ++row)
        if (misses_what_acted(w.bodies[row], w.s.bodies[row], fitted::no_load))
            report_what_acted(w, w.bodies[row], w.s.bodies[row]);
}

}  // namespace

void end_body_step(BodyWork& w) {
    end_lanes(w);
    for (std::size_t k = 0; k < w.pairs.near.size(); ++k) w.pairs.near[k].pose = w.s.bodies[w.bodies.size() + k].pose;
    if (!w.solver.inertia) find_gripped(w);
    end_bodies(w);
    brake_recovery(w);
    brake_gains(w);
    keep_momentum(w);
    bounce(w);
    forget_no_results(w);
    put_to_sleep(w);
}

void end_objects(Table<VirtualObject>& shapes) {
    for (VirtualObject& shape : shapes) shape.previous = shape.pose;
}

}  // namespace palpate
