// Newton directions of islands. Each lane condenses its skin onto the bodies that it touches; the bodies are solved on
// the sum, and the lanes then for themselves.

#include "engine/bodies/directions.h"

#include <algorithm>
#include <cmath>

#include "engine/bodies/pair_ends.h"
#include "engine/bodies/soft_contact.h"
#include "engine/math/solve_definite.h"
#include "engine/skin/solve/newton.h"

namespace palpate {

namespace {

using Work = BodyWork;

/// Solves an island's bodies on what their lanes have condensed; `added` is their part of the direction.
void solve_island(Work& w, Island& island) {
    BodySolve& s = w.s;
    const int n = 6 * int(island.bodies.size());
    if (n == 0) return;
    auto A = s.matrix.topLeftCorner(n, n);
    A.setZero();
    for (int b : island.bodies) {
        BodyProgress& body = s.bodies[b];
        s.rhs.segment<6>(body.row) = body.rhs;
        if (is_plane(w, b)) continue;
        A.block<6, 6>(body.row, body.row) = body.inertia.curvature;
        // As skin is: by the tissue's stiffness, or where there is none by what the body itself resists with.
        const double scale = island.stiffness > 0 ? island.stiffness : body.inertia.curvature(0, 0);
        const double damping = island.progress.damping * scale, size = w.bodies[b].size;
        for (int k = 0; k < 6; ++k) A(body.row + k, body.row + k) += k < 3 ? damping : damping * size * size;
    }
    for (BodyPair& p : s.pairs) {
        if (p.a < 0 || &island_of_pair(w, p) != &island) continue;
        for (const FeatureContact& c : p.contacts)
            for (const PairTerm& t : c.terms) {
                if (!t.acts) continue;
                for_each_end(w, p, t, [&](BodyProgress& i, const auto& G) {
                    const Eigen::Matrix<double, 6, 3> GK = G.transpose() * eigen(t.curvature);
                    for_each_end(w, p, t, [&](BodyProgress& j, const auto& H) {
                        A.template block<6, 6>(i.row, j.row) += GK * H;
                    });
                });
            }
    }
    for_each_lane(w, [&](auto& c, int lane, Island& of_lane) {
        if (&of_lane != &island) return;
        const int W = c.width;
        for_each_body_of(w, c, lane, [&](int a, BodyProgress& body_a) {
            for (int k = 0; k < 6; ++k) s.rhs[body_a.row + k] += c.exchange.body_rhs[(6 * a + k) * W + lane];
            for_each_body_of(w, c, lane, [&](int b, BodyProgress& body_b) {
                const bool upper = a <= b;
                const int pair = upper ? a * c.contacts.capacity + b : b * c.contacts.capacity + a;
                const auto* block = &c.exchange.body_matrix[36 * std::size_t(pair) * W];
                for (int k = 0; k < 36; ++k)
                    A(body_a.row + (upper ? k / 6 : k % 6), body_b.row + (upper ? k % 6 : k / 6)) +=
                        block[k * W + lane];
            });
        });
    });
    for (int b : island.bodies) {  // last: the sum does not depend on which of its fingers comes first
        if (!is_plane(w, b)) continue;
        const double damping = island.progress.damping * island.stiffness;
        const BodyProgress& body = s.bodies[b];
        for (int k = 0; k < 6; ++k)
            A(body.row + k, body.row + k) +=
                body.inertia.curvature(k, k) + (k < 3 ? damping : damping * plane_size * plane_size);
    }
    auto solution = s.rhs.head(n);
    if (!solve_definite(A, solution)) {
        island.bad_pivots += 1;
        for (int b : island.bodies) s.bodies[b].added.setZero();
        return;
    }
    if (!solution.allFinite()) {  // a lane's matrix was indefinite
        island.bad_pivots += 1;
        solution.setZero();
    }
    for (int b : island.bodies) s.bodies[b].added = s.rhs.segment<6>(s.bodies[b].row);
}

/// Solves for the lanes' and bodies' parts of the direction, or of an addition to it.
template <class Condition>
void solve_direction(Work& w, Condition chosen, Condense what) {
    BodySolve& s = w.s;
    const bool first = what == Condense::gradient;
    for_each_chunk(w, chosen, [&](auto& c, const auto& kernel, unsigned lanes) { kernel.condense(c, lanes, what); });
    for (int i = 0; i < s.island_count; ++i)
        if (first && chosen(s.islands[i])) s.islands[i].bad_pivots = 0;
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (chosen(i)) i.bad_pivots += c.exchange.lanes[lane].bad_pivots;
    });
    for (int i = 0; i < s.island_count; ++i) {
        Island& island = s.islands[i];
        if (!chosen(island)) continue;
        solve_island(w, island);
        island.slope = 0;
        for (int b : island.bodies) {
            BodyProgress& body = s.bodies[b];
            body.step = first ? body.added : Motion(body.step + body.added);
            island.slope += body.step.dot(body.gradient);
        }
    }
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (!chosen(i) || !c.has_bodies) return;  // beside soft objects there need not be any
        for (int slot = 0; slot < c.contacts.used; ++slot)
            for (int k = 0; k < 6; ++k) c.exchange.body_step[(6 * slot + k) * c.width + lane] = 0;
        for_each_body_of(w, c, lane, [&](int slot, BodyProgress& b) {
            for (int k = 0; k < 6; ++k) c.exchange.body_step[(6 * slot + k) * c.width + lane] = b.added[k];
        });
    });
    for_each_chunk(w, chosen, [&](auto& c, const auto& kernel, unsigned lanes) { kernel.direction(c, lanes, first); });
    for_each_lane(w, [&](auto& c, int lane, Island& i) {
        if (chosen(i)) i.slope += c.exchange.lanes[lane].slope;
    });
}

