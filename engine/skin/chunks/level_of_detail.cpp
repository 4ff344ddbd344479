#include "engine/skin/chunks/level_of_detail.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

/// So long is nothing near before a skin is taken for rigid: at the edge of an object's reach it would come and go.
constexpr int free_enough = 20;

/// Tissue is linearised again after at most so many steps, and where too much moves, tried again after so many.
constexpr int longest_period = 64, try_again_after = 16;

/// The bone, from the lane's origin.
template <class T>
Pose<double> local_bone(const SkinChunk<T>& c, int lane) {
    Pose<double> bone = lane_bone(c, lane);
    bone.position = bone.position - lane_origin(c, lane);
    return bone;
}

template <class Array>
Vec3<double> read(const Array& a, int index, int width, int lane) {
    const auto* p = &a[std::size_t(3 * index * width + lane)];
    return {double(p[0]), double(p[width]), double(p[2 * width])};
}
template <class T>
void write(LaneArray<T>& a, int index, int width, int lane, const Vec3<double>& v) {
    for (int d = 0; d < 3; ++d) a[std::size_t((3 * index + d) * width + lane)] = T(v[d]);
}

/// How a lane's bone moves, and with it a skin that has its rest shape; from the lane's origin.
struct RigidMotion {
    Vec3<double> position, speed, spin;
    Mat3<double> rotation;
};
template <class T>
RigidMotion rigid_motion(const SkinChunk<T>& c, int lane) {
    const Pose<double> bone = local_bone(c, lane);
    return {bone.position, read(c.state.bone_velocity, 0, c.width, lane), read(c.state.bone_velocity, 1, c.width, lane),
            rotation_matrix(bone.rotation)};
}

/// Gives a rigid lane its positions and velocities back.
template <class T>
void soften(SkinChunk<T>& c, int lane) {
    const int W = c.width;
    const RigidMotion bone = rigid_motion(c, lane);
    for (int i = 0; i < c.topology->node_count; ++i) {
        const Vec3<double> arm = bone.rotation * read(c.rest.rest_position, i, W, lane);
        write(c.state.position, i, W, lane, bone.position + arm);
        write(c.state.velocity, i, W, lane, bone.speed + cross(bone.spin, arm));
    }
    for (std::size_t i = 0; i < c.state.svd_guess.size() / std::size_t(W); ++i)
        c.state.svd_guess[i * std::size_t(W) + std::size_t(lane)] = T(i % 9 % 4 == 0);
    for (int k = 0; k < 2; ++k) c.state.penalty_scale[std::size_t(k * W + lane)] = T(1);
    c.rigid_lanes &= ~(1u << lane);
}

template <class T>
bool has_come_to_rest(const SkinChunk<T>& c, int lane, const SolverSettings& settings) {
    if (settings.sleep_speed <= 0) return false;
    const SkinStatus& status = c.status[std::size_t(lane)];
    if (!status.converged || status.newton_iterations > 1) return false;
    const std::size_t W = std::size_t(c.width);
    const T limit = T(settings.sleep_speed);
    for (std::size_t i = std::size_t(lane); i < c.state.velocity.size(); i += W)
        if (!(std::abs(c.state.velocity[i]) < limit)) return false;
    for (std::size_t i = std::size_t(lane); i < 3 * W; i += W)
        if (!(std::abs(c.state.bone_velocity[i]) < limit)) return false;
    return true;
}

/// Whether no node is, or in the next step would be, farther from its place on the bone than the tolerance.
template <class T>
bool has_rest_shape(const SkinChunk<T>& c, int lane, const SolverSettings& settings) {
    if (settings.detail_tolerance <= 0 || c.free_steps[std::size_t(lane)] < free_enough) return false;
    const SkinStatus& status = c.status[std::size_t(lane)];
    if (status.reset || status.contact_force_N > 0 || status.limited_elements > 0) return false;
    const int W = c.width;
    const RigidMotion bone = rigid_motion(c, lane);
    for (int i = 0; i < c.topology->node_count; ++i) {
        const Vec3<double> arm = bone.rotation * read(c.rest.rest_position, i, W, lane);
        const Vec3<double> off = read(c.state.position, i, W, lane) - bone.position - arm;
        const Vec3<double> swing = read(c.state.velocity, i, W, lane) - bone.speed - cross(bone.spin, arm);
        if (!(norm(off) + settings.dt * norm(swing) < settings.detail_tolerance)) return false;
    }
    return true;
}

