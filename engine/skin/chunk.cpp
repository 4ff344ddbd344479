#include "engine/skin/chunk.h"

#include <Eigen/Dense>
#include <cmath>
#include <stdexcept>

#include "engine/skin/block_cholesky.h"

namespace palpate {

std::vector<std::string> SolverSettings::validate() const {
    std::vector<std::string> wrong;
    auto need = [&](bool ok, const char* sentence) {
        if (!ok) wrong.emplace_back(sentence);
    };
    need(std::isfinite(dt) && dt >= 1e-6 && dt <= 0.2, "the time step must be between 0.001 and 200 ms");
    need(newton_iterations >= 1 && newton_iterations <= 10000, "newton_iterations must be between 1 and 10000");
    need(tolerance > 0 && tolerance < 1, "tolerance must be between 0 and 1");
    need(multiplier_tolerance > 0 && multiplier_tolerance < 1, "multiplier_tolerance must be between 0 and 1");
    need(contact_iterations >= 0 && contact_iterations <= 100, "contact_iterations must be between 0 and 100");
    need(contact_share >= 0 && contact_share <= 1, "contact_share must be between 0 and 1");
    need(multiplier_gate > 0 && multiplier_gate <= 1e3, "multiplier_gate must be between 0 and 1000");
    need(limit_tolerance >= 1e-8 && limit_tolerance <= 0.5, "limit_tolerance must be between 1e-8 and 0.5");
    need(contact_tolerance >= 1e-10 && contact_tolerance <= 1e-2, "contact_tolerance must be between 1e-7 and 10 mm");
    need(sample_refinement >= 1 && sample_refinement <= 8, "sample_refinement must be between 1 and 8");
    need(detail_penetration >= 0 && detail_penetration <= 1e-2, "detail_penetration must be between 0 and 10 mm");
    need(detail_tolerance >= 0 && detail_tolerance <= 1e-2, "detail_tolerance must be between 0 and 10 mm");
    need(detail_error >= 0 && detail_error <= 1, "detail_error must be between 0 and 1");
    need(sleep_speed >= 0 && sleep_speed <= 1e-2, "sleep_speed must be between 0 and 0.01 m/s");
    return wrong;
}

namespace {

double value_at(const std::vector<double>& values, std::size_t i) {
    return values.size() == 1 ? values[0] : values.at(i);
}

/// Applies `visit` to every array of a chunk.
template <class Chunk, class Visit>
void for_each_array(Chunk& c, Visit visit) {
    auto& r = c.rest;
    for (auto* a : {&r.shape_gradients, &r.volume, &r.mu, &r.lambda, &r.limit_low, &r.limit_high, &r.limit_penalty,
                    &r.mass, &r.contact_penalty, &r.contact_area, &r.object_friction, &r.tissue_stiffness,
                    &r.rounding_stiffness, &r.extent, &r.rest_position})
        visit(*a);
    auto& s = c.state;
    for (auto* a : {&s.position, &s.velocity, &s.bone, &s.bone_velocity, &s.limit_multiplier, &s.normal_multiplier,
                    &s.tangential_multiplier, &s.friction_radius, &s.friction_normal, &s.svd_guess, &s.tangled_steps,
                    &s.penalty_scale})
        visit(*a);
    auto& w = c.scratch;
    for (auto* a : {&w.start_position,   &w.start_bone,
                    &w.inertia_target,   &w.bone_springs,
                    &w.slot_frame,       &w.base_position,
                    &w.base_bone,        &w.gradient,
                    &w.pending,          &w.direction,
                    &w.permuted,         &w.blocks,
                    &w.panels,           &w.panel_work,
                    &w.factor,           &w.first_direction,
                    &w.sample_gradient,  &w.sample_curvature,
                    &w.sample_residual,  &w.limit_candidate,
                    &w.normal_candidate, &w.tangential_candidate,
                    &w.contact_normal,   &w.svd})
        visit(*a);
    auto& x = c.exchange;
    for (auto* a : {&x.centre, &x.slot_gradient, &x.slot_curvature, &x.columns, &x.body_gradient, &x.body_rhs,
                    &x.body_matrix, &x.body_step})
        visit(*a);
    auto& l = c.linear;
    for (auto* a : {&l.weight, &l.frame, &l.arm, &l.force, &l.blocks, &l.energy, &l.watched, &l.reach, &l.bound,
                    &l.error, &l.moved, &l.moved_force})
        visit(*a);
}

}  // namespace

template <class T>
void allocate_chunk(SkinChunk<T>& c, std::shared_ptr<const SkinTopology> topology, int width, bool has_limits,
                    bool has_friction, int object_count, bool has_bodies) {
    const SkinTopology& t = *topology;
    c.topology = std::move(topology);
    c.width = width;
    c.has_limits = has_limits;
    c.slot_capacity = std::min(object_count, max_contact_slots);
    c.has_friction = has_friction && c.slot_capacity > 0;
    c.finger.assign(width, -1);
    c.status.assign(width, {});
    auto make = [&](LaneArray<T>& a, std::size_t n, T value = T(0)) { a.assign(n * width, value); };
    const std::size_t E = t.elements.size(), N = t.node_count;
    const std::size_t S = t.sample_count(), contacts = S * c.slot_capacity, limits = has_limits ? E : 0;
    const std::size_t frictions = c.has_friction ? contacts : 0, everything = N + 2;
    auto& r = c.rest;
    make(r.shape_gradients, 9 * E), make(r.volume, E), make(r.mu, E), make(r.lambda, E);
    make(r.limit_low, limits), make(r.limit_high, limits), make(r.limit_penalty, limits);
    make(r.mass, N), make(r.contact_penalty, S);
    make(r.tissue_stiffness, 1), make(r.rounding_stiffness, 1), make(r.extent, 1), make(r.rest_position, 3 * N);
    auto& s = c.state;
    s.origin.assign(3 * std::size_t(width), 0.0);
    make(s.position, 3 * N), make(s.velocity, 3 * N), make(s.bone, 7), make(s.bone_velocity, 6);
    make(s.limit_multiplier, 9 * limits), make(s.normal_multiplier, contacts);
    make(s.tangential_multiplier, 3 * frictions), make(s.friction_radius, frictions),
        make(s.friction_normal, 3 * frictions);
    make(s.svd_guess, 9 * E), make(s.tangled_steps, 1), make(s.penalty_scale, 2, T(1));
    auto& w = c.scratch;
    make(w.start_position, 3 * N), make(w.start_bone, 7), make(w.inertia_target, 3 * N);
    make(w.bone_springs, 9 * bone_spring_count), make(w.base_position, 3 * N), make(w.base_bone, 7);
    make(w.slot_frame, 24 * std::size_t(c.slot_capacity));
    make(w.gradient, 3 * everything), make(w.pending, has_limits ? 3 * N : 0), make(w.direction, 3 * everything),
        make(w.permuted, 3 * t.unknowns.size());
    make(w.blocks, 9 * std::size_t(t.block_count)), make(w.limit_candidate, 9 * limits);
    const std::size_t C = c.slot_capacity > 0 ? S : 0;
    if (width > 1) make(w.factor, 9 * std::size_t(t.pattern.block_count));
    make(w.first_direction, C > 0 ? 3 * everything : 0), make(w.sample_gradient, 3 * C);
    make(w.sample_curvature, 9 * C), make(w.sample_residual, 3 * C);
    if (width == 1) make(w.panels, t.supernodes.panel_scalars), make(w.panel_work, t.supernodes.work_scalars);
    make(w.normal_candidate, contacts), make(w.tangential_candidate, 3 * frictions);
    make(w.contact_normal, 3 * frictions), make(w.svd, 9 * E);
    if (!has_bodies) return;
    auto& x = c.exchange;
    const std::size_t slots = c.slot_capacity;
    make(x.centre, 3 * slots), make(x.slot_gradient, 3 * contacts), make(x.slot_curvature, 9 * contacts);
    make(x.columns, slots * 18 * t.unknowns.size());
    make(x.body_gradient, 6 * slots), make(x.body_rhs, 6 * slots);
    make(x.body_matrix, 36 * slots * slots), make(x.body_step, 6 * slots);
}

template <class T>
void allocate_linear_tissue(SkinChunk<T>& c) {
    const SkinTopology& t = *c.topology;
    LinearTissue<T>& l = c.linear;
    l.pairs = tissue_pairs(t);
    auto make = [&](LaneArray<T>& a, std::size_t n) { a.assign(n * std::size_t(c.width), T(0)); };
    const auto E = t.elements.size(), N = std::size_t(t.node_count);
    make(l.weight, E), make(l.frame, 9), make(l.arm, 3 * N), make(l.force, 3 * N), make(l.blocks, 9 * l.pairs.size());
    make(l.energy, 1), make(l.watched, c.has_limits ? E : 0), make(l.reach, 1), make(l.bound, 1), make(l.error, 1);
    make(l.moved, 3 * N), make(l.moved_force, 3 * N);
}

namespace {

constexpr double origin_grid = 1.0 / 64;  ///< [m]; a power of two, so that moving an origin rounds little

Vec3<double> nearest_origin(const Vec3<double>& bone) {
    Vec3<double> origin;
    for (int d = 0; d < 3; ++d) origin[d] = origin_grid * std::round(bone[d] / origin_grid);
    return origin;
}

/// What a squared change of an element's deformation gradient adds to contact forces beyond their linearisation, per
/// volume [N/m^3]. The second derivative of the corotational stress is of the size of the moduli; that of neighbours
/// mostly cancels, and skin gives way to the rest: a tenth is what was seen to bound the error of contact forces.
double linear_error_weight(const Eigen::Matrix3d& shape_gradients, double mu, double lambda) {
    const Eigen::Vector3d first = -shape_gradients.colwise().sum();
    return (mu + lambda / 2) / 10 * (shape_gradients.rowwise().norm().sum() + first.norm());
}

/// Rest data of the elements of one lane; adds up the nodes' masses.
template <class T>
void set_elements(SkinChunk<T>& c, int lane, const SkinParameters& p) {
    const int W = c.width;
    const SkinTopology& t = *c.topology;
    auto node = [&](int i) { return Eigen::Map<const Eigen::Vector3d>(p.mesh->nodes[i].data()); };
    std::vector<double> mass(t.node_count, 0.0);
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        const auto& tet = t.elements[e];
        Eigen::Matrix3d D;
        for (int a = 1; a < 4; ++a) D.col(a - 1) = node(tet[a]) - node(tet[0]);
        const double volume = std::abs(D.determinant()) / 6;
        const Eigen::Matrix3d G = D.inverse();
        for (int i = 0; i < 9; ++i) c.rest.shape_gradients[(9 * e + i) * W + lane] = T(G(i / 3, i % 3));
        c.rest.volume[e * W + lane] = T(volume);
        const std::size_t m = t.mesh_element[e];
        const double E = value_at(p.young_modulus, m), nu = p.poisson_ratio;
        c.rest.mu[e * W + lane] = T(E / (2 * (1 + nu)));
        c.rest.lambda[e * W + lane] = T(E * nu / ((1 + nu) * (1 - 2 * nu)));
        if (c.has_limits) {
            // A finger without limits in a chunk with them gets bounds that are never met.
            c.rest.limit_low[e * W + lane] = T(p.has_limits ? value_at(p.limit_low, m) : 1e-3);
            c.rest.limit_high[e * W + lane] = T(p.has_limits ? value_at(p.limit_high, m) : 1e3);
            c.rest.limit_penalty[e * W + lane] = T(p.limit_penalty_factor * E);
        }
        for (int a : tet) mass[a] += p.density * volume / 4;
        if (!c.linear.weight.empty())
            c.linear.weight[e * W + lane] =
                T(volume * linear_error_weight(G, E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))));
        for (int i = 0; i < 9; i += 4) c.state.svd_guess[(9 * e + i) * W + lane] = T(1);
    }
    c.skin_mass[lane] = c.skin_inertia[lane] = 0;
    for (int i = 0; i < t.node_count; ++i) {
        c.rest.mass[i * W + lane] = T(mass[i]);
        c.skin_mass[lane] += mass[i];
        c.skin_inertia[lane] += 2.0 / 3 * mass[i] * node(i).squaredNorm();
    }
}

