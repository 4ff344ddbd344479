// Energy that bodies get from contacts.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"
#include "engine/skin/chunks/samples.h"

namespace palpate {

namespace {

/// What is known no better: a thousandth of a body's energy, and its weight times a micrometre.
double uncertainty(const RigidBody& body, const BodyProgress& b) {
    return 1e-3 * (b.kinetic + kinetic_energy(body, b.pose.rotation)) + 1e-6 * norm(b.weight);
}

/// What turns far in a step is given too much by its contacts, by as much as an arc is longer than its chord [J]: that
/// is the step's, and no error of its solve.
double gain_along_chord(const RigidBody& body, const BodyProgress& b) {
    const double half = norm((b.pose.rotation * conjugate(b.start.rotation)).vector());
    return 2 * half * half * body.size * norm(body.contact_force);
}

/// Whether a change of a body's speed is more than its solve may leave of what presses on it: contact forces as they
/// are reported have then not made its motion.
bool is_felt(const BodyWork& w, const RigidBody& body, const Vec3<double>& speed) {
    const double share = std::max(fitted::own_residual, 3 * w.solver.tolerance);
    const double force = body.mass / w.solver.dt * norm(speed);
    return force > std::max(share * norm(body.contact_force), fitted::own_rounding);
}

bool gains(const BodyWork& w, const BodyProgress& b, int body) {
    return b.gain > uncertainty(w.bodies[std::size_t(body)], b);
}

/// Coming out of an overlap lifts a body, by as much as is undone, twice where it turns about a corner; its motion is
/// no velocity. More than that is what overlaps that contradict each other throw.
double recovery(const BodyProgress& b) { return fitted::recovery_lever * b.undone * norm(b.weight); }

/// What really acted on a body beside its weight [N].
Vec3<double> push(const RigidBody& body, const BodyProgress& b) { return body.mass * body.acceleration - b.weight; }

/// Takes a force of the end of the step back by half of the body's turn: what turns with a body that is gripped works
/// along the chord as the force half way does. At the end a grip of 4 N that turns by 3 degrees has worked by a tenth
/// of a millijoule, more than what a body of 20 g moves with.
Mat3<double> half_back(const BodyProgress& b) {
    Quaternion<double> turn = b.pose.rotation * conjugate(b.start.rotation);
    if (turn.w < 0) turn = {-turn.w, -turn.x, -turn.y, -turn.z};
    turn.w += 1;  // half of it, but for its length
    return transpose(rotation_matrix(normalised(turn)));
}

/// A contact force on a body, as it was half way through the step, of what has moved by `way`.
void support(BodyProgress& b, const Vec3<double>& force, const Vec3<double>& displacement) {
    b.supported += dot(force, displacement);
    b.worked += std::abs(dot(force, displacement));
    b.load += norm(force);
    b.carried += norm(force) * displacement;
}

/// How far the point of an object that is now at `point` has moved in this step.
Vec3<double> displacement_of(const ContactBody& o, const Vec3<double>& point) {
    return point - transform(o.start, inverse_transform(o.pose, point));
}

/// What skin gave to bodies that it touches.
template <class T>
void add_support_of_skin(BodyWork& w, const SkinChunk<T>& c, int lane) {
    const SkinTopology& t = *c.topology;
    const std::size_t W = std::size_t(c.width), L = std::size_t(lane);
    auto node_displacement = [&](int node) {
        Vec3<double> displacement;
        for (int d = 0; d < 3; ++d) {
            const std::size_t i = std::size_t(3 * node + d) * W + L;
            displacement[d] = double(c.state.position[i]) - double(c.scratch.start_position[i]);
        }
        return displacement;
    };
    auto pose_in = [&](const LaneArray<T>& bones) {
        double p[7];
        for (std::size_t k = 0; k < 7; ++k) p[k] = double(bones[k * W + L]);
        return Pose<double>{{p[0], p[1], p[2]}, {p[3], p[4], p[5], p[6]}};
    };
    const Pose<double> bone = pose_in(c.state.bone), start = pose_in(c.scratch.start_bone);
    auto bone_displacement = [&](int node) {
        Vec3<double> x;
        for (int d = 0; d < 3; ++d) x[d] = double(c.state.position[std::size_t(3 * node + d) * W + L]);
        return x - transform(start, inverse_transform(bone, x));
    };
    for_each_body_of(w, c, lane, [&](int slot, BodyProgress& b) {
        const int row = c.contacts.at(slot, lane).body;
        if (is_plane(w, row) || !gains(w, b, row)) return;
        // Where skin has got to is no result either.
        const bool no_result = misses_what_acted(w.bodies[std::size_t(row)], b, fitted::no_result);
        auto displacement_of_node = [&](int node) {
            return no_result ? bone_displacement(node) : node_displacement(node);
        };
        if (c.contacts.slot[std::size_t(slot)].recovers) b.gain = 0;
        const Mat3<double> back = half_back(b);
        for (std::size_t s = 0; s < samples_in_use<T>(c); ++s) {
            const std::size_t i = (std::size_t(slot) * t.sample_count() + s) * 3 * W + L;
            const Vec3<double> force{double(c.exchange.slot_gradient[i]), double(c.exchange.slot_gradient[i + W]),
                                     double(c.exchange.slot_gradient[i + 2 * W])};
            if (dot(force, force) <= 0) continue;
            if (s < t.samples.size()) {
                support(b, back * force, displacement_of_node(t.samples[s]));
                continue;
            }
            const FaceSample& f = t.face_samples[s - t.samples.size()];
            Vec3<double> displacement{0, 0, 0};
            for (std::size_t k = 0; k < 3; ++k) displacement += double(f.weight[k]) * displacement_of_node(f.node[k]);
            support(b, back * force, displacement);
        }
    });
}

/// What other objects gave; of two bodies, neither is the other's ground: they meet half way, or where that is no
/// result, nowhere.
void add_support_of_objects(BodyWork& w) {
    for (const BodyPair& p : w.s.pairs) {
        if (p.a < 0) continue;
        const ContactBody &a = w.s.objects[std::size_t(p.a)], &b = w.s.objects[std::size_t(p.b)];
        for (const FeatureContact& contact : p.contacts) {
            const double comes_out = contact.undone > 0 ? contact.undone : contact.sunk;
            for (const ContactBody* o : {&a, &b}) {
                if (o->body < 0) continue;
                double& undone = w.s.bodies[std::size_t(o->body)].undone;
                undone = std::max(undone, comes_out);
            }
            for (const PairTerm& term : contact.terms) {
                if (!term.acts || dot(term.gradient, term.gradient) <= 0) continue;
                const Vec3<double> of_a = displacement_of(a, a.centre + term.arm_of_a),
                                   of_b = displacement_of(b, b.centre + term.arm_of_b);
                auto give = [&](const ContactBody& to, const Vec3<double>& force, bool met,
                                const Vec3<double>& displacement) {
                    if (to.body < 0) return;
                    BodyProgress& body = w.s.bodies[std::size_t(to.body)];
                    const bool nowhere =
                        met && misses_what_acted(w.bodies[std::size_t(to.body)], body, fitted::no_result);
                    support(body, half_back(body) * force, met ? (nowhere ? 0.0 : 0.5) * (of_a + of_b) : displacement);
                };
                give(a, -term.gradient, b.body >= 0, of_b);
                give(b, term.gradient, a.body >= 0, of_a);
            }
        }
    }
}

/// Whether something has acted on it, beyond the rounding of what moves it: what flies among those that touch has
/// gained nothing.
bool is_touched(const RigidBody& body, const BodyProgress& b) {
    const double rounding = fitted::rounded_share * (norm(b.weight) + body.mass * norm(body.acceleration));
    return norm(body.contact_force) > rounding || norm(body.contact_torque) > rounding * body.size;
}

/// Energy of an island's bodies that are touched: of motion before and after the step, what they were lifted by, and
/// how much more than before they may have [J].
struct IslandEnergy {
    double before = 0, after = 0, lift = 0, spare = 0;
};
IslandEnergy energy_of(const BodyWork& w, const Island& island) {
    IslandEnergy e;
    for (int row : island.bodies) {
        const RigidBody& body = w.bodies[std::size_t(row)];
        const BodyProgress& b = w.s.bodies[std::size_t(row)];
        if (!is_touched(body, b)) continue;
        e.before += b.kinetic, e.after += kinetic_energy(body, b.pose.rotation);
        e.lift -= dot(b.weight, b.pose.position - b.start.position);
        e.spare += recovery(b) + uncertainty(body, b);
    }
    return e;
}

/// A pose on the way from one to another.
Pose<double> part_of_way(const Pose<double>& from, const Pose<double>& to, double share) {
    const double sign =
        dot(Vec3<double>(from.rotation.vector()), to.rotation.vector()) + from.rotation.w * to.rotation.w < 0 ? -1 : 1;
    const auto between = [&](double a, double b) { return a + share * (sign * b - a); };
    const Quaternion<double>&p = from.rotation, &q = to.rotation;
    return {from.position + share * (to.position - from.position),
            normalised(Quaternion<double>{between(p.w, q.w), between(p.x, q.x), between(p.y, q.y), between(p.z, q.z)})};
}

/// Bodies that touch each other and nothing that is driven have together no more than they had: where their solve ends
/// early, one may have been given what no other has lost. They go more slowly, or where that is not enough, less far.
void brake_island(BodyWork& w, const Island& island) {
    const IslandEnergy e = energy_of(w, island);
    const double left = e.before + e.spare - e.lift;
    if (e.after <= left) return;
    const double speed_share = left > 0 ? std::sqrt(left / e.after) : 0;
    const double way_share = left >= 0 ? 1 : (e.before + e.spare) / e.lift;
    for (VirtualObject& shape : w.shapes) {
        if (shape.body < 0) continue;
        RigidBody& body = w.bodies[std::size_t(shape.body)];
        BodyProgress& b = w.s.bodies[std::size_t(shape.body)];
        if (&w.s.islands[std::size_t(b.island)] != &island || body.asleep || body.reset || !is_touched(body, b))
            continue;
        if (is_felt(w, body, (1 - speed_share) * body.velocity)) body.converged = false;
        body.velocity = speed_share * body.velocity;
        body.angular_momentum = speed_share * body.angular_momentum;
        if (way_share >= 1) continue;
        b.pose = part_of_way(b.start, b.pose, way_share);
        shape.pose = object_pose(body, b.pose);
    }
}

/// Islands that neither fingers nor what moves by a track touch.
void brake_islands(BodyWork& w) {
    mark_driven(w);
    for_each_lane(w, [](auto&, int, Island& i) { i.driven = true; });
    for (int i = 0; i < w.s.island_count; ++i)
        if (const Island& island = w.s.islands[std::size_t(i)]; !island.driven && !island.bodies.empty())
            brake_island(w, island);
}

}  // namespace

bool misses_what_acted(const RigidBody& body, const BodyProgress& b, double times) {
    const Vec3<double> acted = push(body, b);
    return !body.converged && norm(body.contact_force - acted) > times * norm(acted);
}

void brake_gains(BodyWork& w) {
    if (!w.solver.inertia) return;
    bool any = false;
    auto for_each_gaining = [&](auto visit) {
        for (VirtualObject& shape : w.shapes) {
            if (shape.body < 0) continue;
            RigidBody& body = w.bodies[std::size_t(shape.body)];
            // Where a solve ends early, nothing may push any more what it has thrown.
            const bool pushed = !body.converged || dot(body.contact_force, body.contact_force) > 0;
            if (pushed && !body.asleep && !body.reset) visit(body, w.s.bodies[std::size_t(shape.body)], shape);
        }
    };
    for_each_gaining([&](RigidBody& body, BodyProgress& b, const VirtualObject& shape) {
        b.gain = kinetic_energy(body, b.pose.rotation) - b.kinetic - dot(b.weight, b.pose.position - b.start.position);
        b.supported = b.worked = b.load = b.undone = 0;
        b.carried = {0, 0, 0};
        any |= gains(w, b, shape.body);
    });
    if (!any) return;
    for_each_lane(w, [&](const auto& c, int lane, const Island&) { add_support_of_skin(w, c, lane); });
    add_support_of_objects(w);
    for_each_gaining([&](RigidBody& body, BodyProgress& b, VirtualObject& shape) {
        if (b.load > 0 && misses_what_acted(body, b, fitted::no_result)) {
            b.supported = dot(push(body, b), b.carried) / b.load;
            b.carried = {0, 0, 0};  // nor does it go along with what it touched
        }
        const double excess = b.gain - std::max(0.0, b.supported) - recovery(b);
        const double share_of_work = body.converged ? fitted::work_share : fitted::rough_work_share;
        if (excess <= uncertainty(body, b) + share_of_work * b.worked) return;
        const Vec3<double> along = b.load > 0 ? (1 / (b.load * w.solver.dt)) * b.carried : Vec3<double>{0, 0, 0};
        const Vec3<double> speed = body.velocity - along;
        const double energy =
            0.5 * (body.mass * dot(speed, speed) + dot(angular_velocity(body, b.pose.rotation), body.angular_momentum));
        // Nor does a step that ended early leave a body higher than anything lifted it: it stays where it was.
        // (What its island has converged with is where skin was found to touch it.)
        const bool ended_early = !body.converged && !w.s.islands[std::size_t(b.island)].progress.converged;
        if (ended_early && excess > energy + fitted::least_throw * norm(b.weight)) {
            b.pose = b.start;
            shape.pose = object_pose(body, b.pose);
            body.velocity = body.angular_momentum = {0, 0, 0};
            return;
        }
        const double share = std::sqrt(std::clamp(1 - excess / energy, 0.0, 1.0));
        const Vec3<double> taken = (1 - share) * speed;
        body.velocity = along + share * speed;
        body.angular_momentum = share * body.angular_momentum;
        if (excess > 2 * gain_along_chord(body, b) && is_felt(w, body, taken)) body.converged = false;
    });
    brake_islands(w);
}

}  // namespace palpate