/// Whether a sample between nodes bears a force, or would have to, to stay out of an object.
template <class T>
bool is_deep_between_nodes(const SkinChunk<T>& c, int lane, double depth) {
    const SkinTopology& t = *c.topology;
    const Vec3<double> origin = lane_origin(c, lane);
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
        const LaneContact& s = c.contacts.at(slot, lane);
        if (s.stiffness > 0) return true;  // what gives way bears on shares of the area, of all samples
        for (std::size_t k = 0; k < t.face_samples.size(); ++k) {
            const std::size_t i = std::size_t(slot) * t.sample_count() + t.samples.size() + k;
            if (c.state.normal_multiplier[i * std::size_t(c.width) + std::size_t(lane)] > 0) return true;
            Vec3<double> x = origin;
            for (int j = 0; j < 3; ++j)
                x += t.face_samples[k].weight[std::size_t(j)] *
                     read(c.state.position, t.face_samples[k].node[std::size_t(j)], c.width, lane);
            if (surface_point(s.shape, s.start, x).distance < -depth) return true;
        }
    }
    return false;
}

template <class T>
void fall_asleep(SkinChunk<T>& c, int lane) {
    const std::size_t W = std::size_t(c.width);
    for (auto* a : {&c.state.velocity, &c.state.bone_velocity})
        for (std::size_t i = std::size_t(lane); i < a->size(); i += W) (*a)[i] = T(0);
    for (std::size_t i = std::size_t(lane); i < 9 * W; i += W) c.still_spring[i] = c.scratch.bone_springs[i];
    c.asleep_lanes |= 1u << lane;
}

}  // namespace

template <class T>
void soften_lanes(SkinChunk<T>& c, unsigned lanes) {
    for (int lane = 0; lane < c.width; ++lane)
        if ((c.rigid_lanes & lanes) >> lane & 1u) soften(c, lane);
}

template <class T>
void wake_lanes(SkinChunk<T>& c, const SolverSettings& settings) {
    const unsigned near = near_lanes(c);
    c.unchanged_lanes = 0;
    for (int lane = 0; lane < c.width; ++lane) {
        const unsigned bit = 1u << lane;
        if (!(c.used_lanes & bit)) continue;
        if (near & bit) {
            c.free_steps[std::size_t(lane)] = 0;
            soften_lanes(c, bit);
            c.asleep_lanes &= ~bit;
        } else if (c.asleep_lanes & bit) {
            (same_target(c, lane) ? c.unchanged_lanes : c.asleep_lanes) ^= bit;
            // What slept has its rest shape: it need not be solved to be moved.
            if (!(c.asleep_lanes & bit) && has_rest_shape(c, lane, settings)) c.rigid_lanes |= bit;
        }
        if (!(c.asleep_lanes & bit)) continue;
        SkinStatus& s = c.status[std::size_t(lane)];
        s.newton_iterations = s.multiplier_updates = s.backtracks = 0;
    }
}

template <class T>
void choose_samples(SkinChunk<T>& c, const SolverSettings& settings) {
    if (settings.detail_penetration <= 0 || c.topology->face_samples.empty()) {
        c.fine_lanes = ~0u;
        return;
    }
    const unsigned near = near_lanes(c);
    for (int lane = 0; lane < c.width; ++lane) {
        const unsigned bit = 1u << lane;
        if (!(c.used_lanes & bit)) continue;
        int& coarse = c.coarse_steps[std::size_t(lane)];
        coarse = (near & bit) && is_deep_between_nodes(c, lane, settings.detail_penetration) ? 0 : coarse + 1;
        if (coarse == 0)
            c.fine_lanes |= bit;
        else if (coarse >= free_enough || !(near & bit))
            c.fine_lanes &= ~bit;
    }
}

