// Bodies, planes between fingers, and the fingers that touch them, in one implicit solve: Newton on the sum of their
// incremental potentials. In each iteration a lane condenses its skin and bone onto the bodies it touches
// (skin/coupled.h), the bodies are solved on the sum, and lanes and bodies move together. Islands that do not touch
// each other iterate on their own.

#include <algorithm>
#include <cmath>

#include "engine/bodies/anchors.h"
#include "engine/bodies/directions.h"
#include "engine/bodies/pair_ends.h"
#include "engine/bodies/soft_contact.h"
#include "engine/skin/solve/newton.h"
#include "engine/skin/solve/progress.h"
#include "engine/systems.h"

namespace palpate {

namespace {

using Work = BodyWork;

/// A plane between fingers has no inertia, and where nothing rubs it slides freely: its Newton steps are held back by
/// this, which is little beside tissue, but more than rounding of what the lanes condense [N/m].
template <class T>
double plane_slack(const SkinChunk<T>& c, int lane) {
    const double penalty =
        double(c.rest.contact_penalty[std::size_t(lane)]) * double(c.state.penalty_scale[std::size_t(c.width + lane)]);
    return fitted::plane_tissue_share * double(c.rest.tissue_stiffness[std::size_t(lane)]) +
           fitted::plane_roundings * double(std::numeric_limits<T>::epsilon()) * penalty;
}

/// A lane's matrix is not to be kept, for so many steps (kept_matrix.h).
template <class T>
void forget_matrix(SkinChunk<T>& c, int lane, int steps) {
    T& kept = c.state.matrix_kept[std::size_t(lane)];
    kept = std::min(kept, T(-steps));
}

/// Notes islands that kept matrices have led on, and hardly nearer to the solution: too much changes for them. The
/// iteration is not counted.
void find_slow_islands(Work& w) {
    for (int i = 0; i < w.s.island_count; ++i) w.s.islands[i].slow = false;
    for_each_lane(w, [&](const auto& c, int lane, Island& i) {
        if (c.keeps_matrix && c.state.matrix_kept[std::size_t(lane)] > 1) i.slow = true;
    });
    for (int i = 0; i < w.s.island_count; ++i) {
        Island& island = w.s.islands[i];
        auto& p = island.progress;
        island.slow = island.slow && p.active && p.iterations > 0 &&
                      island.evaluation.residual > detail::slow_share(w.solver, p) * p.base_residual &&
                      !detail::is_balanced_enough<double>(island.evaluation, w.solver, p);
        detail::take_back(p, island.slow);
    }
    for_each_lane(w, [&](auto& c, int lane, const Island& i) {
        const bool led = i.progress.active && i.progress.iterations > 0 && c.state.matrix_kept[std::size_t(lane)] > 1;
        if (led && !i.slow) c.state.matrix_wait[std::size_t(lane)] = 1;
    });
}

/// Their lanes have matrices of their own next.
void wait_with_matrices(Work& w) {
    for_each_lane(w, [&](auto& c, int lane, const Island& i) {
        if (!i.slow || i.progress.converged) return;
        auto& wait = c.state.matrix_wait[std::size_t(lane)];
        const int steps = std::max(int(wait), detail::fitted::unkept_steps);
        forget_matrix(c, lane, steps);
        wait = decltype(2 * wait)(std::min(2 * steps, detail::fitted::longest_wait));
    });
}

/// Contact between bodies.
void evaluate_pairs(Work& w) {
    for (BodyPair& p : w.s.pairs) {
        if (p.a < 0) continue;
        const detail::LaneProgress<double>& progress = island_of_pair(w, p).progress;
        if (!progress.active) continue;
        p.evaluation =
            evaluate_pair(p, features_of_pair(w.s, p), w.s.objects[p.a], w.s.objects[p.b], progress.exactness);
    }
}

/// Inertia, weight and contact between bodies, into their gradients and their islands.
void evaluate_bodies(Work& w) {
    BodySolve& s = w.s;
    auto active = [](const Island& i) { return i.progress.active; };
    for (std::size_t b = 0; b < s.bodies.size(); ++b) {
        Island& i = s.islands[s.bodies[b].island];
        if (!active(i)) continue;
        if (is_plane(w, int(b))) {
            s.bodies[b].inertia = {};
            s.bodies[b].gradient.setZero();
            continue;
        }
        if (w.solver.inertia)
            s.bodies[b].inertia = body_inertia(w.bodies[b], s.bodies[b].target, s.bodies[b].pose, w.solver.dt);
        else
            evaluate_anchor(w, w.bodies[b], s.bodies[b]);
        s.bodies[b].gradient = s.bodies[b].inertia.gradient;
        i.evaluation.energy += s.bodies[b].inertia.energy;
        const double weight = 9.81 * w.bodies[b].mass;
        i.evaluation.force_floor = std::min(i.evaluation.force_floor, weight);
        // What is left unbalanced moves a light body, however hard it is gripped.
        i.evaluation.residual_cap = std::min(i.evaluation.residual_cap, fitted::unbalanced_weight * weight);
    }
    for (BodyPair& p : s.pairs) {
        if (p.a < 0) continue;
        Island& i = island_of_pair(w, p);
        if (!active(i)) continue;
        const PairEvaluation& e = p.evaluation;
        i.evaluation.energy += e.energy;
        i.evaluation.pending += e.pending;
        i.evaluation.contact_force += e.contact_force;
        i.evaluation.penetration = std::max(i.evaluation.penetration, e.penetration);
        for (const FeatureContact& c : p.contacts)
            for (const PairTerm& t : c.terms)
                if (t.acts)
                    for_each_end(w, p, t, [&](BodyProgress& body, const auto& G) {
                        body.gradient += G.transpose() * eigen(t.gradient);
                    });
    }
}

/// Everything at the current positions and poses: energies, gradients, and what each island makes of them. Lanes of the
/// islands that step next have a matrix.
template <class Steps>
void evaluate_all(Work& w, Steps steps) {
    BodySolve& s = w.s;
    auto active = [](const Island& i) { return i.progress.active; };
    for (int i = 0; i < s.island_count; ++i)
        if (active(s.islands[i])) {
            s.islands[i].evaluation = {};
            s.islands[i].evaluation.extent = 0;
            s.islands[i].rounding = 0;
        }
    place_bodies(w, false);
    for_each_lane(w, [&](auto& c, int lane, const Island& i) {
        c.exchange.lanes[lane].exactness = i.progress.exactness;
        c.exchange.lanes[lane].steps = steps(i);
        if (steps(i) && (i.progress.damping > 0 || i.progress.iterations >= detail::fitted::kept_iterations))
            forget_matrix(c, lane, 0);
    });
    for_each_chunk(
        w, active, [&](auto& c, const auto& kernel, unsigned) { kernel.evaluate(c, w.solver); },
        [&] { evaluate_pairs(w); });
    add_soft_contact(w);
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (active(i) && ((c.linear.left_lanes >> lane) & 1u)) detail::forget_energy<double>(i.progress, true);
    });
    evaluate_bodies(w);
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (!active(i)) return;
        const LaneReport& r = c.exchange.lanes[lane];
        Evaluation<double>& e = i.evaluation;
        if (sizeof(c.state.position[0]) < sizeof(double)) e.epsilon = std::numeric_limits<float>::epsilon();
        e.energy += r.energy, e.residual += r.residual, e.pending += r.pending, e.limited += r.limited;
        e.violation = std::max(e.violation, r.violation), e.penetration = std::max(e.penetration, r.penetration);
        e.extent = std::max(e.extent, double(c.rest.extent[std::size_t(lane)]));
        e.contact_force += r.contact_force, e.coupling_force = std::max(e.coupling_force, r.coupling_force);
        const bool on_body = !i.bodies.empty() && !is_plane(w, i.bodies[0]);
        const bool single = sizeof(c.state.position[0]) < sizeof(double);
        i.rounding += (on_body && single ? fitted::body_roundings_float : 1) * r.rounding;
        // A large object at rest has an energy of nothing but its elements' roundings.
        if (i.soft) e.rounding += e.epsilon * double(c.rest.tissue_stiffness[std::size_t(lane)]) * e.extent * e.extent;
        const double slack = plane_slack(c, lane);
        for_each_body_of(w, c, lane, [&](int slot, BodyProgress& b) {
            for (int k = 0; k < 6; ++k) b.gradient[k] += c.exchange.body_gradient[(6 * slot + k) * c.width + lane];
            if (c.contacts.at(slot, lane).finger < 0) return;
            for (int k = 0; k < 6; ++k) {
                double& own = b.inertia.curvature(k, k);
                own = std::max(own, k < 3 ? slack : slack * plane_size * plane_size);
            }
        });
    });
    for (std::size_t b = 0; b < s.bodies.size(); ++b) {
        Island& island = s.islands[s.bodies[b].island];
        if (!active(island)) continue;  // what it ended with stays as it was
        const Motion& g = s.bodies[b].gradient;
        Evaluation<double>& e = island.evaluation;
        const double size = size_of(w, int(b));
        if (!is_plane(w, int(b))) e.extent = std::max(e.extent, size);
        e.residual += g.head<3>().squaredNorm() + g.tail<3>().squaredNorm() / (size * size);
    }
}

