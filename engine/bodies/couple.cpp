#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "engine/systems.h"

namespace palpate {

void read_trackers(double dt, Table<TrackerPose>& trackers, Table<PoseFilter>& filters) {
    for (std::size_t row = 0; row < trackers.size(); ++row) {
        TrackerPose& t = trackers[row];
        const TrackerPose::Sample& s = t.incoming;
        t.previous = t.newest.valid ? t.newest.pose : s.pose;
        t.silent += dt;
        if (!s.valid) {
            ++t.missing;
            continue;
        }
        const Quaternion<double>& q = s.pose.rotation;
        const double norm2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
        const Vec3<double>& p = s.pose.position;
        if (!std::isfinite(norm2) || norm2 < 1e-6 || norm2 > 1e6 || !std::isfinite(dot(p, p)) ||
            !std::isfinite(s.time)) {
            ++t.not_finite;
        } else if (t.newest.valid && s.time < t.newest.time) {
            ++t.backward;
        } else {
            ++t.accepted;
            t.silent = 0;
            t.newest = s;
            t.newest.pose.rotation = normalised(q);
            if (t.newest.pose.rotation.w < 0) {  // q and -q are one rotation: one sign, one set of bits
                Quaternion<double>& r = t.newest.pose.rotation;
                r = {-r.w, -r.x, -r.y, -r.z};
            }
            if (PoseFilter* filter = filters.find(trackers.owner(row)))
                t.newest.pose = filter_pose(*filter, t.newest.pose, s.time);
        }
    }
}

namespace {

/// `wanted`, or as far from `from` towards it as an angle whose half has this sine, by the shorter way.
Quaternion<double> turned_at_most(const Quaternion<double>& from, const Quaternion<double>& wanted, double half_sine) {
    const Quaternion<double> turn = wanted * conjugate(from);
    const double length = norm(turn.vector());
    if (!(length > half_sine)) return wanted;
    const double share = (turn.w < 0 ? -half_sine : half_sine) / length;
    const double w = std::sqrt(std::max(0.0, 1 - half_sine * half_sine));
    return normalised(Quaternion<double>{w, share * turn.x, share * turn.y, share * turn.z} * from);
}

/// Newest tracked pose, approached no faster than the coupling's largest speed and spin.
Pose<double> next_target(Coupling& c, const Pose<double>& wanted, double dt) {
    if (!c.started) return wanted;
    Pose<double> target = wanted;
    const Vec3<double> d = wanted.position - c.target.position;
    const double reach = c.max_speed * dt, turn = std::min(c.max_spin * dt, std::numbers::pi);
    if (dot(d, d) > reach * reach) target.position = c.target.position + (reach / norm(d)) * d;
    target.rotation = turned_at_most(c.target.rotation, wanted.rotation, std::sin(0.5 * turn));
    if (std::memcmp(&target, &wanted, sizeof target) != 0) ++c.slowed;
    return target;
}

template <class T>
void store_spring(SkinChunk<T>& c, int spring, int lane, const Vec3<double>& origin, double linear, double angular,
                  const Pose<double>& target) {
    const Vec3<double> p = target.position - origin;
    const Quaternion<double>& q = target.rotation;
    const double v[9] = {linear, angular, p.x, p.y, p.z, q.w, q.x, q.y, q.z};
    for (int i = 0; i < 9; ++i) c.scratch.bone_springs[(9 * spring + i) * c.width + lane] = T(v[i]);
}

template <class T>
void aim(SkinChunk<T>& c, int lane, const SolverSettings& solver, const Coupling& coupling) {
    const int W = c.width;
    auto rate = [&](int i) { return double(c.state.bone_velocity[i * W + lane]); };
    rebase_lane(c, lane);
    const Pose<double> now = lane_bone(c, lane);
    const Vec3<double> origin = lane_origin(c, lane);

    Pose<double> carried = now;  // as if it moved with the target
    carried.position += coupling.target.position - coupling.last_target.position;
    carried.rotation = normalised(coupling.target.rotation * conjugate(coupling.last_target.rotation) * now.rotation);

    // However far what holds the bone back has left it behind, the spring pulls no harder than the coupling may
    // (pose_spring.h), and a bone that nothing holds goes all the way.
    const double reach = coupling.max_force / coupling.stiffness;
    // The coupling's torque at an angle is 2 kappa sin(angle / 2).
    const double half_turn = 0.5 * coupling.max_torque / coupling.angular_stiffness;
    store_spring(c, 0, lane, origin, coupling.stiffness, coupling.angular_stiffness, coupling.target);
    c.scratch.coupling_reach[std::size_t(lane)] = T(reach);
    c.scratch.coupling_reach[std::size_t(c.width + lane)] = T(half_turn);

    if (!solver.inertia) {
        store_spring(c, 1, lane, origin, 0, 0, now);
        store_spring(c, 2, lane, origin, 0, 0, now);
        return;
    }
    // The damper pulls the bone to where it would be if it moved with the target.
    const double dt = solver.dt;
    store_spring(c, 1, lane, origin, coupling.damping / dt, coupling.angular_damping / dt, carried);

    Pose<double> coasting = now;
    coasting.position += dt * Vec3<double>{rate(0), rate(1), rate(2)};
    coasting.rotation = normalised(rotation_step(dt * Vec3<double>{rate(3), rate(4), rate(5)}) * now.rotation);
    store_spring(c, 2, lane, origin, coupling.bone_mass / (dt * dt), coupling.bone_inertia / (dt * dt), coasting);
}

}  // namespace

void couple(const Table<TrackerPose>& trackers, const SolverSettings& solver, const Table<Skin>& skins,
            Table<Coupling>& couplings, SkinChunks& chunks) {
    for (std::size_t row = 0; row < couplings.size(); ++row) {
        Coupling& c = couplings[row];
        const Skin& skin = *skins.find(couplings.owner(row));
        const TrackerPose* tracker = trackers.find(c.tracker);
        const Pose<double> wanted = tracker && tracker->newest.valid ? tracker->newest.pose
                                    : c.started                      ? c.target
                                                                     : skin.start;
        const Pose<double> next = next_target(c, wanted, solver.dt);
        // Asleep where it was to be: its springs are as they were, too.
        auto same = [](const Pose<double>& a, const Pose<double>& b) { return std::memcmp(&a, &b, sizeof a) == 0; };
        const bool stays = c.started && same(next, c.target) && same(c.last_target, c.target);
        c.last_target = c.started ? c.target : next;
        c.target = next;
        c.started = true;
        chunks.with(skin.single_precision, skin.chunk, [&](auto& chunk) {
            if (!(stays && ((chunk.asleep_lanes >> skin.lane) & 1u))) aim(chunk, skin.lane, solver, c);
        });
    }
}

void hold_soft_objects(const Table<VirtualObject>& shapes, const SolverSettings& solver, SoftObjects& soft,
                       SkinChunks& chunks) {
    for (SoftObject& o : soft.all) {
        Coupling& c = o.hold;
        const Pose<double>& next = shapes[std::size_t(o.object)].pose;
        auto same = [](const Pose<double>& a, const Pose<double>& b) { return std::memcmp(&a, &b, sizeof a) == 0; };
        const bool stays = c.started && same(next, c.target) && same(c.last_target, c.target);
        c.last_target = c.started ? c.target : next;
        c.target = next;
        c.started = true;
        SkinChunk<double>& chunk = chunks.doubles[std::size_t(o.skin.chunk)];
        if (!(stays && ((chunk.asleep_lanes >> o.skin.lane) & 1u))) aim(chunk, o.skin.lane, solver, c);
    }
}

}  // namespace palpate