/// Sphere around the samples at rest.
Sphere sphere_around(const TetMesh& mesh, const std::vector<int>& samples) {
    Eigen::AlignedBox3d box;
    for (int node : samples) box.extend(Eigen::Map<const Eigen::Vector3d>(mesh.nodes[node].data()));
    const Eigen::Vector3d c = box.center();
    return {{c.x(), c.y(), c.z()}, box.diagonal().norm() / 2};
}

}  // namespace

template <class T>
void set_lane(SkinChunk<T>& c, int lane, int finger, const SkinParameters& p, const Pose<double>& bone) {
    const SkinTopology& t = *c.topology;
    const int W = c.width;
    c.finger[lane] = finger;
    c.used_lanes |= 1u << lane;
    set_elements(c, lane, p);
    double volume = 0, E = 0;
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        volume += c.rest.volume[e * W + lane];
        E += value_at(p.young_modulus, t.mesh_element[e]) * c.rest.volume[e * W + lane];
    }
    const double spacing = std::cbrt(8.5 * volume / double(t.elements.size()));  // edge of a regular tet
    for (std::size_t s = 0; s < t.sample_count(); ++s)
        c.rest.contact_penalty[s * W + lane] = T(p.contact_penalty_factor * E / volume * spacing);
    double farthest = 0;
    for (const Point& r : p.mesh->nodes) farthest = std::max(farthest, std::hypot(r[0], r[1], r[2]));
    c.rest.extent[lane] = T(farthest);
    c.rest.tissue_stiffness[lane] = T(5 * E / volume * spacing);
    const double nu = p.poisson_ratio, lambda = nu / ((1 + nu) * (1 - 2 * nu));  // over Young's modulus
    c.rest.rounding_stiffness[lane] = T(std::max(5.0, 3 * lambda - 5) * E / volume * spacing);
    c.rest_reach[lane] = sphere_around(*p.mesh, t.samples);
    const Vec3<double> origin = nearest_origin(bone.position);
    for (int d = 0; d < 3; ++d) c.state.origin[d * W + lane] = origin[d];
    for (int i = 0; i < t.node_count; ++i) {
        const Point& r = p.mesh->nodes[i];
        const Vec3<double> x = transform(bone, Vec3<double>{r[0], r[1], r[2]}) - origin;
        for (int d = 0; d < 3; ++d) {
            c.rest.rest_position[(3 * i + d) * W + lane] = T(r[d]);
            c.state.position[(3 * i + d) * W + lane] = T(x[d]);
        }
    }
    const Vec3<double> b = bone.position - origin;
    const double values[7] = {b.x, b.y, b.z, bone.rotation.w, bone.rotation.x, bone.rotation.y, bone.rotation.z};
    for (int i = 0; i < 7; ++i) c.state.bone[i * W + lane] = T(values[i]);
}