/// Islands that have a direction begin a line search along it; the others evaluate again.
void judge_directions(Work& w) {
    BodySolve& s = w.s;
    for (int i = 0; i < s.island_count; ++i) s.islands[i].linear = s.islands[i].unbound = false;
    for_each_lane(
        w, [](auto& c, int lane, Island& i) { i.linear |= ((c.linear_lanes | c.linear.fresh_lanes) >> lane) & 1u; });
    for (int i = 0; i < s.island_count; ++i) {
        Island& island = s.islands[i];
        if (!island.decision.newton) continue;
        const auto verdict = detail::judge_direction<double>(island.progress, true, island.linear, island.bad_pivots,
                                                             island.slope, island.evaluation);
        island.unbound = verdict.unbound;
        island.decision.newton = verdict.step;
        if (verdict.step)
            for (int b : island.bodies) s.bodies[b].base = s.bodies[b].pose;
    }
    for_each_lane(w, [](auto& c, int lane, const Island& i) {
        if (i.unbound) leave_linear_tissue(c, 1u << lane);
    });
}

/// Directions of the islands that take a Newton step (directions.h), from gradients as they are.
void begin_directions(Work& w) {
    BodySolve& s = w.s;
    auto newton = [](const Island& i) { return bool(i.decision.newton); };
    for (int i = 0; i < s.island_count; ++i)
        if (newton(s.islands[i])) detail::adapt_damping<double>(s.islands[i].progress, true);
    for_each_lane(w, [](auto& c, int lane, const Island& i) { c.exchange.lanes[lane].damping = i.progress.damping; });
    for (BodyProgress& b : s.bodies) b.rhs = -b.gradient;
    // The lanes' part of the bodies' gradient comes with what they condense; planes have no other.
    for (std::size_t b = w.bodies.size(); b < s.bodies.size(); ++b) s.bodies[b].rhs.setZero();
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (!newton(i)) return;
        for_each_body_of(w, c, lane, [&](int slot, BodyProgress& b) {
            if (c.contacts.at(slot, lane).finger >= 0) return;
            for (int k = 0; k < 6; ++k) b.rhs[k] += c.exchange.body_gradient[(6 * slot + k) * c.width + lane];
        });
    });
}

