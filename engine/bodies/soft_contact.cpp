#include "engine/bodies/soft_contact.h"

#include <algorithm>
#include <cmath>

namespace palpate {

namespace {

/// Penalties of contact with soft objects grow to no more than so many times the base: what they couple is solved by
/// conjugate gradients, and the multipliers do the rest.
constexpr double stiffest_soft = 16;
/// A sample left deeper in a soft object than this is not where the solve says [m].
constexpr double too_deep = 1e-4;

/// Number of a chunk among the coupled ones; -1: not coupled.
int coupled_of(const BodyWork& w, bool single_precision, int chunk) {
    const int index = single_precision ? int(w.chunks.doubles.size()) + chunk : chunk;
    const auto at = std::find(w.s.coupled.begin(), w.s.coupled.end(), index);
    return at == w.s.coupled.end() ? -1 : int(at - w.s.coupled.begin());
}

/// Calls visit(chunk, lane) for a pair's finger, then for its soft object.
template <class Visit>
void for_both(const BodyWork& w, const SoftPair& p, Visit visit) {
    const Skin& finger = w.skins[std::size_t(p.finger)];
    w.chunks.with(finger.single_precision, finger.chunk, [&](auto& c) { visit(c, finger.lane); });
    const Skin& soft = w.soft.all[std::size_t(p.soft)].skin;
    visit(w.chunks.doubles[std::size_t(soft.chunk)], soft.lane);
}

template <class T>
Vec3<double> point_of(const SkinChunk<T>& c, int lane, const Stencil& s) {
    Vec3<double> x = lane_origin(c, lane);
    for (std::size_t k = 0; k < std::size_t(s.count); ++k)
        for (int d = 0; d < 3; ++d)
            x[d] += s.weight[k] * double(c.state.position[std::size_t((3 * s.node[k] + d) * c.width + lane)]);
    return x;
}

/// Adds a gradient at a point of a lane to its nodes; of nodes that the bone holds, to the bone.
template <class T>
void add_gradient(SkinChunk<T>& c, int lane, const Stencil& s, const Vec3<double>& g) {
    const SkinTopology& t = *c.topology;
    auto add = [&](int unknown, const Vec3<double>& v) {
        for (int d = 0; d < 3; ++d) c.scratch.gradient[std::size_t((3 * unknown + d) * c.width + lane)] += T(v[d]);
    };
    for (std::size_t k = 0; k < std::size_t(s.count); ++k) {
        const Vec3<double> share = s.weight[k] * g;
        add(s.node[k], share);
        if (t.elimination[std::size_t(s.node[k])] >= 0) continue;
        Vec3<double> arm;
        for (int d = 0; d < 3; ++d)
            arm[d] = double(c.state.position[std::size_t((3 * s.node[k] + d) * c.width + lane)]) -
                     double(c.state.bone[std::size_t(d * c.width + lane)]);
        add(t.bone_position, share);
        add(t.bone_rotation, cross(arm, share));
    }
}

/// And its curvature to the lane's own matrix. The bone of a node that is held counts as still.
template <class T>
void add_curvature(SkinChunk<T>& c, int lane, const Stencil& s, const Mat3<double>& K) {
    for (std::size_t k = 0, i = 0; i < std::size_t(s.count); ++i)
        for (std::size_t j = 0; j <= i; ++j, ++k) {
            if (s.block[k] < 0) continue;
            T* block = &c.scratch.blocks[9 * std::size_t(s.block[k]) * std::size_t(c.width) + std::size_t(lane)];
            for (int e = 0; e < 9; ++e) block[e * c.width] += T(s.weight[i] * s.weight[j] * K.m[e / 3][e % 3]);
        }
}

/// Penalty of a lane's contacts, and what slip meets [N/m].
struct Penalty {
    double normal, slip;
};
template <class T>
Penalty penalty_of(const SkinChunk<T>& c, int lane, std::size_t sample) {
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    const double base = double(c.rest.contact_penalty[sample * W + l]), scale = double(c.state.penalty_scale[W + l]);
    return {base * std::min(scale, stiffest_soft), base * std::min(scale, fitted::largest_slip_scale)};
}
double in_series(double a, double b) { return a * b / (a + b); }

/// How much nearer a curved skin is at a sample than its flat faces [m].
template <class T>
double rise_of(const SkinChunk<T>& c, int lane, std::size_t sample, const Vec3<double>& normal) {
    if (c.scratch.bulge.empty()) return 0;
    const SkinTopology& t = *c.topology;
    auto at = [&](std::size_t s) {
        const T* bulge = &c.scratch.bulge[3 * s * std::size_t(c.width) + std::size_t(lane)];
        return std::max(
            0.0, -dot(Vec3<double>{double(bulge[0]), double(bulge[c.width]), double(bulge[2 * c.width])}, normal));
    };
    if (sample < t.samples.size()) return at(sample);
    const FaceSample& f = t.face_samples[sample - t.samples.size()];
    double rise = 0;
    for (std::size_t k = 0; k < 3; ++k) rise += f.weight[k] * at(std::size_t(f.sample[k]));
    return rise;
}

/// Contact of one sample as it is now; `rise`: how much nearer the finger's skin is.
void evaluate_sample(SoftSample& s, const Vec3<double>& of_finger, const Vec3<double>& of_face, double rise,
                     const Penalty& a, const Penalty& b, bool rubs, double exactness) {
    const Vec3<double> apart = of_finger - of_face;
    const Vec3<double> slip = apart - (s.finger_start - s.face_start);
    s.gap = dot(s.normal, apart) - rise;
    s.slip = norm(slip - dot(s.normal, slip) * s.normal);
    const double k = in_series(a.normal, b.normal), k_slip = in_series(a.slip, b.slip);
    const Vec3<double>& tangential = s.state.tangential_multiplier;
    s.idle = s.state.normal_multiplier <= 0 && s.gap >= 0 &&
             !(rubs && (s.state.friction_radius > 0 || dot(tangential, tangential) > 0));
    if (s.idle) {
        s.terms = {0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
        return;
    }
    s.terms = contact_terms(SurfacePoint<double>{s.gap, s.normal}, slip, k, k_slip, s.state, rubs, exactness);
}

bool is_active(const Island& i) { return i.progress.active; }

/// Contact of a pair's samples where its lanes are now.
void evaluate_pair(BodyWork& w, SoftPair& p) {
    const Island& island = w.s.islands[std::size_t(p.island)];
    const Skin &finger = w.skins[std::size_t(p.finger)], &soft = w.soft.all[std::size_t(p.soft)].skin;
    const SkinChunk<double>& b = w.chunks.doubles[std::size_t(soft.chunk)];
    w.chunks.with(finger.single_precision, finger.chunk, [&](auto& a) {
        const Penalty soft_penalty = penalty_of(b, soft.lane, 0);
        for (std::size_t i = 0; i < p.samples.size(); ++i) {
            SoftSample& s = p.samples[i];
            if (!s.near) continue;
            evaluate_sample(s, point_of(a, finger.lane, s.of_finger), point_of(b, soft.lane, s.of_face),
                            rise_of(a, finger.lane, i, s.normal), penalty_of(a, finger.lane, i), soft_penalty,
                            p.friction > 0, island.progress.exactness);
        }
    });
}

/// Adds it to one of the pair's lanes. Energy and what is pending are an island's: they count with its finger.
template <class T>
void add_to_lane(SkinChunk<T>& c, int lane, const SoftPair& p, bool is_finger) {
    LaneReport& report = c.exchange.lanes[std::size_t(lane)];
    for (const SoftSample& s : p.samples) {
        if (!s.near || s.idle) continue;
        const Stencil& stencil = is_finger ? s.of_finger : s.of_face;
        add_gradient(c, lane, stencil, is_finger ? s.terms.gradient : -s.terms.gradient);
        if (report.steps) add_curvature(c, lane, stencil, s.terms.curvature);
        report.contact_force += s.terms.normal_force;
        report.penetration = std::max(report.penetration, -s.gap);
        if (!is_finger) continue;
        const double change = s.terms.normal_force - s.state.normal_multiplier;
        report.energy += s.terms.energy;
        report.pending += change * change;
        if (p.friction <= 0) continue;
        const Vec3<double> dt = s.terms.tangential - s.state.tangential_multiplier;
        const double dr = p.friction * s.terms.normal_force - s.state.friction_radius;
        report.pending += dot(dt, dt) + dr * dr;
    }
}

/// The residual of a lane once everything has been added to its gradient.
template <class T>
double residual_of(const SkinChunk<T>& c, int lane) {
    double sum = 0;
    for (int u : c.topology->unknowns) {
        const double arm = u == c.topology->bone_rotation ? double(c.rest.extent[std::size_t(lane)]) : 1;
        for (int d = 0; d < 3; ++d) {
            const double g = double(c.scratch.gradient[std::size_t((3 * u + d) * c.width + lane)]) / arm;
            sum += g * g;
        }
    }
    return sum;
}

void let_go(SoftPair& p) {
    for (SoftSample& s : p.samples) {
        s.state = {0, {0, 0, 0}, 0, s.normal};
        s.terms = {0, {0, 0, 0}, Mat3<double>::zero(), 0, {0, 0, 0}};
    }
}

}  // namespace

void begin_soft_contact(BodyWork& w) {
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[std::size_t(i)].soft = false;
    for (SoftPair& p : w.soft.pairs) {
        p.island = -1;
        if (!p.near) continue;
        const Skin& soft = w.soft.all[std::size_t(p.soft)].skin;
        const int k = coupled_of(w, soft.single_precision, soft.chunk);
        if (k < 0) continue;
        p.island = island_of(w, k, soft.lane);
        if (p.island < 0) continue;
        Island& island = w.s.islands[std::size_t(p.island)];
        island.soft = true;
        island.progress.further = std::max(0, fitted::least_soft_iterations - w.solver.newton_iterations);
    }
}

void add_soft_contact(BodyWork& w) {
    // A chunk is evaluated whole: lanes whose island has ended lose what they were given, and get it again.
    auto is_solved = [](const Island&) { return true; };
    auto for_evaluated = [&](const SoftPair& p, auto visit) {
        bool is_finger = true;
        for_both(w, p, [&](auto& c, int lane) {
            const bool single = sizeof(c.state.position[0]) < sizeof(double);
            const int chunk = (is_finger ? w.skins[std::size_t(p.finger)] : w.soft.all[std::size_t(p.soft)].skin).chunk;
            const int k = coupled_of(w, single, chunk);
            if (k >= 0 && lanes_where(w, k, is_active)) visit(c, lane, is_finger);
            is_finger = false;
        });
    };
    for (SoftPair& p : w.soft.pairs) {
        if (!solved_where(w, p, is_solved)) continue;
        if (solved_where(w, p, is_active)) evaluate_pair(w, p);
        for_evaluated(p, [&](auto& c, int lane, bool of_finger) { add_to_lane(c, lane, p, of_finger); });
    }
    for (const SoftPair& p : w.soft.pairs)
        if (solved_where(w, p, is_solved))
            for_evaluated(p, [](auto& c, int lane, bool) {
                c.exchange.lanes[std::size_t(lane)].residual = residual_of(c, lane);
            });
}

void update_soft_contact(BodyWork& w) {
    for (SoftPair& p : w.soft.pairs) {
        if (!solved_where(w, p, [](const Island& i) { return bool(i.decision.update); })) continue;
        for (SoftSample& s : p.samples)
            if (s.near)
                s.state = {s.terms.normal_force, s.terms.tangential, p.friction * s.terms.normal_force, s.normal};
    }
}

void end_soft_contact(BodyWork& w) {
    for (SoftPair& p : w.soft.pairs) {
        if (!p.near || p.island < 0) continue;
        bool reset = w.s.islands[std::size_t(p.island)].progress.failed;
        for_both(w, p, [&](auto& c, int lane) { reset |= c.status[std::size_t(lane)].reset; });
        if (reset) {
            let_go(p);
            continue;
        }
        bool deep = false;
        const Island& island = w.s.islands[std::size_t(p.island)];
        const double share = fitted::soft_gate * fitted::soft_gate;
        const bool takes = island.progress.converged || island.evaluation.residual <= share * island.evaluation.pending;
        for (SoftSample& s : p.samples) {
            if (!s.near) continue;
            deep |= s.gap < -too_deep;
            if (takes)
                s.state = {s.terms.normal_force, s.terms.tangential, p.friction * s.terms.normal_force, s.normal};
        }
        if (deep) for_both(w, p, [](auto& c, int lane) { c.status[std::size_t(lane)].converged = false; });
    }
}

void add_soft_coupling(const BodyWork& w, int island, const Eigen::VectorXd& x, Eigen::VectorXd& image) {
    auto here = [&](const SoftPair& p) { return p.near && p.island == island; };
    for (const SoftPair& p : w.soft.pairs) {
        if (!here(p)) continue;
        // First numbers of both lanes, and the places of their unknowns.
        int first[2];
        const std::vector<int>* place[2];
        int side = 0;
        const bool single[2] = {w.skins[std::size_t(p.finger)].single_precision, false};
        const int chunk[2] = {w.skins[std::size_t(p.finger)].chunk, w.soft.all[std::size_t(p.soft)].skin.chunk};
        for_both(w, p, [&](auto& c, int lane) {
            first[side] = w.soft.work.first[std::size_t(16 * coupled_of(w, single[side], chunk[side]) + lane)];
            place[side] = &c.topology->elimination;
            ++side;
        });
        auto at = [&](int of, const Stencil& s, std::size_t k) {
            const int e = (*place[of])[std::size_t(s.node[k])];
            return e < 0 ? -1 : first[of] + 3 * e;
        };
        auto value = [&](int of, const Stencil& s) {
            Vec3<double> v{0, 0, 0};
            for (std::size_t k = 0; k < std::size_t(s.count); ++k)
                if (const int n = at(of, s, k); n >= 0) v += s.weight[k] * Vec3<double>{x[n], x[n + 1], x[n + 2]};
            return v;
        };
        auto add = [&](int of, const Stencil& s, const Vec3<double>& v) {
            for (std::size_t k = 0; k < std::size_t(s.count); ++k)
                if (const int n = at(of, s, k); n >= 0)
                    for (int d = 0; d < 3; ++d) image[n + d] -= s.weight[k] * v[d];
        };
        for (const SoftSample& s : p.samples) {
            if (!s.near || s.idle) continue;
            const Vec3<double> a = value(0, s.of_finger), b = value(1, s.of_face);
            add(0, s.of_finger, s.terms.curvature * b);
            add(1, s.of_face, s.terms.curvature * a);
        }
    }
}

}  // namespace palpate