/// Numbers of the lanes of an island in the vectors of its coupled direction; its bodies' come after. Returns how many.
int number_unknowns(Work& w, const Island& island) {
    std::vector<int>& first = w.soft.work.first;
    first.assign(w.s.lane_island.size(), -1);
    int count = 0;
    for (const auto& [finger, place] : w.s.fingers) {
        if (&w.s.islands[std::size_t(w.s.lane_island[std::size_t(place)])] != &island) continue;
        first[std::size_t(place)] = count;
        with_chunk(w, place / 16, [&](auto& c, const auto&) { count += 3 * int(c.topology->unknowns.size()); });
    }
    const int total = count + 6 * int(island.bodies.size());
    SoftWork& v = w.soft.work;
    for (Eigen::VectorXd* x : {&v.wanted, &v.residual, &v.solved, &v.search, &v.image, &v.whole_image, &v.direction})
        if (x->size() != total) x->resize(total);
    return count;
}

/// Calls visit(chunk, lane, unknown, number of its x) for the unknowns of the lanes numbered.
template <class Visit>
void for_each_unknown(Work& w, Visit visit) {
    for (int k = 0; k < int(w.s.coupled.size()); ++k)
        with_chunk(w, k, [&](auto& c, const auto&) {
            for (int lane = 0; lane < c.width; ++lane)
                if (const int first = w.soft.work.first[std::size_t(16 * k + lane)]; first >= 0)
                    for (int u : c.topology->unknowns)
                        visit(c, lane, u, first + 3 * c.topology->elimination[std::size_t(u)]);
        });
}

/// x <- (what lanes and bodies have without their coupling)^-1 x, by the factors that exist.
void solve_uncoupled(Work& w, const Island& island, int bodies_from, const Eigen::VectorXd& x, Eigen::VectorXd& out) {
    for_each_unknown(w, [&](auto& c, int lane, int u, int n) {
        using T = std::remove_reference_t<decltype(c.scratch.permuted[0])>;
        const int place = c.topology->elimination[std::size_t(u)];
        for (int d = 0; d < 3; ++d) c.scratch.permuted[std::size_t((3 * place + d) * c.width + lane)] = T(x[n + d]);
    });
    for (std::size_t b = 0; b < island.bodies.size(); ++b)
        w.s.bodies[std::size_t(island.bodies[b])].rhs = x.segment<6>(bodies_from + 6 * int(b));
    solve_direction(
        w, [](const Island& i) { return i.coupling; }, Condense::given);
    for_each_unknown(w, [&](auto& c, int lane, int u, int n) {
        const int place = c.topology->elimination[std::size_t(u)];
        for (int d = 0; d < 3; ++d)
            out[n + d] = double(c.scratch.permuted[std::size_t((3 * place + d) * c.width + lane)]);
    });
    for (std::size_t b = 0; b < island.bodies.size(); ++b)
        out.segment<6>(bodies_from + 6 * int(b)) = w.s.bodies[std::size_t(island.bodies[b])].added;
}