void move_all(Work& w) {
    auto moves = [](const Island& i) { return i.decision.newton || i.decision.retry; };
    for_each_lane(w, [](auto& c, int lane, const Island& i) { c.exchange.lanes[lane].alpha = i.progress.alpha; });
    for (int k = 0; k < int(w.s.coupled.size()); ++k) {
        const unsigned fresh = lanes_where(w, k, [](const Island& i) { return bool(i.decision.newton); });
        const unsigned all = lanes_where(w, k, moves);
        if (all) with_chunk(w, k, [&](auto& c, const auto& kernel) { kernel.move(c, all, fresh); });
    }
    for (BodyProgress& b : w.s.bodies) {
        const Island& i = w.s.islands[b.island];
        if (moves(i)) b.pose = moved(b.base, b.step, i.progress.alpha);
    }
}

void update_all(Work& w) {
    auto updates = [](const Island& i) { return bool(i.decision.update); };
    for_each_chunk(w, updates, [&](auto& c, const auto& kernel, unsigned lanes) { kernel.update(c, w.solver, lanes); });
    for (BodyPair& p : w.s.pairs)
        if (p.a >= 0 && updates(island_of_pair(w, p))) update_pair(p, false);
    update_soft_contact(w);
    if (!w.solver.inertia)
        for (int i = 0; i < w.s.island_count; ++i)
            if (updates(w.s.islands[i])) recast_anchors(w, w.s.islands[i]);
    for (int i = 0; i < w.s.island_count; ++i)
        detail::count_update<double>(w.s.islands[i].progress, w.s.islands[i].decision.update);
}

