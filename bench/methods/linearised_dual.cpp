// The paper's way (Perez et al. 2013, 2017): constraints linearised at the current iterate, multipliers by projected
// Gauss-Seidel on the dual problem. The curvature of the constraints is left out.

#include "bench/methods/body.h"

namespace palpate::methods {
namespace {

class LinearisedDual : public Method {
  public:
    LinearisedDual(const Constraints& c, int iterations_, int sweeps_)
        : constraints(c), iterations(iterations_), sweeps(sweeps_) {}

    void step(SkinChunk<double>& c, const SolverSettings& settings) override {
        const SkinTopology& t = *c.topology;
        limit.resize(6 * t.elements.size(), 0.0);
        force.resize(t.samples.size(), {0, 0, 0});
        detail::begin_step<double>(c, settings);
        for (int k = 0; k < iterations; ++k) {
            evaluate<double>(c, settings, 0.0);
            factor(c);
            std::vector<double> dx = right_hand_side(c);
            solve(c, dx);
            collect(c, dx);
            for (Active& a : active) {
                a.effect.assign(dx.size(), 0.0);
                for (int i = 0; i < a.row.count; ++i)
                    store_vec3<double>(&a.effect[3 * a.row.entry[i].column], a.row.entry[i].value);
                solve(c, a.effect);
                a.compliance = times(a.row, a.effect);
                apply(dx, a, *a.multiplier);
            }
            for (int s = 0; s < sweeps; ++s) sweep(dx);
            move(c, dx, 1);
        }
        detail::end_step<double>(c, settings);
    }

  private:
    struct Active {
        Row row;
        double value;        ///< of the constraint now
        double* multiplier;  ///< kept from step to step
        double* normal;      ///< of friction: the normal multiplier; else null
        std::vector<double> effect;
        double compliance = 0;
    };

    static void apply(std::vector<double>& dx, const Active& a, double change) {
        if (change == 0) return;
        for (std::size_t i = 0; i < dx.size(); ++i) dx[i] += change * a.effect[i];
    }

    void collect(const SkinChunk<double>& c, const std::vector<double>& dx) {
        active.clear();
        auto consider = [&](const Row& row, double value, double margin, double& multiplier) {
            if (multiplier > 0 || value + times(row, dx) < margin)
                active.push_back({row, value, &multiplier, nullptr, {}, 0});
        };
        for (std::size_t e = 0; e < c.topology->elements.size(); ++e) {
            const Stretched s = stretched(c, e);
            for (int i = 0; i < 3; ++i) {
                Row row = stretch_row(c, e, s, i);
                consider(row, s.svd.sigma[i] - constraints.low, 0.02, limit[6 * e + i]);
                for (int k = 0; k < row.count; ++k) row.entry[k].value = -row.entry[k].value;
                consider(row, constraints.high - s.svd.sigma[i], 0.02, limit[6 * e + 3 + i]);
            }
        }
        for (std::size_t s = 0; s < c.topology->samples.size(); ++s) {
            const int node = c.topology->samples[s];
            Row row;
            add_node(c, node, {0, 0, 1}, row);
            const std::size_t before = active.size();
            consider(row, node_position(c, node, 0).z, 2e-4, force[s].z);
            if (active.size() == before || constraints.friction <= 0) continue;
            const Vec3<double> moved = slip(c, node);
            for (int d = 0; d < 2; ++d) {
                Row along;
                add_node(c, node, {d == 0 ? 1.0 : 0.0, d == 1 ? 1.0 : 0.0, 0}, along);
                active.push_back({along, moved[d], &force[s][d], &force[s].z, {}, 0});
            }
        }
    }

    void sweep(std::vector<double>& dx) {
        for (std::size_t k = 0; k < active.size(); ++k) {
            Active& a = active[k];
            const double wanted = *a.multiplier - (a.value + times(a.row, dx)) / a.compliance;
            if (!a.normal) {
                const double next = std::max(0.0, wanted);
                apply(dx, a, next - *a.multiplier);
                *a.multiplier = next;
                continue;
            }
            Active& b = active[++k];  // the second direction of the same sample
            double x = wanted, y = *b.multiplier - (b.value + times(b.row, dx)) / b.compliance;
            const double length = std::hypot(x, y), radius = constraints.friction * *a.normal;
            if (length > radius) x *= radius / length, y *= radius / length;
            apply(dx, a, x - *a.multiplier);
            apply(dx, b, y - *b.multiplier);
            *a.multiplier = x, *b.multiplier = y;
        }
    }

    Constraints constraints;
    int iterations, sweeps;
    std::vector<double> limit;  ///< [element][low, high of each stretch] [N m]
    std::vector<Active> active;
};

}  // namespace

std::unique_ptr<Method> linearised_dual(const Constraints& c, int iterations, int sweeps) {
    return std::make_unique<LinearisedDual>(c, iterations, sweeps);
}

}  // namespace palpate::methods