/// Fingers and soft objects move each other: conjugate gradients on the whole island, preconditioned by what lanes and
/// bodies have by themselves, from whose direction it starts.
void couple_soft_objects(Work& w, Island& island) {
    constexpr int most_iterations = 200;
    constexpr double enough = 1e-4;  // of the residual that the direction began with
    const int lanes = number_unknowns(w, island);
    SoftWork& v = w.soft.work;
    for (int i = 0; i < w.s.island_count; ++i)
        w.s.islands[std::size_t(i)].coupling = &w.s.islands[std::size_t(i)] == &island;
    for_each_unknown(w, [&](auto& c, int lane, int u, int n) {
        for (int d = 0; d < 3; ++d) {
            v.wanted[n + d] = -double(c.scratch.gradient[std::size_t((3 * u + d) * c.width + lane)]);
            v.solved[n + d] = double(c.scratch.direction[std::size_t((3 * u + d) * c.width + lane)]);
        }
    });
    for (std::size_t b = 0; b < island.bodies.size(); ++b) {
        const BodyProgress& body = w.s.bodies[std::size_t(island.bodies[b])];
        v.wanted.segment<6>(lanes + 6 * int(b)) = -body.gradient;
        v.solved.segment<6>(lanes + 6 * int(b)) = body.step;
    }
    v.residual = v.wanted;
    v.direction.setZero();
    v.search = v.solved;
    v.image = v.residual;  // of the search direction, by what lanes and bodies have by themselves
    double energy = v.residual.dot(v.solved);
    const double begun = energy;
    const int index = int(&island - w.s.islands.data());
    for (int k = 0; k < most_iterations && energy > 0; ++k) {
        v.whole_image = v.image;
        add_soft_coupling(w, index, v.search, v.whole_image);
        const double curvature = v.search.dot(v.whole_image);
        if (!(curvature > 0)) {
            if (k == 0) v.direction = v.search;  // not definite: as good as nothing coupled
            break;
        }
        const double length = energy / curvature;
        v.direction += length * v.search;
        v.residual -= length * v.whole_image;
        solve_uncoupled(w, island, lanes, v.residual, v.solved);
        const double left = v.residual.dot(v.solved);
        if (!(left > enough * enough * begun)) break;
        v.search = v.solved + (left / energy) * v.search;
        v.image = v.residual + (left / energy) * v.image;
        energy = left;
    }
    for_each_unknown(w, [&](auto& c, int lane, int u, int n) {
        using T = std::remove_reference_t<decltype(c.scratch.direction[0])>;
        for (int d = 0; d < 3; ++d)
            c.scratch.direction[std::size_t((3 * u + d) * c.width + lane)] = T(v.direction[n + d]);
    });
    for (std::size_t b = 0; b < island.bodies.size(); ++b)
        w.s.bodies[std::size_t(island.bodies[b])].step = v.direction.segment<6>(lanes + 6 * int(b));
    island.slope = -v.wanted.dot(v.direction);
}