/// Where update after update leaves an overlap as it was, what bears it is jammed, and forces would grow without bound
/// (towers of bodies that fall in steps of 20 ms: 1e15 N after six updates at 4 mm, 1e65 N after 140 at 0.07 mm): there
/// are no more. Nor are there any of what is deep before its forces balance: what such an overlap bears may be a place
/// that Newton is only passing through, where a multiplier keeps it (random scene 2125733, in single precision: a can
/// between a box and a finger that meet at 6 m/s, 3 mm deep in an update, bore 1e8 N after eight more).
void stop_where_jammed(const Work& w, Island& i) {
    if (!i.decision.update) return;
    const bool deep = i.evaluation.penetration > fitted::jam_depth;
    if (deep && std::sqrt(i.evaluation.residual) > fitted::deep_gate * i.evaluation.contact_force) {
        i.decision.update = false;
        i.decision.newton = true;
        return;
    }
    const double depth = i.evaluation.penetration / w.solver.contact_tolerance;
    const bool stays = depth > 1 && depth > fitted::jam_share * i.progress.last_depth;
    i.vain_updates = stays ? i.vain_updates + 1 : 0;
    i.progress.last_depth = depth;
    if (i.vain_updates < (deep ? 1 : fitted::most_vain_updates)) return;
    i.decision.update = false;
    i.progress.active = i.decision.newton;
}

/// Stiffness that a strain limit of scale one gives the smallest, or softest, element of a lane [N/m].
template <class T>
double least_limit_stiffness(const SkinChunk<T>& c, int lane) {
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    double least = HUGE_VAL;  // cubed
    for (std::size_t e = 0; e < c.topology->elements.size(); ++e) {
        const double penalty = double(c.rest.limit_penalty[e * W + l]);
        least = std::min(least, penalty * penalty * penalty * 8.5 * double(c.rest.volume[e * W + l]));
    }
    return std::cbrt(least);
}

/// What a body presses on tissue at its limits with is its inertia: multipliers, which in a short solve are updated
/// once a step, integrate what penalties near or below mass / dt^2 leave open, and push on after the body has turned
/// back, so that it shakes in the grasp, or leaves with more energy than it brought. Penalties of such lanes are no
/// lower than that.
void stiffen_against_inertia(Work& w) {
    if (!w.solver.inertia) return;
    for_each_lane(w, [&](auto& c, int lane, const Island&) {
        if (!c.has_limits || c.status[std::size_t(lane)].limited_elements == 0) return;
        using T = std::remove_reference_t<decltype(c.state.penalty_scale[0])>;
        double mass = 0;
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot)
            if (const int body = c.contacts.at(slot, lane).body; body >= 0 && !is_plane(w, body))
                mass = std::max(mass, w.bodies[body].mass);
        if (mass == 0) return;
        const double inertia = mass / (w.solver.dt * w.solver.dt), kept = 0.7;  // begin_step lets them fall by so much
        const bool is_soft = double(c.scratch.bone_springs[std::size_t(lane)]) < fitted::stiffly_held;
        const double most = is_soft          ? fitted::softly_held_scale
                            : sizeof(T) == 8 ? fitted::largest_scale_double
                                             : fitted::largest_scale_float;
        auto stiffen = [&](int k, double wanted) {
            T& scale = c.state.penalty_scale[std::size_t(k * c.width + lane)];
            scale = std::max(scale, T(std::min(wanted / kept, most)));
        };
        stiffen(0, fitted::limits_over_inertia * inertia / least_limit_stiffness(c, lane));
        if (!is_soft)
            stiffen(1, fitted::contacts_over_inertia * inertia / double(c.rest.contact_penalty[std::size_t(lane)]));
    });
}