template <class T>
void set_contact_areas(SkinChunk<T>& c, int lane, const TetMesh& mesh) {
    const SkinTopology& t = *c.topology;
    const std::vector<double> area = nodal_areas(mesh);
    const std::size_t S = t.sample_count();
    c.rest.contact_area.resize(S * std::size_t(c.width));
    // Samples between nodes take their part of the area around them.
    const double share = double(t.samples.size()) / double(S);
    for (std::size_t s = 0; s < S; ++s) {
        double a = 0;
        if (s < t.samples.size())
            a = area[std::size_t(t.samples[s])];
        else
            for (int k = 0; k < 3; ++k) {
                const FaceSample& f = t.face_samples[s - t.samples.size()];
                a += f.weight[k] * area[std::size_t(f.node[k])];
            }
        c.rest.contact_area[s * std::size_t(c.width) + std::size_t(lane)] = T(share * a);
    }
}

template <class T>
void set_lane_friction(SkinChunk<T>& c, int lane, int object, double friction, const std::vector<double>& objects) {
    const auto W = std::size_t(c.width);
    LaneArray<T>& all = c.rest.object_friction;
    if (all.empty())
        for (double value : objects) all.insert(all.end(), W, T(value));
    all[std::size_t(object) * W + std::size_t(lane)] = T(friction);
}

