#include "scenes/studies/random/sample_laws.h"

#include <algorithm>
#include <cmath>

#include "engine/skin/solve/fitted.h"

namespace palpate {

namespace {

/// Numbers `first` and on of an array [number][lane].
template <class T>
Vec3<double> numbers_of_lane(const LaneArray<T>& a, std::size_t first, const SkinChunk<T>& c, int lane) {
    const T* p = &a[first * std::size_t(c.width) + std::size_t(lane)];
    return {double(p[0]), double(p[c.width]), double(p[2 * c.width])};
}

/// A sample of a finger whose nodes are at `position`, world [m].
Vec3<double> place_of_sample(const SkinTopology& t, std::size_t s, const std::vector<Vec3<double>>& position) {
    if (s < t.samples.size()) return position[std::size_t(t.samples[s])];
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    Vec3<double> x{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k) x += f.weight[k] * position[std::size_t(f.node[k])];
    return x;
}

/// Way over the object in this step of what presses with friction to spare [m]: the mean by normal force over all that
/// presses, and the share of it that has any.
struct StuckSlip {
    double way = 0, share = 0, normal_force = 0;
};

/// Of one sample alone: where a finger rolls off an object, or is dragged over it, some of it slides while the rest
/// sticks, and what it reports as a whole, a mean way and a share of friction in use, may be anything (seeds 2101443
/// and 2102957: half of the force stuck, with next to no friction, and the other half slid). `pending`: by how much
/// multipliers of friction may still change [N].
template <class T>
StuckSlip stuck_slip(const SkinChunk<T>& c, int lane, int slot, const FingerState& before, const FingerState& now,
                     double pending) {
    constexpr double spare = 0.9;                                                  // of the friction available
    constexpr double plane_error = 2e-3, plane_error_of_blow = 2e-2, blow = 1e-3;  // [rad, rad, m]
    const LaneContact& o = c.contacts.at(slot, lane);
    const SkinTopology& t = *c.topology;
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    const double scale = std::min(double(c.state.penalty_scale[W + l]), detail::fitted::stiffest_slip);
    StuckSlip all;
    for (std::size_t s = 0; s < t.sample_count(); ++s) {
        const std::size_t i = std::size_t(slot) * t.sample_count() + s;
        const double pressed = double(c.state.normal_multiplier[i * W + l]);
        if (pressed <= 0) continue;
        all.normal_force += pressed;
        const double friction = norm(numbers_of_lane(c.state.tangential_multiplier, 3 * i, c, lane));
        if (friction + pending > spare * o.friction * pressed) continue;
        const Vec3<double> moved = inverse_transform(o.pose, place_of_sample(t, s, now.position)) -
                                   inverse_transform(o.start, place_of_sample(t, s, before.position));
        const Vec3<double> normal = numbers_of_lane(c.state.friction_normal, 3 * i, c, lane);
        const double left = pending / (double(c.rest.contact_penalty[s * W + l]) * scale);
        // The plane of friction is that of the last update of multipliers: where a blow came from millimetres away, a
        // milliradian of it is micrometres of slip (1707420, 1720777: 20 um of 8 mm, forces right to 6e-5).
        // Where it is a body that turns, contact may have gone on over a round surface since then (1086042: 14 mrad).
        const double along = dot(moved, normal), way_in = std::abs(along);
        const double tilted = (way_in > blow ? plane_error_of_blow : plane_error) * way_in;
        all.way += pressed * std::max(0.0, norm(moved - along * normal) - left - tilted);
        all.share += pressed;
    }
    if (all.normal_force > 0) all.way /= all.normal_force, all.share /= all.normal_force;
    return all;
}

}  // namespace

void check_slips(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    constexpr double slid = 1e-5;  // [m]
    // What an island leaves pending is a share of all its forces, or what rounding makes of them: where a normal force
    // has just grown, friction is less than the limit by as much (seed 1093, single precision: 1.4 of 6.9 mN; 2032540:
    // 0.6 mN of a finger beside a ball of 0.5 kg that was struck at 2 m/s).
    double forces = 0, rounding = 0;
    for (const RigidBody& b : w.bodies) forces += norm(b.contact_force);
    for (std::size_t i = 0; i < v.fingers.size(); ++i) {
        forces += v.fingers[i].normal_force + w.couplings.find(v.s.fingers[i])->force_N;
        rounding += rounding_of(v, i);
    }
    const double pending = std::max(std::max(w.solver.multiplier_tolerance, w.solver.tolerance) * forces, rounding);
    for (std::size_t i = 0; i < v.fingers.size() && !v.before.empty(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset || f.normal_force <= 0.1) continue;
        w.chunks.with(f.skin->single_precision, f.skin->chunk, [&](const auto& c) {
            for (int slot = 0; slot < c.contacts.count[std::size_t(f.skin->lane)] && c.has_friction; ++slot) {
                const LaneContact& o = c.contacts.at(slot, f.skin->lane);
                if (o.finger >= 0 || o.stiffness > 0 || o.friction <= 0) continue;
                const StuckSlip stuck = stuck_slip(c, f.skin->lane, slot, v.before[i], f, pending);
                if (stuck.way > slid)
                    found.add("what sticks does not slide",
                              law_text("%.4f s: %.3g of %.4g N of %s on %s has friction to spare, and slides by "
                                       "%.4g mm in a step",
                                       w.time, stuck.share, stuck.normal_force, f.skin->name.c_str(),
                                       w.shapes[std::size_t(o.object)].name.c_str(), 1e3 * stuck.way));
            }
        });
    }
}

void check_leaps(const Watched& v, Findings& found) {
    const World& w = v.s.world;
    constexpr double outside = -1e-4, through = 1e-3, opposite = -0.5;  // [m, m, cosine]
    constexpr int parts = 16;
    for (std::size_t i = 0; i < v.fingers.size() && !v.before.empty(); ++i) {
        const FingerState& f = v.fingers[i];
        if (!f.status.converged || f.status.reset) continue;
        if (v.before[i].status.wrong_sides > 0) continue;  // what was said to have passed may come back
        w.chunks.with(f.skin->single_precision, f.skin->chunk, [&](const auto& c) {
            for (int slot = 0; slot < c.contacts.count[std::size_t(f.skin->lane)]; ++slot) {
                const LaneContact& o = c.contacts.at(slot, f.skin->lane);
                if (o.finger >= 0 || o.stiffness > 0) continue;
                for (int node : f.skin->mesh.pad_nodes) {
                    const Vec3<double> from = inverse_transform(o.start, v.before[i].position[std::size_t(node)]),
                                       to = inverse_transform(o.pose, f.position[std::size_t(node)]);
                    const SurfacePoint<double> a = surface_point(o.shape, Pose<double>::identity(), from),
                                               b = surface_point(o.shape, Pose<double>::identity(), to);
                    if (a.distance < outside || b.distance < outside || dot(a.normal, b.normal) > opposite) continue;
                    double depth = 0;
                    for (int k = 1; k < parts; ++k)
                        depth = std::max(depth, -surface_point(o.shape, Pose<double>::identity(),
                                                               from + (double(k) / parts) * (to - from))
                                                     .distance);
                    // What the bone and the object have moved may pass through half of that on its way, past a corner
                    // that comes between two nodes (2122559: 11 mm past a tumbling mesh in a step of 20 ms).
                    const Vec3<double> carried =
                        transform(f.bone, inverse_transform(v.before[i].bone, v.before[i].position[std::size_t(node)]));
                    if (depth > through + norm(inverse_transform(o.pose, carried) - from) / 2)
                        found.add("skin does not leap through things",
                                  law_text("%.4f s: a node of %s, %.3g mm through %s", w.time, f.skin->name.c_str(),
                                           1e3 * depth, w.shapes[std::size_t(o.object)].name.c_str()));
                }
            }
        });
    }
}

}  // namespace palpate