/// More iterations for bodies that were left far from balance lately, where such steps are not steadied.
void calm_shaken(Work& w) {
    if (w.solver.steadying_iterations > 0) return;
    const int missing = fitted::least_shaken_iterations - w.solver.newton_iterations;
    for (std::size_t b = 0; b < w.bodies.size(); ++b) {
        if (w.bodies[b].shaken_steps == 0) continue;
        auto& further = w.s.islands[w.s.bodies[b].island].progress.further;
        further = std::max(further, double(missing));
    }
}

/// Of islands that nothing can shake.
void hold_iterations_back(Work& w) {
    for (int i = 0; i < w.s.island_count; ++i) {
        Island& island = w.s.islands[i];
        const bool planes =
            std::all_of(island.bodies.begin(), island.bodies.end(), [&](int b) { return is_plane(w, b); });
        if (planes && !island.soft) detail::hold_back<double>(w.solver, island.stiffness, island.progress);
    }
}

/// Which bodies are, by what each island ended with.
void note_shaken(Work& w) {
    for (std::size_t b = 0; b < w.bodies.size(); ++b) {
        const Island& i = w.s.islands[w.s.bodies[b].island];
        const bool shaken = !i.progress.converged &&
                            std::sqrt(i.evaluation.residual) > fitted::shaken_share * i.evaluation.contact_force;
        int& steps = w.bodies[b].shaken_steps;
        steps = shaken || i.progress.extra >= detail::fitted::extra_iterations ? fitted::steps_shaken
                                                                               : std::max(0, steps - 1);
    }
}

/// Islands as newton.h iterates them.
struct IslandSolve {
    Work& w;
    bool any_active = false, any_update = false, any_newton = false, any_retry = false;

    bool goes_on() const { return any_active; }
    bool updates() const { return any_update; }
    bool steps() const { return any_newton; }
    bool moves() const { return any_newton || any_retry; }
    void cut_budgets() {
        for (int i = 0; i < w.s.island_count; ++i) detail::cut_budget(w.s.islands[i].progress);
    }
    void evaluate() {
        evaluate_all(w, [&](const Island& i) {
            return i.progress.active && i.progress.iterations < detail::iterations_allowed(w.solver, i.progress);
        });
    }
    void decide() {
        find_slow_islands(w);
        any_active = any_update = any_newton = any_retry = false;
        for (int i = 0; i < w.s.island_count; ++i) {
            Island& island = w.s.islands[i];
            if (!island.progress.active) {
                island.decision = {};
                continue;
            }
            island.decision = detail::decide<double>(island.evaluation, island.rounding, w.solver, island.progress);
            stop_where_jammed(w, island);
            detail::shorten_steps(island.progress, island.decision, island.evaluation);
            any_retry |= island.decision.retry, any_update |= island.decision.update;
            any_newton |= island.decision.newton, any_active |= island.progress.active;
        }
        wait_with_matrices(w);
    }
    void renew_slow_matrices() {
        auto renews = [](const Island& i) { return i.slow && i.decision.newton; };
        if (std::any_of(w.s.islands.begin(), w.s.islands.begin() + w.s.island_count, renews)) evaluate_all(w, renews);
    }
    void update_multipliers() { update_all(w); }
    void find_directions() {
        begin_directions(w);
        palpate::find_directions(w);
    }
    void judge_directions() { palpate::judge_directions(w); }
    void move() { move_all(w); }
};

}  // namespace

