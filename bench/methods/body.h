#pragma once
// What the formulations that the solver is compared with share: one finger in double without limits and contacts, to
// which they add their own, and the rows of the constraints on it.

#include <array>
#include <string>
#include <vector>

#include "engine/skin/factor/supernode_cholesky.h"
#include "engine/skin/solve/skin_step.h"

namespace palpate::methods {

/// The constraints of a press: bounds on every principal stretch, and a plane z = 0.
struct Constraints {
    double low = 0.6, high = 1.4;
    double friction = 0;
};

/// A way of solving one implicit step. State (multipliers, slacks) is kept from step to step.
class Method {
  public:
    virtual ~Method() = default;
    /// Advances the chunk, whose bone springs are set, by one step.
    virtual void step(SkinChunk<double>& chunk, const SolverSettings& settings) = 0;
    /// Force on each sample [N].
    std::vector<Vec3<double>> force;
};

/// A sparse row over the unknowns: the gradient of a constraint.
struct Row {
    struct Entry {
        int column;  ///< elimination position
        Vec3<double> value;
    };
    std::array<Entry, 6> entry;
    int count = 0;
};

/// Adds the derivative along node `i`; a bone node moves with the bone.
inline void add_node(const SkinChunk<double>& c, int i, const Vec3<double>& g, Row& row) {
    const SkinTopology& t = *c.topology;
    auto add = [&](int column, const Vec3<double>& value) {
        for (int k = 0; k < row.count; ++k)
            if (row.entry[k].column == column) {
                row.entry[k].value += value;
                return;
            }
        row.entry[row.count++] = {column, value};
    };
    if (t.elimination[i] >= 0) return add(t.elimination[i], g);
    const Vec3<double> arm = load_vec3<double>(&c.state.position[3 * i]) - load_vec3<double>(c.state.bone.data());
    add(t.elimination[t.bone_position], g);
    add(t.elimination[t.bone_rotation], cross(arm, g));
}

inline double times(const Row& row, const std::vector<double>& x) {
    double sum = 0;
    for (int k = 0; k < row.count; ++k) sum += dot(row.entry[k].value, load_vec3<double>(&x[3 * row.entry[k].column]));
    return sum;
}

/// An element at the current positions.
struct Stretched {
    SignedSvd<double> svd;
    Vec3<double> g[3];
    double volume;
};
inline Stretched stretched(const SkinChunk<double>& c, std::size_t e) {
    Stretched s;
    s.svd = signed_svd(detail::element_deformation<double>(c, e));
    for (int a = 0; a < 3; ++a) s.g[a] = load_vec3<double>(&c.rest.shape_gradients[9 * e + 3 * a]);
    s.volume = c.rest.volume[e];
    return s;
}

/// Derivative of the i-th principal stretch.
inline Row stretch_row(const SkinChunk<double>& c, std::size_t e, const Stretched& s, int i) {
    Row row;
    const Vec3<double> u = s.svd.U.column(i), v = s.svd.V.column(i);
    Vec3<double> first{0, 0, 0};
    for (int a = 0; a < 3; ++a) {
        const Vec3<double> d = dot(v, s.g[a]) * u;
        first -= d;
        add_node(c, c.topology->elements[e][a + 1], d, row);
    }
    add_node(c, c.topology->elements[e][0], first, row);
    return row;
}

/// Moves by the whole direction in scratch.permuted (elimination order).
inline void move(SkinChunk<double>& c, const std::vector<double>& direction, double alpha) {
    detail::keep_base<double>(c, true);
    for (int i : c.topology->unknowns)
        store_vec3<double>(&c.scratch.direction[3 * i], load_vec3<double>(&direction[3 * c.topology->elimination[i]]));
    detail::move_from_base<double>(c, true, alpha);
}

/// Factors the Newton matrix in scratch.blocks.
inline void factor(SkinChunk<double>& c) {
    factor_supernodes<double>(c.topology->supernodes, c.topology->pattern, c.scratch.blocks.data(),
                              c.scratch.panels.data(), c.scratch.panel_work.data());
}
inline void solve(SkinChunk<double>& c, std::vector<double>& x) {
    solve_supernodes<double>(c.topology->supernodes, c.scratch.panels.data(), x.data(), c.scratch.panel_work.data());
}

/// Minus the gradient in elimination order.
inline std::vector<double> right_hand_side(const SkinChunk<double>& c) {
    std::vector<double> b(3 * c.topology->unknowns.size());
    for (int i : c.topology->unknowns)
        store_vec3<double>(&b[3 * c.topology->elimination[i]], -load_vec3<double>(&c.scratch.gradient[3 * i]));
    return b;
}

/// Slip of a sample over the step, along the plane.
inline Vec3<double> slip(const SkinChunk<double>& c, int node) {
    Vec3<double> d =
        load_vec3<double>(&c.state.position[3 * node]) - load_vec3<double>(&c.scratch.start_position[3 * node]);
    d.z = 0;
    return d;
}

std::unique_ptr<Method> linearised_dual(const Constraints& constraints, int iterations, int sweeps);
std::unique_ptr<Method> interior_point(const Constraints& constraints, int iterations);

}  // namespace palpate::methods
