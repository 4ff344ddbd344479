// A primal-dual barrier: every constraint c(x) >= 0 has a slack s and a multiplier l with l s = mu, kept from step to
// step; mu falls towards zero. Friction is a smoothed potential with the radius of the last iteration.

#include "bench/methods/body.h"

namespace palpate::methods {
namespace {

struct Pair {
    double slack = 0, multiplier = 0;
};

class InteriorPoint : public Method {
  public:
    InteriorPoint(const Constraints& c, int iterations_) : constraints(c), iterations(iterations_) {}

    void step(SkinChunk<double>& c, const SolverSettings& settings) override {
        const SkinTopology& t = *c.topology;
        if (limit.empty()) limit.resize(6 * t.elements.size()), contact.resize(t.samples.size());
        force.assign(t.samples.size(), {0, 0, 0});
        detail::begin_step<double>(c, settings);
        elements.resize(t.elements.size());
        for (std::size_t e = 0; e < elements.size(); ++e) elements[e] = stretched(c, e);
        for_each(c, [](Pair& p, double value, double least, double) {
            p.slack = std::max({value, 0.1 * p.slack, least});
            p.multiplier = std::max(p.multiplier, 0.0);
        });
        for (int k = 0; k < iterations; ++k) newton(c, settings);
        for (std::size_t s = 0; s < t.samples.size(); ++s) {
            force[s] = -1.0 * friction(c, s);
            force[s].z = contact[s].multiplier;
        }
        detail::end_step<double>(c, settings);
    }

  private:
    /// Calls f(pair, value, smallest slack, least complementarity) for every constraint.
    template <class F>
    void for_each(const SkinChunk<double>& c, F f) {
        for (std::size_t e = 0; e < elements.size(); ++e)
            for (int i = 0; i < 3; ++i) {
                const double sigma = elements[e].svd.sigma[i];
                f(limit[6 * e + i], sigma - constraints.low, 1e-3, least_limit);
                f(limit[6 * e + 3 + i], constraints.high - sigma, 1e-3, least_limit);
            }
        for (std::size_t s = 0; s < contact.size(); ++s)
            f(contact[s], node_position(c, c.topology->samples[s], 0).z, 1e-6, least_contact);
    }

    /// Gradient of smoothed friction; its curvature is radius / max(|slip|, rest) in the plane.
    Vec3<double> friction(const SkinChunk<double>& c, std::size_t s) const {
        const Vec3<double> u = slip(c, c.topology->samples[s]);
        return (constraints.friction * contact[s].multiplier / std::max(norm(u), smoothing)) * u;
    }

    void newton(SkinChunk<double>& c, const SolverSettings& settings) {
        evaluate<double>(c, settings, 0.0);
        for (std::size_t e = 0; e < elements.size(); ++e) elements[e] = stretched(c, e);
        // Centring: a tenth of the mean complementarity of those that press.
        double limits = 0, contacts = 0, n_limits = 0, n_contacts = 0;
        for (const Pair& p : limit)
            if (p.multiplier * p.slack > least_limit) limits += p.multiplier * p.slack, ++n_limits;
        for (const Pair& p : contact)
            if (p.multiplier * p.slack > least_contact) contacts += p.multiplier * p.slack, ++n_contacts;
        mu_limit = std::max(least_limit, n_limits > 0 ? 0.1 * limits / n_limits : 0);
        mu_contact = std::max(least_contact, n_contacts > 0 ? 0.1 * contacts / n_contacts : 0);
        add_terms(c);
        factor(c);
        std::vector<double> dx = right_hand_side(c);
        solve(c, dx);
        advance(c, dx);
    }

    struct Change {
        double slack, multiplier;
    };
    static Change change(const Pair& p, double value, double along, double mu) {
        const double w = p.multiplier / p.slack, ds = along + value - p.slack;
        return {ds, mu / p.slack - p.multiplier - w * ds};
    }

