#pragma once
// Unilateral contact with Coulomb friction at one sample, as augmented Lagrangians.

#include "engine/contact/shape.h"

namespace palpate {

/// Contact of one sample with one object. Multipliers are forces [N].
template <class R>
struct ContactState {
    R normal_multiplier;            ///< lambda_n >= 0 [N]
    Vec3<R> tangential_multiplier;  ///< lambda_t, in the tangent plane [N], along the sample's slip
    R friction_radius;              ///< mu times the normal force of the last multiplier update [N]
    Vec3<R> friction_normal;        ///< of the tangent plane of friction: the normal of the last multiplier update
};

template <class R>
struct ContactTerms {
    R energy;            ///< [J]
    Vec3<R> gradient;    ///< dE/dx [N]: minus the force on the sample
    Mat3<R> curvature;   ///< positive semidefinite; leaves out the curvature of the object's surface
    R normal_force;      ///< f_n = max(0, lambda_n - k g) [N]
    Vec3<R> tangential;  ///< friction's dE/dx: min(|s|, radius) s/|s|, s = lambda_t + k_slip slip [N]
};

/// Normal part: E = (max(0, lambda_n - k g)^2 - lambda_n^2) / 2k + friction: the contact is active by multiplier
/// minus stiffness times the current gap, never by a predicted gap.
template <class R>
inline ContactTerms<R> normal_terms(const SurfacePoint<R>& surface, const R& k, const R& normal_multiplier) {
    const R half(ScalarOf<R>(0.5));
    const R force = maximum(normal_multiplier - k * surface.distance, R(0));
    ContactTerms<R> t;
    t.normal_force = force;
    t.energy = half / k * (force * force - normal_multiplier * normal_multiplier);
    t.gradient = (-force) * surface.normal;
    t.curvature = select(force > R(0), k, R(0)) * outer(surface.normal, surface.normal);
    t.tangential = {R(0), R(0), R(0)};
    return t;
}

/// Friction: E = (|s|^2 - max(0, |s| - r)^2) / 2 k_slip for the slip u_t of this step. Radius and tangent plane
/// are lagged: were they to follow x, friction would have no potential and line searches would stall.
/// Curvature of friction that slides: with exactness 1 it has none along the slip; with 0 it has r / |s| k_slip in
/// every direction, the quadratic above the potential that touches it at the slip. Newton then never jumps over
/// the slip's end to the other side, and single iterations stay stable.
template <class R>
inline void add_friction(const Vec3<R>& slip, const R& k_slip, const ContactState<R>& state, const R& exactness,
                         ContactTerms<R>& t) {
    const R half(ScalarOf<R>(0.5));
    const Vec3<R>& n = state.friction_normal;
    const Vec3<R> slip_t = slip - dot(n, slip) * n;
    const Vec3<R> multiplier = state.tangential_multiplier - dot(n, state.tangential_multiplier) * n;
    const Vec3<R> s = multiplier + k_slip * slip_t;
    const R length = norm(s);
    // Without slip and without contact, too: what does not touch has no stiffness.
    const MaskOf<R> slides = length >= state.friction_radius;
    const R safe = select(length > R(0), length, R(1));
    const R scale = select(slides, state.friction_radius / safe, R(1));
    const R over = select(slides, length - state.friction_radius, R(0));
    t.energy += half / k_slip * (length * length - over * over);
    t.tangential = scale * s;
    t.gradient += t.tangential;
    const Vec3<R> direction = (R(1) / safe) * s;
    const Mat3<R> tangent_plane = Mat3<R>::identity() - outer(n, n);
    t.curvature = t.curvature +
                  (k_slip * scale) * (tangent_plane - select(slides, exactness, R(0)) * outer(direction, direction));
}

/// Both.
template <class R>
inline ContactTerms<R> contact_terms(const SurfacePoint<R>& surface, const Vec3<R>& slip, const R& k, const R& k_slip,
                                     const ContactState<R>& state, bool with_friction, const R& exactness) {
    ContactTerms<R> t = normal_terms(surface, k, state.normal_multiplier);
    if (with_friction) add_friction(slip, k_slip, state, exactness, t);
    return t;
}

}  // namespace palpate
