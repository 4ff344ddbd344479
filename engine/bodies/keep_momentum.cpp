// Momentum of bodies that nothing but each other has touched. Speeds at the end of a step are ways over its length:
// what a solve that ended early has left of a way, or taken back, is lost, and so is what a guard against gained energy
// takes from one body alone. They are given back: together as if all were one rigid body, which no contact between them
// resists, with no more energy than there was.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"
#include "engine/bodies/pair_ends.h"
#include "engine/math/solve_definite.h"

namespace palpate {

namespace {

using Work = BodyWork;

/// Marks the islands that something outside may have pushed: a finger, or an object that is no body, that is near.
/// (What is left of its push at the end of a solve that ended early may be nothing.)
void find_anchored(Work& w) {
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[std::size_t(i)].anchored = false;
    for_each_lane(w, [](auto&, int, Island& i) { i.anchored = true; });
    for (const BodyPair& p : w.s.pairs)
        if (p.a >= 0 && (w.s.objects[std::size_t(p.a)].body < 0 || w.s.objects[std::size_t(p.b)].body < 0))
            island_of_pair(w, p).anchored = true;
}

/// The share of a part of a motion that leaves it no more energy than is to spare.
double share_within(double energy, double spare) {
    return energy > 0 && energy > spare ? std::sqrt(std::max(0.0, spare) / energy) : 1;
}

/// Inertia about the centre of mass, world.
Mat3<double> turned_inertia(const RigidBody& body, const Pose<double>& pose) {
    const Mat3<double> R = rotation_matrix(pose.rotation);
    return R * times_transposed(body.inertia, R);
}

/// Several bodies as one: mass, centre of mass, momentum, and angular momentum about that centre.
struct Whole {
    double mass = 0;
    Vec3<double> centre{0, 0, 0}, momentum{0, 0, 0}, spin{0, 0, 0};
};
/// velocity_of(row) and angular_momentum_of(row), with bodies at position_of(row).
template <class Position, class Velocity, class Spin>
Whole whole_of(const Work& w, const Island& island, Position position_of, Velocity velocity_of, Spin spin_of) {
    Whole all;
    for (int row : island.bodies) {
        const double mass = w.bodies[std::size_t(row)].mass;
        all.mass += mass;
        all.centre += mass * position_of(row);
        all.momentum += mass * velocity_of(row);
    }
    all.centre = (1 / all.mass) * all.centre;
    for (int row : island.bodies) {
        const Vec3<double> relative = velocity_of(row) - (1 / all.mass) * all.momentum;
        all.spin += w.bodies[std::size_t(row)].mass * cross(position_of(row) - all.centre, relative) + spin_of(row);
    }
    return all;
}

Eigen::Matrix3d inertia_of_whole(const Work& w, const Island& island, const Vec3<double>& centre) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (int row : island.bodies) {
        const RigidBody& body = w.bodies[std::size_t(row)];
        const Pose<double>& pose = w.s.bodies[std::size_t(row)].pose;
        const Mat3<double> arm = skew(pose.position - centre);
        sum += eigen(turned_inertia(body, pose)) + body.mass * eigen(times_transposed(arm, arm));
    }
    return sum;
}

/// Gives an island the momentum back with which it began the step.
void restore_island(Work& w, const Island& island) {
    auto body_of = [&](int row) -> RigidBody& { return w.bodies[std::size_t(row)]; };
    auto of = [&](int row) -> const BodyProgress& { return w.s.bodies[std::size_t(row)]; };
    Whole before = whole_of(
        w, island, [&](int row) { return of(row).start.position; }, [&](int row) { return of(row).velocity_before; },
        [&](int row) { return of(row).momentum_before; });
    double allowed = 0, moved = 0, had = 0, has = 0;
    for (int row : island.bodies) {
        before.momentum += w.solver.dt * of(row).weight;
        allowed += of(row).kinetic + dot(of(row).weight, of(row).pose.position - of(row).start.position);
        had += of(row).kinetic, has += kinetic_energy(body_of(row), of(row).pose.rotation);
        moved += body_of(row).mass * (norm(of(row).velocity_before) + norm(body_of(row).velocity));
    }
    const Whole now = whole_of(
        w, island, [&](int row) { return of(row).pose.position; }, [&](int row) { return body_of(row).velocity; },
        [&](int row) { return body_of(row).angular_momentum; });
    constexpr double known = 1e-5;  // a solve that has converged has both to its tolerance
    if (norm(before.momentum - now.momentum) <= known * moved && has <= allowed + known * had) return;
    const Eigen::Matrix3d inertia = inertia_of_whole(w, island, now.centre);
    auto turn_by = [&](const Vec3<double>& spin) {
        Eigen::Matrix3d factor = inertia;
        Eigen::Vector3d turn = eigen(spin);
        if (!solve_definite(factor, turn)) turn.setZero();
        return Vec3<double>{turn.x(), turn.y(), turn.z()};
    };
    const Vec3<double> speed = (1 / now.mass) * before.momentum, turn = turn_by(before.spin);
    const Vec3<double> faster = (1 / now.mass) * (before.momentum - now.momentum),
                       turned = turn_by(before.spin - now.spin);
    // Energy is that of the common motion, of the common turn, and of what each has besides: the less of the last two
    // the less there is.
    const double of_motion = 0.5 * dot(speed, before.momentum), of_turn = 0.5 * dot(turn, before.spin);
    double energy = 0;
    for (int row : island.bodies) {
        RigidBody& body = body_of(row);
        const Pose<double>& pose = of(row).pose;
        body.velocity += faster + cross(turned, pose.position - now.centre);
        body.angular_momentum += turned_inertia(body, pose) * turned;
        energy += kinetic_energy(body, pose.rotation);
    }
    const double turn_share = share_within(of_turn, allowed - of_motion);
    const double share = share_within(energy - of_motion - of_turn, allowed - of_motion - of_turn);
    for (int row : island.bodies) {
        RigidBody& body = body_of(row);
        const Pose<double>& pose = of(row).pose;
        const Vec3<double> turning = cross(turn, pose.position - now.centre), spin = turned_inertia(body, pose) * turn;
        body.velocity = speed + turn_share * turning + share * (body.velocity - speed - turning);
        body.angular_momentum = turn_share * spin + share * (body.angular_momentum - spin);
    }
}

/// What nothing has touched flies on, wherever a solve that ended early has left it.
void restore_untouched(Work& w) {
    for (std::size_t row = 0; row < w.bodies.size(); ++row) {
        RigidBody& body = w.bodies[row];
        const BodyProgress& b = w.s.bodies[row];
        if (body.converged || body.asleep || body.reset || w.s.islands[std::size_t(b.island)].anchored) continue;
        if (!(b.inertia.gradient - b.gradient).isZero(0)) continue;
        body.velocity = b.velocity_before + (w.solver.dt / body.mass) * b.weight;
        body.angular_momentum = b.momentum_before;
        const double allowed = b.kinetic + dot(b.weight, b.pose.position - b.start.position);
        const double share = share_within(kinetic_energy(body, b.pose.rotation), allowed);
        body.velocity = share * body.velocity, body.angular_momentum = share * body.angular_momentum;
    }
}

}  // namespace

void report_what_acted(const BodyWork& w, RigidBody& body, const BodyProgress& b) {
    body.acceleration = (1 / w.solver.dt) * (body.velocity - b.velocity_before);
    body.contact_force = body.mass * body.acceleration - b.weight;
    body.contact_torque = (1 / w.solver.dt) * (body.angular_momentum - b.momentum_before);
}

void keep_momentum(BodyWork& w) {
    if (!w.solver.inertia || w.bodies.empty()) return;
    find_anchored(w);
    restore_untouched(w);
    for (int i = 0; i < w.s.island_count; ++i) {
        const Island& island = w.s.islands[std::size_t(i)];
        const bool steps = std::none_of(island.bodies.begin(), island.bodies.end(), [&](int row) {
            return w.bodies[std::size_t(row)].asleep || w.bodies[std::size_t(row)].reset;
        });
        if (island.anchored || !steps || island.bodies.size() < 2) continue;
        restore_island(w, island);
        for (int row : island.bodies) report_what_acted(w, w.bodies[std::size_t(row)], w.s.bodies[std::size_t(row)]);
    }
}

}  // namespace palpate
