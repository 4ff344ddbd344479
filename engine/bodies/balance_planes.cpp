// The planes between fingers at the end of a step: where the solve has left the fingers, each plane is put where forces
// and torques of both sides on it cancel. It has no mass: what is left over would be momentum from nowhere. After a
// step that has converged this moves it by next to nothing; after another, it makes action and reaction equal all the
// same.

#include <algorithm>
#include <cmath>

#include "engine/bodies/islands.h"
#include "engine/math/solve_definite.h"

namespace palpate {

namespace {

using Work = BodyWork;

template <class T>
Vec3<double> read(const LaneArray<T>& a, std::size_t index, std::size_t W, int lane) {
    const T* p = &a[3 * index * W + std::size_t(lane)];
    return {double(p[0]), double(p[W]), double(p[2 * W])};
}

/// A nodal array of positions at a sample, from the lane's origin.
template <class T>
Vec3<double> sample_of(const SkinChunk<T>& c, const LaneArray<T>& nodal, std::size_t s, int lane) {
    const SkinTopology& t = *c.topology;
    const auto W = std::size_t(c.width);
    if (s < t.samples.size()) return read(nodal, std::size_t(t.samples[s]), W, lane);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    // In the precision, and the order, in which the solve adds them up.
    Vec3<T> sum{0, 0, 0};
    for (std::size_t k = 0; k < 3; ++k) {
        const T* p = &nodal[3 * std::size_t(f.node[k]) * W + std::size_t(lane)];
        const Vec3<T> part = T(f.weight[k]) * Vec3<T>{p[0], p[W], p[2 * W]};
        sum = k == 0 ? part : sum + part;
    }
    return {double(sum.x), double(sum.y), double(sum.z)};
}

/// How much nearer a curved skin is at a sample [m].
template <class T>
double rise_of(const SkinChunk<T>& c, int slot, std::size_t s, int lane) {
    if (c.scratch.rise.empty()) return 0;
    const SkinTopology& t = *c.topology;
    auto at = [&](std::size_t sample) {
        const std::size_t i = std::size_t(slot) * t.samples.size() + sample;
        return c.scratch.rise[i * std::size_t(c.width) + std::size_t(lane)];
    };
    if (s < t.samples.size()) return double(at(s));
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    T sum = T(f.weight[0]) * at(std::size_t(f.sample[0]));  // in the precision, and the order, of the solve
    for (std::size_t k = 1; k < 3; ++k) sum += T(f.weight[k]) * at(std::size_t(f.sample[k]));
    return double(sum);
}

/// The slot of a lane that holds the plane to another finger.
template <class T>
int slot_of(const SkinChunk<T>& c, int lane, int finger) {
    for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
        if (c.contacts.at(slot, lane).finger == finger) return slot;
    return -1;
}

/// Calls visit(chunk, lane, slot, of_b) for both sides of a pair.
template <class Visit>
void for_both(const Work& w, const FingerPair& p, Visit visit) {
    for (const bool of_b : {false, true}) {
        const Skin& skin = w.skins[std::size_t(of_b ? p.b : p.a)];
        w.chunks.with(skin.single_precision, skin.chunk,
                      [&](auto& c) { visit(c, skin.lane, slot_of(c, skin.lane, of_b ? p.a : p.b), of_b); });
    }
}

template <class T>
void collect(const Work& w, const SkinChunk<T>& c, int lane, int slot, bool of_b, FingerPairs& pairs,
             const Pose<double>& start) {
    const auto W = std::size_t(c.width), S = c.topology->sample_count();
    const bool fine = (c.fine_lanes >> lane) & 1u, rubs = c.has_friction && w.pairs.friction > 0;
    const double scale = double(c.state.penalty_scale[W + std::size_t(lane)]);
    const Vec3<double> origin = lane_origin(c, lane);
    const Pose<double> side = plane_side(start, of_b);
    for (std::size_t s = 0; s < (fine ? S : c.topology->samples.size()); ++s) {
        const std::size_t i = (std::size_t(slot) * S + s) * W + std::size_t(lane);
        PlaneSample& p = pairs.samples.emplace_back();
        p.of_b = of_b;
        p.number = std::size_t(slot) * S + s;
        p.x = origin + sample_of(c, c.state.position, s, lane);
        p.normal_multiplier = double(c.state.normal_multiplier[i]);
        p.offset = double(c.state.contact_offset[i]) + rise_of(c, slot, s, lane);
        const double base = double(c.rest.contact_penalty[s * W + std::size_t(lane)]);
        p.k = base * scale;
        p.k_slip = base * std::min(scale, fitted::largest_slip_scale);
        p.holds = p.normal_multiplier > 0;
        if (!rubs) continue;
        p.before = inverse_transform(side, origin + sample_of(c, c.scratch.start_position, s, lane));
        p.friction_radius = double(c.state.friction_radius[i]);
        p.tangential_multiplier = read(c.state.tangential_multiplier, p.number, W, lane);
        p.friction_normal = read(c.state.friction_normal, p.number, W, lane);
        p.holds |= p.friction_radius > 0 || dot(p.tangential_multiplier, p.tangential_multiplier) > 0;
    }
}

/// Whether a sample does anything against the plane: most do not.
bool acts(const PlaneSample& p, const Pose<double>& side, const Vec3<double>& normal) {
    return p.holds || dot(normal, p.x - side.position) < p.offset;
}

/// What one sample does against the plane, as sample_contact.h has it.
ContactTerms<double> terms_of(const PlaneSample& p, const Pose<double>& side, const Mat3<double>& R, bool rubs) {
    const Vec3<double> local = transposed_times(R, p.x - side.position);
    const double distance = local.z - p.offset;
    const ContactState<double> state{p.normal_multiplier, R * p.tangential_multiplier, p.friction_radius,
                                     R * p.friction_normal};
    const SurfacePoint<double> surface{distance, R.column(2)};
    return contact_terms(surface, R * (local - p.before), p.k, p.k_slip, state, rubs, 1.0);
}

/// Energy of the contacts by the plane's motions.
struct PlaneTerms {
    double energy = 0, force = 0;
    double size = 0;  ///< sum of the energies' magnitudes: what rounding is relative to [J]
    Motion gradient = Motion::Zero();
    MotionMatrix curvature = MotionMatrix::Zero();
};
PlaneTerms evaluate_plane(const FingerPairs& pairs, const Pose<double>& plane) {
    PlaneTerms out;
    const Pose<double> sides[2] = {plane_side(plane, false), plane_side(plane, true)};
    const Mat3<double> R[2] = {rotation_matrix(sides[0].rotation), rotation_matrix(sides[1].rotation)};
    const Vec3<double> normals[2] = {R[0].column(2), R[1].column(2)};
    for (const PlaneSample& p : pairs.samples) {
        if (!acts(p, sides[p.of_b], normals[p.of_b])) continue;
        const ContactTerms<double> t = terms_of(p, sides[p.of_b], R[p.of_b], pairs.friction > 0);
        if (t.energy == 0 && t.normal_force == 0 && !(dot(t.gradient, t.gradient) > 0)) continue;
        const Eigen::Matrix<double, 3, 6> G = -point_motion(p.x - plane.position);
        const Eigen::Vector3d g(t.gradient.x, t.gradient.y, t.gradient.z);
        const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> K(&t.curvature.m[0][0]);
        out.energy += t.energy;
        out.size += std::abs(t.energy);
        out.force += g.norm();
        out.gradient += G.transpose() * g;
        out.curvature += G.transpose() * (K * G);
    }
    return out;
}

void find_gradients(FingerPairs& pairs, const Pose<double>& plane) {
    const Pose<double> sides[2] = {plane_side(plane, false), plane_side(plane, true)};
    const Mat3<double> R[2] = {rotation_matrix(sides[0].rotation), rotation_matrix(sides[1].rotation)};
    const Vec3<double> normals[2] = {R[0].column(2), R[1].column(2)};
    for (PlaneSample& p : pairs.samples) {
        p.gradient = {0, 0, 0};
        if (acts(p, sides[p.of_b], normals[p.of_b]))
            p.gradient = terms_of(p, sides[p.of_b], R[p.of_b], pairs.friction > 0).gradient;
    }
}

double imbalance(const Motion& gradient) { return gradient.head<3>().norm() + gradient.tail<3>().norm() / plane_size; }

/// Newton on the six motions of the plane, fingers as they are, damped where it leads nowhere (Levenberg-Marquardt):
/// where both sides slide, the potential is a valley that is nearly flat along the slip.
Pose<double> balanced(const FingerPairs& pairs, Pose<double> plane) {
    using namespace fitted;
    PlaneTerms here = evaluate_plane(pairs, plane);
    double damping = least_plane_damping;
    for (int k = 0; k < most_plane_steps && imbalance(here.gradient) > plane_balance * here.force &&
                    damping < largest_plane_damping;
         ++k) {
        MotionMatrix H = here.curvature;
        const double slack = damping * (H.diagonal().head<3>().maxCoeff() + 1);
        for (int d = 0; d < 6; ++d) H(d, d) += d < 3 ? slack : slack * plane_size * plane_size;
        Motion step = -here.gradient;
        if (!solve_definite(H, step)) {
            damping *= more_plane_damping;
            continue;
        }
        const Pose<double> tried = moved(plane, step, 1);
        const PlaneTerms there = evaluate_plane(pairs, tried);
        // At the rounding of energies, the forces tell whether a step leads on.
        const bool rounded = std::abs(there.energy - here.energy) < 1e-13 * here.size;
        const bool better =
            rounded ? imbalance(there.gradient) < 0.9 * imbalance(here.gradient) : there.energy < here.energy;
        if (better) plane = tried, here = there;
        damping = better ? std::max(least_plane_damping, less_plane_damping * damping) : more_plane_damping * damping;
    }
    return plane;
}

/// One correction of settle_rest. False where nothing was left to correct.
bool correct_rest(FingerPairs& pairs, const Pose<double>& plane, bool rubs) {
    Motion left = Motion::Zero();
    MotionMatrix M = MotionMatrix::Zero();
    double force = 0;
    const Vec3<double> z = rotation_matrix(plane.rotation).column(2);
    const Eigen::Vector3d n(z.x, z.y, z.z);
    auto motion_at = [&](const PlaneSample& p) {
        Eigen::Matrix<double, 3, 6> P = point_motion(p.x - plane.position);
        P.rightCols<3>() /= plane_size;
        if (!rubs) P = (n * (n.transpose() * P)).eval();
        return P;
    };
    for (const PlaneSample& p : pairs.samples) {
        const Eigen::Vector3d g(p.gradient.x, p.gradient.y, p.gradient.z);
        if (!(g.norm() > 0)) continue;
        const Eigen::Matrix<double, 3, 6> P = motion_at(p);
        left += P.transpose() * g;
        M += g.norm() * (P.transpose() * P);
        force += g.norm();
    }
    if (!(left.norm() > 1e-9 * force) || !left.allFinite()) return false;
    // Where all samples leave the plane a motion, nothing is left along it: what keeps the matrix definite does not
    // matter.
    M.diagonal().array() += 1e-12 * M.trace();
    Motion y = -left;
    if (!solve_definite(M, y)) return false;
    for (PlaneSample& p : pairs.samples) {
        const double share = norm(p.gradient);
        if (!(share > 0)) continue;
        const Eigen::Vector3d change = share * (motion_at(p) * y);
        p.gradient += Vec3<double>{change.x(), change.y(), change.z()};
        // Nothing pulls: a's samples press against z, b's along it.
        if (const double along = dot(p.gradient, z); p.of_b ? along < 0 : along > 0) p.gradient -= along * z;
    }
    return true;
}

/// What little is left over, as where both sides slide and differ in what they may bear, is taken from all samples by
/// the force that they bear: the least change that leaves neither a force nor a torque on the plane. Where that cannot
/// be without a pull, as in steps that are far from solved, the two let go of each other.
void settle_rest(FingerPairs& pairs, const Pose<double>& plane, bool rubs) {
    for (int k = 0; k < 8; ++k)
        if (!correct_rest(pairs, plane, rubs)) return;
    for (PlaneSample& p : pairs.samples) p.gradient = {0, 0, 0};
}

/// The fingers keep the forces that they have against the plane where it is now; what that adds to their residuals is
/// said.
template <class T>
void keep_forces(const Work& w, SkinChunk<T>& c, int lane, bool of_b, const Pose<double>& plane, FingerPair& pair,
                 Island& pair_island, double& load) {
    const auto W = std::size_t(c.width);
    const Pose<double> side = plane_side(plane, of_b);
    const Mat3<double> R = rotation_matrix(side.rotation);
    const bool rubs = c.has_friction && w.pairs.friction > 0;
    double added = 0;
    for (const PlaneSample& p : w.pairs.samples) {
        if (p.of_b != of_b) continue;
        const std::size_t i = p.number * W + std::size_t(lane);
        const Vec3<double> change = p.gradient - p.first_gradient, local = transposed_times(R, p.gradient);
        added += dot(change, change);
        // Along the plane's normal a sample bears -local.z, friction the rest.
        const double normal_force = std::max(0.0, -local.z);
        c.scratch.normal_candidate[i] = T(normal_force);
        pair.touching |= normal_force > 0;
        load += normal_force;
        if (normal_force > 0) pair.centre += (normal_force / load) * (p.x - pair.centre);
        if (!rubs) continue;
        const Vec3<double> tangential{local.x, local.y, 0};
        for (int d = 0; d < 3; ++d) {
            c.scratch.tangential_candidate[(3 * p.number + std::size_t(d)) * W + std::size_t(lane)] = T(tangential[d]);
            c.scratch.contact_normal[(3 * p.number + std::size_t(d)) * W + std::size_t(lane)] = T(d == 2);
        }
    }
    double& residual = c.exchange.lanes[std::size_t(lane)].residual;  // squared
    const double more = std::sqrt(residual) + std::sqrt(added);
    if (added > 0) residual = more * more;
    // Where the solve was done, next to nothing changes.
    const double scale = std::max({load, c.exchange.lanes[std::size_t(lane)].coupling_force, 0.01});
    if (added > scale * scale * fitted::plane_correction) pair_island.progress.converged = false;
}

bool has_failed(const Work& w, std::size_t plane) { return w.s.islands[w.s.bodies[plane].island].progress.failed; }

}  // namespace

void balance_planes(BodyWork& w) {
    FingerPairs& pairs = w.pairs;
    for (std::size_t k = 0; k < pairs.near.size(); ++k) {
        FingerPair& pair = pairs.near[k];
        const std::size_t plane = w.bodies.size() + k;
        BodyProgress& b = w.s.bodies[plane];
        pair.touching = false;
        if (has_failed(w, plane)) continue;
        pairs.samples.clear();
        for_both(w, pair,
                 [&](auto& c, int lane, int slot, bool of_b) { collect(w, c, lane, slot, of_b, pairs, b.start); });
        find_gradients(pairs, b.pose);
        for (PlaneSample& p : pairs.samples) p.first_gradient = p.gradient;
        b.pose = balanced(pairs, b.pose);
        find_gradients(pairs, b.pose);
        settle_rest(pairs, b.pose, pairs.friction > 0);
        pair.centre = b.pose.position;
        double load = 0;
        for_both(w, pair, [&](auto& c, int lane, int, bool of_b) {
            keep_forces(w, c, lane, of_b, b.pose, pair, w.s.islands[std::size_t(b.island)], load);
        });
    }
}

}  // namespace palpate