    void add_terms(SkinChunk<double>& c) {
        const SkinTopology& t = *c.topology;
        auto gradient = [&](int column) -> double* { return &c.scratch.gradient[3 * node_of[column]]; };
        if (node_of.empty()) {
            node_of.resize(t.unknowns.size());
            for (int i : t.unknowns) node_of[t.elimination[i]] = i;
        }
        auto add_row = [&](const Row& row, double pull, double stiffness) {
            for (int a = 0; a < row.count; ++a) {
                const auto& p = row.entry[a];
                store_vec3<double>(gradient(p.column), load_vec3<double>(gradient(p.column)) - pull * p.value);
                for (int b = 0; b < row.count; ++b) {
                    const auto& q = row.entry[b];
                    if (p.column < q.column) continue;
                    detail::add_block<double>(c.scratch.blocks.data(), t.pattern.find(p.column, q.column),
                                              stiffness * outer(p.value, q.value));
                }
            }
        };
        for (std::size_t e = 0; e < elements.size(); ++e)
            for (int i = 0; i < 3; ++i) {
                const double sigma = elements[e].svd.sigma[i], V = elements[e].volume;
                const Pair &low = limit[6 * e + i], &high = limit[6 * e + 3 + i];
                auto pull = [&](const Pair& p, double value) {
                    return mu_limit / p.slack - p.multiplier / p.slack * (value - p.slack);
                };
                const double stiffness = low.multiplier / low.slack + high.multiplier / high.slack;
                add_row(stretch_row(c, e, elements[e], i),
                        V * (pull(low, sigma - constraints.low) - pull(high, constraints.high - sigma)), V * stiffness);
            }
        for (std::size_t s = 0; s < contact.size(); ++s) {
            const int node = t.samples[s];
            const double gap = node_position(c, node, 0).z;
            const Pair& p = contact[s];
            Row row;
            add_node(c, node, {0, 0, 1}, row);
            add_row(row, mu_contact / p.slack - p.multiplier / p.slack * (gap - p.slack), p.multiplier / p.slack);
            if (constraints.friction <= 0) continue;
            const Vec3<double> f = friction(c, s);
            const double k = constraints.friction * p.multiplier / std::max(norm(slip(c, node)), smoothing);
            for (int d = 0; d < 2; ++d) {
                Row along;
                add_node(c, node, {d == 0 ? 1.0 : 0.0, d == 1 ? 1.0 : 0.0, 0}, along);
                add_row(along, -f[d], k);
            }
        }
    }

    void advance(SkinChunk<double>& c, const std::vector<double>& dx) {
        std::vector<Change> changes;
        double primal = 1, dual = 1;
        auto note = [&](const Pair& p, double value, double along, double mu) {
            const Change d = change(p, value, along, mu);
            changes.push_back(d);
            if (d.slack < 0) primal = std::min(primal, -0.99 * p.slack / d.slack);
            if (d.multiplier < 0) dual = std::min(dual, -0.99 * p.multiplier / d.multiplier);
        };
        for (std::size_t e = 0; e < elements.size(); ++e)
            for (int i = 0; i < 3; ++i) {
                const double along = times(stretch_row(c, e, elements[e], i), dx), sigma = elements[e].svd.sigma[i];
                note(limit[6 * e + i], sigma - constraints.low, along, mu_limit);
                note(limit[6 * e + 3 + i], constraints.high - sigma, -along, mu_limit);
            }
        for (std::size_t s = 0; s < contact.size(); ++s) {
            Row row;
            add_node(c, c.topology->samples[s], {0, 0, 1}, row);
            note(contact[s], node_position(c, c.topology->samples[s], 0).z, times(row, dx), mu_contact);
        }
        std::size_t k = 0;
        auto take = [&](Pair& p) {
            p.slack += primal * changes[k].slack;
            p.multiplier += dual * changes[k].multiplier;
            ++k;
        };
        for (std::size_t e = 0; e < elements.size(); ++e)
            for (int i = 0; i < 3; ++i) take(limit[6 * e + i]), take(limit[6 * e + 3 + i]);
        for (Pair& p : contact) take(p);
        move(c, dx, primal);
    }

    static constexpr double least_limit = 1.0, least_contact = 1e-10, smoothing = 1e-6;  // [Pa], [N m], [m]
    Constraints constraints;
    int iterations;
    double mu_limit = least_limit, mu_contact = least_contact;
    std::vector<Pair> limit;  ///< [element][low, high of each stretch]; multipliers in Pa
    std::vector<Pair> contact;
    std::vector<Stretched> elements;
    std::vector<int> node_of;
};

}  // namespace

std::unique_ptr<Method> interior_point(const Constraints& c, int iterations) {
    return std::make_unique<InteriorPoint>(c, iterations);
}

}  // namespace palpate::methods