template <class T>
void place_slots(SkinChunk<T>& c) {
    const int W = c.width;
    for (int slot = 0; slot < c.slot_capacity; ++slot) {
        if (c.slots[slot].object < 0) continue;
        T* out = &c.scratch.slot_frame[24 * std::size_t(slot) * W];
        for (const Pose<double>* pose : {&c.slots[slot].pose, &c.slots[slot].start}) {
            for (int l = 0; l < W; ++l) {
                if (!c.lane_poses.empty() && slot == 0) pose = &c.lane_poses[std::size_t(l)];
                const Mat3<double> R = rotation_matrix(pose->rotation);
                for (int i = 0; i < 12; ++i)
                    out[i * W + l] =
                        T(i < 9 ? R.m[i / 3][i % 3] : pose->position[i - 9] - c.state.origin[(i - 9) * W + l]);
            }
            out += 12 * W;
        }
    }
}

template <class T>
SlotOrder occupied_slots(const SkinChunk<T>& c) {
    SlotOrder o;
    for (int slot = 0; slot < c.slot_capacity; ++slot) {
        if (c.slots[slot].object < 0) continue;
        int place = o.count++;
        for (; place > 0 && c.slots[o.slot[place - 1]].object > c.slots[slot].object; --place)
            o.slot[place] = o.slot[place - 1];
        o.slot[place] = slot;
    }
    return o;
}