void place_bodies(BodyWork& w, bool at_end_of_step) {
    for (std::size_t object = 0; object < w.s.objects.size(); ++object) {
        ContactBody& o = w.s.objects[object];
        if (o.body < 0) continue;
        const BodyProgress& b = w.s.bodies[o.body];
        const Pose<double> centre = at_end_of_step ? moved(b.pose, b.step, 1) : b.pose;
        o.pose = object_pose(w.bodies[o.body], centre);
        o.centre = centre.position;
    }
    for (int k = 0; k < int(w.s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane)
                for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
                    LaneContact& o = c.contacts.at(slot, lane);
                    if (o.finger >= 0) {
                        const BodyProgress& b = w.s.bodies[o.body];
                        o.pose = plane_side(at_end_of_step ? moved(b.pose, b.step, 1) : b.pose,
                                            o.finger < c.finger[std::size_t(lane)]);
                    } else if (o.body >= 0) {
                        o.pose = w.s.objects[o.object].pose;
                    }
                }
        });
}

void begin_bodies(const SolverSettings& solver, double time, Table<VirtualObject>& shapes, Table<RigidBody>& bodies) {
    if (bodies.empty()) return;
    for (VirtualObject& shape : shapes)
        // What is released during a step stays where it is until its end.
        if (shape.held_body >= 0 && time - solver.dt >= bodies[shape.held_body].release - 1e-9) {
            std::swap(shape.body, shape.held_body);
            bodies[shape.body].asleep = false;
        }
    if (!solver.inertia) return;
    for (VirtualObject& shape : shapes)
        if (shape.body >= 0)
            shape.pose = object_pose(
                bodies[shape.body],
                free_flight(bodies[shape.body], centre_pose(bodies[shape.body], shape.previous), {0, 0, 0}, solver.dt));
}

void solve_bodies(const SolverSettings& solver, const Vec3<double>& gravity,
                  const std::vector<PairFriction>& pair_frictions, double time, const Table<Skin>& skins,
                  Threads& threads, Table<VirtualObject>& shapes, Table<RigidBody>& bodies, FingerPairs& pairs,
                  SoftObjects& soft, BodySolve& solve, SkinChunks& chunks) {
    if (bodies.empty() && pairs.near.empty() && soft.all.empty()) return;
    solve.bodies.resize(bodies.size() + pairs.near.size());
    Work w{solver, threads, shapes, bodies, solve, chunks, time, skins, pairs, soft};
    find_islands(w, gravity, pair_frictions);
    begin_soft_contact(w);
    auto active = [](const Island& i) { return bool(i.progress.active); };
    for (int i = 0; i < solve.island_count; ++i) solve.islands[i].stiffness = 0;
    for_each_lane(w, [](auto& c, int lane, Island& i) {
        c.exchange.lanes[lane] = {};
        i.stiffness = std::max(i.stiffness, double(c.rest.tissue_stiffness[std::size_t(lane)]));
    });
    hold_iterations_back(w);
    calm_shaken(w);
    stiffen_against_inertia(w);
    place_bodies(w, false);
    for_each_chunk(w, active, [&](auto& c, const auto& kernel, unsigned) { kernel.begin(c, solver); });
    IslandSolve islands{w};
    detail::iterate(islands, solve.cut);
    note_shaken(w);
    for (BodyPair& p : solve.pairs) {
        if (p.a < 0) continue;
        update_pair(p, true);
        if (island_of_pair(w, p).progress.failed) std::fill(p.contacts.begin(), p.contacts.end(), FeatureContact{});
    }
    balance_planes(w);
    place_bodies(w, false);
    end_body_step(w);
    end_soft_contact(w);
}

}  // namespace palpate