template <class T>
void choose_tissue(SkinChunk<T>& c, const SolverSettings& settings, std::int64_t step) {
    LinearTissue<T>& l = c.linear;
    if (l.pairs.empty()) return;
    c.linear_lanes = l.due_lanes = l.fresh_lanes = 0;
    for (int lane = 0; lane < c.width; ++lane) {
        const unsigned bit = 1u << lane;
        const SkinStatus& s = c.status[std::size_t(lane)];
        const T error = l.error[std::size_t(lane)],
                allowed = T(settings.detail_error * std::max(s.contact_force_N, 0.01));
        l.bound[std::size_t(lane)] = allowed;
        if (!(active_lanes(c) & bit) || s.reset) l.kept_lanes &= ~bit;
        LinearisingPlan& plan = l.plan[std::size_t(lane)];
        const bool kept = l.kept_lanes & bit;
        if ((plan.linear || plan.tried) && !kept) plan.period = std::max(1, plan.period / 2);
        const bool due = step % (plan.period > 1 ? plan.period : try_again_after) == 0;
        if (due && plan.period == 1)
            plan.period = 2;
        else if (due && plan.linear && kept && 8 * error < allowed && plan.period < longest_period)
            plan.period *= 2;  // in twice the time, four times the error
        plan.linear = kept && !due;
        plan.tried = due && (active_lanes(c) & bit) && !s.reset;
        if (plan.linear) c.linear_lanes |= bit;
        if (plan.tried) l.due_lanes |= bit;
    }
}

template <class T>
void choose_matrices(SkinChunk<T>& c, const SolverSettings& settings, std::int64_t step) {
    if (const bool keeps = may_keep_matrix(c, settings); keeps != c.keeps_matrix) {
        c.keeps_matrix = keeps;
        if (c.shared_work >= 0) resize_fields(c);
    }
    const bool due = !c.keeps_matrix || step % settings.stiffness_steps == 0;
    for (int lane = 0; lane < c.width; ++lane) {
        T& kept = c.state.matrix_kept[std::size_t(lane)];
        const bool active = (active_lanes(c) >> lane) & 1u;  // blocks of lanes that are left out may be anything
        if (kept < T(0)) {
            // Neighbours are evaluated together: those that try again do so in the same steps.
            const auto every = std::max(std::int64_t(1), std::int64_t(c.state.matrix_wait[std::size_t(lane)]));
            if (kept < T(-1) || step % every == 0) kept += T(1);
        } else if (due || !active) {
            kept = T(0);
        }
    }
}

template <class T>
void settle_lanes(SkinChunk<T>& c, const SolverSettings& settings) {
    if (!settings.inertia) return;
    const unsigned near = near_lanes(c);
    for (int lane = 0; lane < c.width; ++lane) {
        const unsigned bit = 1u << lane;
        if (!(active_lanes(c) & bit) || (near & bit)) continue;
        ++c.free_steps[std::size_t(lane)];
        if (has_come_to_rest(c, lane, settings))
            fall_asleep(c, lane);
        else if (has_rest_shape(c, lane, settings))
            c.rigid_lanes |= bit;
    }
}

#define PALPATE_INSTANTIATE(T)                                                         \
    template void soften_lanes(SkinChunk<T>&, unsigned);                               \
    template void wake_lanes(SkinChunk<T>&, const SolverSettings&);                    \
    template void choose_samples(SkinChunk<T>&, const SolverSettings&);                \
    template void choose_tissue(SkinChunk<T>&, const SolverSettings&, std::int64_t);   \
    template void choose_matrices(SkinChunk<T>&, const SolverSettings&, std::int64_t); \
    template void settle_lanes(SkinChunk<T>&, const SolverSettings&);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