template <class T>
void leave_linear_tissue(SkinChunk<T>& c, unsigned lanes) {
    c.linear_lanes &= ~lanes;
    c.linear.kept_lanes &= ~lanes;
    c.linear.fresh_lanes &= ~lanes;
}

template <class T>
void rebase_lane(SkinChunk<T>& c, int lane) {
    const int W = c.width;
    bool far = false;
    for (int d = 0; d < 3; ++d) far |= !(std::abs(double(c.state.bone[d * W + lane])) < 1.5 * origin_grid);
    if (!far) return;
    const Pose<double> bone = lane_bone(c, lane);
    if (!std::isfinite(dot(bone.position, bone.position))) return;
    const Vec3<double> old = lane_origin(c, lane), origin = nearest_origin(bone.position);
    for (int d = 0; d < 3; ++d) {
        c.state.origin[d * W + lane] = origin[d];
        const double shift = old[d] - origin[d];
        auto move = [&](T& x) { x = T(double(x) + shift); };
        move(c.state.bone[d * W + lane]);
        for (int i = 0; i < c.topology->node_count; ++i) move(c.state.position[(3 * i + d) * W + lane]);
    }
}

template <class T>
Vec3<double> lane_origin(const SkinChunk<T>& c, int lane) {
    return {c.state.origin[lane], c.state.origin[c.width + lane], c.state.origin[2 * c.width + lane]};
}

template <class T>
Vec3<double> node_position(const SkinChunk<T>& c, int node, int lane) {
    if ((c.rigid_lanes >> lane) & 1u) {
        Vec3<double> rest;
        for (int d = 0; d < 3; ++d) rest[d] = double(c.rest.rest_position[(3 * node + d) * c.width + lane]);
        return transform(lane_bone(c, lane), rest);
    }
    Vec3<double> x = lane_origin(c, lane);
    for (int d = 0; d < 3; ++d) x[d] += double(c.state.position[(3 * node + d) * c.width + lane]);
    return x;
}

template <class T>
Pose<double> lane_bone(const SkinChunk<T>& c, int lane) {
    auto b = [&](int i) { return double(c.state.bone[i * c.width + lane]); };
    return {lane_origin(c, lane) + Vec3<double>{b(0), b(1), b(2)}, {b(3), b(4), b(5), b(6)}};
}

template <class T>
void fill_empty_lanes(SkinChunk<T>& c) {
    const int W = c.width;
    for_each_array(c, [&](LaneArray<T>& a) {
        for (std::size_t i = 0; i + W <= a.size(); i += W)
            for (int l = 0; l < W; ++l)
                if (!((c.used_lanes >> l) & 1u)) a[i + l] = a[i];
    });
    for (int d = 0; d < 3; ++d)
        for (int l = 0; l < W; ++l)
            if (!((c.used_lanes >> l) & 1u)) c.state.origin[d * W + l] = c.state.origin[d * W];
}

template <class T>
std::size_t memory_bytes(const SkinChunk<T>& c) {
    std::size_t bytes = sizeof(c);
    for_each_array(const_cast<SkinChunk<T>&>(c), [&](LaneArray<T>& a) { bytes += a.size() * sizeof(T); });
    return bytes;
}

#define PALPATE_INSTANTIATE(T)                                                                                    \
    template void allocate_chunk(SkinChunk<T>&, std::shared_ptr<const SkinTopology>, int, bool, bool, int, bool); \
    template void allocate_linear_tissue(SkinChunk<T>&);                                                          \
    template void set_lane(SkinChunk<T>&, int, int, const SkinParameters&, const Pose<double>&);                  \
    template void set_contact_areas(SkinChunk<T>&, int, const TetMesh&);                                          \
    template void set_lane_friction(SkinChunk<T>&, int, int, double, const std::vector<double>&);                 \
    template void place_slots(SkinChunk<T>&);                                                                     \
    template SlotOrder occupied_slots(const SkinChunk<T>&);                                                       \
    template void leave_linear_tissue(SkinChunk<T>&, unsigned);                                                   \
    template void rebase_lane(SkinChunk<T>&, int);                                                                \
    template Vec3<double> lane_origin(const SkinChunk<T>&, int);                                                  \
    template Vec3<double> node_position(const SkinChunk<T>&, int, int);                                           \
    template Pose<double> lane_bone(const SkinChunk<T>&, int);                                                    \
    template void fill_empty_lanes(SkinChunk<T>&);                                                                \
    template std::size_t memory_bytes(const SkinChunk<T>&);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
