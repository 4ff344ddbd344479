#include "engine/bodies/anchors.h"

#include <algorithm>
#include <cmath>

namespace palpate {

void cast_anchor(const BodyWork& w, RigidBody& body, BodyProgress& b) {
    // Going on by itself is inertia's.
    if (!body.gripped) body.velocity = body.angular_momentum = {0, 0, 0};
    b.anchor = free_flight(body, b.start, {0, 0, 0}, w.solver.dt);
    b.anchor_time = fitted::anchor_time;
    b.target = b.anchor;
    b.target.position += (b.anchor_time * b.anchor_time / body.mass) * b.weight;
    b.borne = 0, b.last_borne = HUGE_VAL;
    b.adrift = false, b.vain_casts = 0;
}

void evaluate_anchor(const BodyWork& w, const RigidBody& body, BodyProgress& b) {
    b.inertia = body_inertia(body, b.anchor, b.pose, b.anchor_time);
    const Motion& g = b.inertia.gradient;
    const double force = std::sqrt(g.head<3>().squaredNorm() + g.tail<3>().squaredNorm() / (body.size * body.size));
    b.borne = force / (9.81 * body.mass);
    b.inertia.energy -= dot(b.weight, b.pose.position - b.start.position);
    for (int k = 0; k < 3; ++k) b.inertia.gradient[k] -= b.weight[k];
    if (b.adrift) return;
    double& violation = w.s.islands[std::size_t(b.island)].evaluation.violation;
    violation = std::max(violation, w.solver.limit_tolerance * b.borne / fitted::anchored_weight);
}

void recast_anchors(BodyWork& w, const Island& island) {
    for (int row : island.bodies) {
        if (is_plane(w, row)) continue;
        BodyProgress& b = w.s.bodies[std::size_t(row)];
        if (b.adrift || b.borne <= fitted::anchored_weight) continue;
        const bool untouched = (b.inertia.gradient - b.gradient).isZero(0);
        b.vain_casts = b.borne > fitted::vain_anchor * b.last_borne ? b.vain_casts + 1 : 0;
        const int most = b.borne > fitted::little_borne ? fitted::most_vain_casts : fitted::most_vain_casts_of_little;
        b.adrift = untouched || b.vain_casts >= most;
        if (b.adrift) continue;
        b.last_borne = b.borne;
        b.anchor = b.pose;
        const double slowest = std::sqrt(fitted::farthest_cast / (9.81 * std::max(b.borne, fitted::least_borne)));
        b.anchor_time = std::max(b.anchor_time, std::min(fitted::slower_anchor * b.anchor_time, slowest));
    }
}

void find_gripped(BodyWork& w) {
    for (RigidBody& body : w.bodies) body.gripped = false;
    for_each_lane(w, [&](const auto& c, int lane, const Island&) {
        for_each_body_of(w, c, lane, [&](int slot, const BodyProgress&) {
            const int row = c.contacts.at(slot, lane).body;
            if (is_plane(w, row)) return;
            RigidBody& body = w.bodies[std::size_t(row)];
            Vec3<double> push;
            for (int k = 0; k < 3; ++k)
                push[k] = double(c.exchange.body_gradient[std::size_t((6 * slot + k) * c.width + lane)]);
            body.gripped |= norm(push) > fitted::grip_share * 9.81 * body.mass;
        });
    });
}

void end_static_body(const BodyWork& w, RigidBody& body, BodyProgress& b) {
    if (b.adrift) body.gripped = false;
    body.converged &= b.borne <= fitted::anchored_weight;
    body.velocity = (1 / w.solver.dt) * (b.pose.position - b.start.position);
    const Mat3<double> R = rotation_matrix(b.pose.rotation);
    const Vec3<double> spin = (1 / w.solver.dt) * shorter_twice_vector(b.pose.rotation * conjugate(b.start.rotation));
    body.angular_momentum = R * (body.inertia * transposed_times(R, spin));
    body.acceleration = {0, 0, 0};
}

}  // namespace palpate