/// What contact between objects does at the end of the direction beyond its linearisation.
void pairs_residual(Work& w) {
    for (BodyPair& p : w.s.pairs) {
        if (p.a < 0) continue;
        Island& island = island_of_pair(w, p);
        if (!island.following) continue;
        // What the last linearisation said, then what it is.
        auto add = [&](double sign, bool linear) {
            for (FeatureContact& c : p.contacts)
                for (const PairTerm& t : c.terms) {
                    if (!t.acts) continue;
                    Eigen::Vector3d force = eigen(t.gradient);
                    if (linear)
                        for_each_end(w, p, t, [&](BodyProgress& b, const auto& G) {
                            force += eigen(t.curvature) * (G * b.added);
                        });
                    for_each_end(w, p, t,
                                 [&](BodyProgress& b, const auto& G) { b.rhs -= sign * (G.transpose() * force); });
                }
        };
        add(-1, true);
        evaluate_pair(p, features_of_pair(w.s, p), w.s.objects[p.a], w.s.objects[p.b], island.progress.exactness);
        add(1, false);
    }
}

bool follows(const Island& i) { return i.following; }

/// Islands whose contacts are followed along their directions (newton.h).
struct FollowedIslands {
    Work& w;

    /// Ends following where contact did little beyond its linearisation.
    void find_contact_residuals() {
        BodySolve& s = w.s;
        place_bodies(w, true);
        for (BodyProgress& b : s.bodies) b.rhs.setZero();
        for_each_chunk(w, follows, [&](auto& c, const auto& kernel, unsigned lanes) {
            kernel.contact_residual(c, w.solver, lanes);
        });
        for (int i = 0; i < s.island_count; ++i) s.islands[i].contact_residual = 0;
        for_each_lane(
            w, [&](auto& c, int lane, Island& i) { i.contact_residual += c.exchange.lanes[lane].contact_residual; });
        pairs_residual(w);
        const double share = w.solver.contact_share * w.solver.contact_share;
        for (int i = 0; i < s.island_count; ++i) {
            Island& island = s.islands[i];
            if (!island.following) continue;
            for (int b : island.bodies)
                island.contact_residual += s.bodies[b].rhs.head<3>().squaredNorm() +
                                           s.bodies[b].rhs.tail<3>().squaredNorm() / (size_of(w, b) * size_of(w, b));
            island.following = island.contact_residual > share * island.evaluation.residual;
        }
    }
    bool follow() const { return std::any_of(w.s.islands.begin(), w.s.islands.begin() + w.s.island_count, follows); }
    void add_to_directions() { solve_direction(w, follows, Condense::residual); }
    void keep_better() {
        BodySolve& s = w.s;
        auto worse = [](const Island& i) { return i.decision.newton && i.first_slope < 0 && !(i.slope < 0); };
        for_each_chunk(w, worse, [](auto& c, const auto& kernel, unsigned lanes) { kernel.restore(c, lanes); });
        for (int i = 0; i < s.island_count; ++i)
            if (worse(s.islands[i])) {
                s.islands[i].slope = s.islands[i].first_slope;
                for (int b : s.islands[i].bodies) s.bodies[b].step = s.bodies[b].first_step;
            }
    }
};

/// Follows the contacts of islands whose direction leads downhill.
void follow_contacts_of_islands(Work& w) {
    if (w.solver.contact_iterations <= 0) return;
    BodySolve& s = w.s;
    for (int i = 0; i < s.island_count; ++i) {
        Island& island = s.islands[i];
        island.first_slope = island.slope;
        // With soft objects, lanes do not follow alone: contact is as it was when the coupled matrix was made.
        island.following = island.decision.newton && !island.soft && island.progress.exactness <= 0 && island.slope < 0;
        for (int b : island.bodies) s.bodies[b].first_step = s.bodies[b].step;
    }
    FollowedIslands followed{w};
    detail::follow_contacts(followed, w.solver.contact_iterations);
}

}  // namespace

void find_directions(BodyWork& w) {
    auto newton_of = [](bool soft) { return [soft](const Island& i) { return i.decision.newton && i.soft == soft; }; };
    solve_direction(w, newton_of(true), Condense::gradient);
    for (int i = 0; i < w.s.island_count; ++i)
        if (Island& island = w.s.islands[std::size_t(i)]; island.soft && island.decision.newton)
            couple_soft_objects(w, island);
    // After them: conjugate gradients leave nothing of what other lanes of a chunk go on with.
    solve_direction(w, newton_of(false), Condense::gradient);
    follow_contacts_of_islands(w);
}

}  // namespace palpate
