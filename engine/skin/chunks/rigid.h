#pragma once
// The step of skins that move with their bones as one body.

#include "engine/skin/solve/evaluate.h"

namespace palpate {

/// Moves the bones of the rigid lanes by one step: implicit Euler of one rigid body on the bone's springs. Torques need
/// a few Newton iterations, each lane as many as it would take alone.
template <class R>
void move_rigid(SkinChunk<ScalarOf<R>>& c, const SolverSettings& settings) {
    using namespace detail;
    using T = ScalarOf<R>;
    constexpr int W = lane_width<R>;
    alignas(64) std::array<T, W> mass,
        inertia;  // of the skin, which coasts as the bone does: to the target of the third spring
    const double per_dt2 = 1 / (settings.dt * settings.dt);
    for (int l = 0; l < W; ++l) mass[l] = T(c.skin_mass[l] * per_dt2), inertia[l] = T(c.skin_inertia[l] * per_dt2);

    const Pose<R> before = load_pose<R>(c.state.bone.data());
    const R dt = R(T(settings.dt));
    R linear = load<R>(mass.data());
    Vec3<R> pull = linear * (dt * load_vec3<R>(c.state.bone_velocity.data()));
    PoseSpring<R> turning[bone_spring_count];
    for (int s = 0; s < bone_spring_count; ++s) {
        const T* p = &c.scratch.bone_springs[9 * s * W];
        const R stiffness = load<R>(p);
        turning[s] = {R(T(0)), load<R>(p + W), load_pose<R>(p + 2 * W)};
        const Vec3<R> to_target = turning[s].target.position - before.position;
        pull += stiffness * to_target;
        linear += stiffness;
    }
    turning[0].half_turn = load<R>(&c.scratch.coupling_reach[W]);
    turning[2].angular_stiffness += load<R>(inertia.data());
    Vec3<R> displacement = R(T(1)) / linear * pull;
    // Where the coupling would draw harder than it may, it draws as hard as it may, the same way.
    const R coupling = load<R>(&c.scratch.bone_springs[0]), reach = load<R>(&c.scratch.coupling_reach[0]);
    const Vec3<R> left = turning[0].target.position - before.position - displacement;
    const R distance = norm(left);
    const MaskOf<R> held = distance > reach;
    if (any(held))
        displacement =
            displacement - select(held, coupling * (R(T(1)) - reach / distance) / (linear - coupling), R(T(0))) * left;

    Pose<R> bone{before.position + displacement, before.rotation};
    MaskOf<R> turns = mask_from_bits<R>(c.rigid_lanes);
    for (int newton = 0; newton < 4 && any(turns); ++newton) {
        Vec3<R> torque{R(T(0)), R(T(0)), R(T(0))};
        R curvature = R(T(0));
        for (const PoseSpring<R>& spring : turning) {
            const PoseTerms<R> terms = pose_spring(spring, bone);
            torque += terms.torque;
            curvature += terms.angular_curvature;
        }
        turns = turns & (curvature > R(T(0)));
        const Vec3<R> turn = select(turns, R(T(-1)) / curvature * torque, Vec3<R>{R(T(0)), R(T(0)), R(T(0))});
        const Quaternion<R> next = normalised(rotation_step(turn) * bone.rotation);
        bone.rotation = {select(turns, next.w, bone.rotation.w), select(turns, next.x, bone.rotation.x),
                         select(turns, next.y, bone.rotation.y), select(turns, next.z, bone.rotation.z)};
        turns = turns & (dot(turn, turn) >= R(T(1e-16)));  // what is left is its square
    }

    const Quaternion<R> turn = bone.rotation * conjugate(before.rotation);
    const Vec3<R> spin = R(T(1)) / (dt * maximum(absolute(turn.w), R(T(0.1)))) * shorter_twice_vector(turn);
    const MaskOf<R> rigid = mask_from_bits<R>(c.rigid_lanes);
    const unsigned lost = c.rigid_lanes & ~bits_from_mask<R>(finite(dot(displacement, displacement) + dot(spin, spin)));
    auto keep = [&](LaneArray<T>& a, int first, const Vec3<R>& v) {
        store_vec3<R>(&a[first * W], select(rigid, v, load_vec3<R>(&a[first * W])));
    };
    keep(c.state.bone_velocity, 0, R(T(1)) / dt * displacement);
    keep(c.state.bone_velocity, 3, spin);
    const R next[7] = {bone.position.x, bone.position.y, bone.position.z, bone.rotation.w,
                       bone.rotation.x, bone.rotation.y, bone.rotation.z};
    for (int i = 0; i < 7; ++i) {
        T* p = &c.state.bone[i * W];
        store<R>(p, select(rigid, next[i], load<R>(p)));
    }
    for (int l = 0; l < W; ++l) {
        if (!((c.rigid_lanes >> l) & 1u)) continue;
        c.status[l] = {};
        c.status[l].converged = true;
        if (!((lost >> l) & 1u)) continue;
        c.status[l].reset = true;  // to where it is to be, at rest
        for (int i = 0; i < 7; ++i) c.state.bone[i * W + l] = c.scratch.bone_springs[(2 + i) * W + l];
        for (int i = 0; i < 6; ++i) c.state.bone_velocity[i * W + l] = T(0);
    }
}

}  // namespace palpate
