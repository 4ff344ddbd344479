#include "engine/skin/chunks/chunk.h"

#include <Eigen/Dense>
#include <cmath>
#include <stdexcept>

#include "engine/skin/chunks/fields.h"
#include "engine/skin/solve/fitted.h"

namespace palpate {

namespace {

double value_at(const std::vector<double>& values, std::size_t i) {
    return values.size() == 1 ? values[0] : values.at(i);
}

constexpr int first_slots = 4;  ///< objects near a lane for which there is memory from the start

}  // namespace

template <class T>
void resize_fields(SkinChunk<T>& c) {
    ContactSlots& s = c.contacts;
    s.slot.resize(std::size_t(s.capacity));
    s.lane_contact.resize(std::size_t(s.capacity * c.width));
    if (c.has_limits) {
        const std::size_t limits = c.topology->limit_count();
        c.scratch.noted_limits.reserve(limits);
        c.scratch.loaded_limits.resize(limits, all_lanes);
        c.scratch.candidate_limits.resize(has_own_work(c) ? limits : 0, all_lanes);
    }
    c.exchange.idle_columns.resize(c.has_bodies ? std::size_t(s.capacity) : 0);
    c.scratch.outward.resize(has_own_work(c) ? c.topology->samples.size() * std::size_t(c.width) : 0);
    c.scratch.changed_columns.resize(std::size_t(c.topology->pattern.columns), 1);
    if (c.width == 1 && c.topology->supernodes.workers > 1)
        c.scratch.factored.resize(c.topology->supernodes.supernodes.size());
    for_each_field(c, [&](auto& array, const Field& f) {
        array.resize(numbers_per_lane(f, s.capacity) * std::size_t(c.width),
                     typename std::remove_reference_t<decltype(array)>::value_type(f.first));
    });
}

template <class T>
void allocate_chunk(SkinChunk<T>& c, std::shared_ptr<const SkinTopology> topology, int width, bool has_limits,
                    bool has_friction, int object_count, bool has_bodies, bool has_membranes) {
    c.topology = std::move(topology);
    c.width = c.contacts.width = width;
    c.contacts.capacity = std::min(object_count, first_slots);
    c.has_limits = has_limits;
    c.has_friction = has_friction && object_count > 0;
    c.has_bodies = has_bodies;
    c.has_membranes = has_membranes;
    c.finger.assign(std::size_t(width), -1);
    c.status.assign(std::size_t(width), {});
    resize_fields(c);
}

template <class T>
void make_room_for_fingers(SkinChunk<T>& c, bool with_friction) {
    const bool bodies = c.has_bodies, friction = c.has_friction;
    const int slots = c.contacts.capacity;
    c.has_bodies = true;
    c.has_friction = friction || with_friction;
    c.contacts.capacity = std::max(slots, first_slots) + 2;  // objects, and fingers beside them
    resize_fields(c);                                        // touches what it makes
    c.has_bodies = bodies, c.has_friction = friction, c.contacts.capacity = slots;
    resize_fields(c);
}

template <class T>
void allocate_linear_tissue(SkinChunk<T>& c) {
    c.linear.pairs = tissue_pairs(*c.topology);
    resize_fields(c);
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

/// Two directions along the skin, the first as near to `along` as it can be.
Eigen::Matrix<double, 3, 2> tangents_of(const Eigen::Vector3d& normal, const Eigen::Vector3d& along) {
    Eigen::Vector3d first = along - along.dot(normal) * normal;
    first = first.squaredNorm() > 1e-12 ? first.normalized().eval() : normal.unitOrthogonal();
    Eigen::Matrix<double, 3, 2> tangents;
    tangents << first, normal.cross(first);
    return tangents;
}

/// Shape gradients along tangents of all elements; along any where one has no membrane. What shares a patch has
/// tangents that match.
template <class T>
void set_membrane_slopes(SkinChunk<T>& c, int lane, const std::vector<Point>& normals) {
    const SkinTopology& t = *c.topology;
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    auto normal_of = [&](std::size_t e) -> Eigen::Vector3d {
        if (normals.empty()) return Eigen::Vector3d::UnitZ();
        return Eigen::Map<const Eigen::Vector3d>(normals.at(std::size_t(t.mesh_element[e])).data()).normalized();
    };
    auto gradient_of = [&](std::size_t e, int node) {
        Eigen::Vector3d g = Eigen::Vector3d::Zero();
        for (std::size_t b = 1; b < 4; ++b)
            for (std::size_t d = 0; d < 3; ++d) {
                const double of_b = double(c.rest.shape_gradients[(9 * e + 3 * (b - 1) + d) * W + l]);
                g[Eigen::Index(d)] += node == t.elements[e][0] ? -of_b : node == t.elements[e][b] ? of_b : 0;
            }
        return g;
    };
    auto set = [&](std::size_t e, const std::array<int, 4>& corner, const Eigen::Vector3d& normal,
                   const Eigen::Vector3d& along) {
        const Eigen::Matrix<double, 3, 2> tangents = tangents_of(normal, along);
        for (std::size_t a = 1; a < 4; ++a) {
            const Eigen::Vector2d slope = tangents.transpose() * gradient_of(e, corner[a]);
            const bool missing = corner[a] == corner[0];
            for (std::size_t k = 0; k < 2; ++k)
                c.rest.membrane_slopes[(6 * e + 2 * (a - 1) + k) * W + l] = missing ? T(0) : T(slope[Eigen::Index(k)]);
        }
    };
    for (std::size_t e = 0; e < t.elements.size(); ++e)
        set(e, t.elements[e], normal_of(e), normal_of(e).unitOrthogonal());
    for (const MembranePatch& p : t.membrane_patches) {
        std::vector<Eigen::Vector3d> own;
        Eigen::Vector3d mean = Eigen::Vector3d::Zero();
        for (int i = p.first; i < p.first + p.count; ++i) {
            const auto e = std::size_t(t.membrane_elements[std::size_t(i)]);
            const auto& corner = t.membrane_corner[std::size_t(i)];
            own.push_back(normal_of(e));
            // The face's: along the slope of the only node that is not in it.
            for (int node : t.elements[e])
                if (std::find(corner.begin(), corner.end(), node) == corner.end())
                    own.back() = -gradient_of(e, node).normalized();
            mean += own.back();
        }
        const Eigen::Vector3d along = mean.squaredNorm() > 1e-6 ? mean.unitOrthogonal() : own[0].unitOrthogonal();
        for (int i = 0; i < p.count; ++i) {
            const auto at = std::size_t(p.first + i);
            set(std::size_t(t.membrane_elements[at]), t.membrane_corner[at], own[std::size_t(i)], along);
        }
    }
}

/// Limits of patches: their elements' means, by volume, and volume dF/dx of their nodes. Elements themselves are then
/// held by powers of their own limits: wide enough to leave it to their patch, and near enough that none is turned
/// inside out under any load.
template <class T>
void set_patch_limits(SkinChunk<T>& c, int lane, int low_power) {
    const SkinTopology& t = *c.topology;
    const auto W = std::size_t(c.width), l = std::size_t(lane);
    const std::size_t elements = t.elements.size(), patches = t.limit_patches.size();
    std::vector<double> volume(patches, 0.0), mean(3 * patches, 0.0), slopes(3 * t.limit_nodes.size(), 0.0);
    RestArray<T>* const values[] = {&c.rest.limit_low, &c.rest.limit_high, &c.rest.limit_penalty};
    for (const LimitPart& p : t.limit_parts) {
        const auto e = std::size_t(p.element), k = std::size_t(p.patch);
        const LimitPatch& patch = t.limit_patches[k];
        const double part = p.share * double(c.rest.volume[e * W + l]);
        volume[k] += part;
        for (std::size_t i = 0; i < 3; ++i) mean[3 * k + i] += part * double((*values[i])[e * W + l]);
        const auto nodes = t.limit_nodes.begin() + patch.first_node;
        const auto place = [&](std::size_t a) {
            return std::size_t(patch.first_node + std::find(nodes, nodes + patch.node_count, t.elements[e][a]) - nodes);
        };
        for (std::size_t a = 0; a < 3; ++a)
            for (std::size_t d = 0; d < 3; ++d) {
                const double slope = part * double(c.rest.shape_gradients[(9 * e + 3 * a + d) * W + l]);
                slopes[3 * place(a + 1) + d] += slope;
                slopes[3 * place(0) + d] -= slope;
            }
    }
    for (std::size_t k = 0; k < patches; ++k) {
        c.rest.limit_volume[k * W + l] = T(volume[k]);
        for (std::size_t i = 0; i < 3; ++i) (*values[i])[(elements + k) * W + l] = T(mean[3 * k + i] / volume[k]);
    }
    for (std::size_t i = 0; i < slopes.size(); ++i) c.rest.limit_slopes[i * W + l] = T(slopes[i]);
    for (std::size_t e = 0; e < elements; ++e) {
        T &low = c.rest.limit_low[e * W + l], &high = c.rest.limit_high[e * W + l];
        const T own = low;
        for (int k = 1; k < low_power; ++k) low *= own;
        high *= high;
    }
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
        const double membrane = p.membrane_young.empty() ? 0 : p.membrane_young.at(m);
        const double membrane_mu = membrane / (2 * (1 + nu)), membrane_lambda = membrane * nu / (1 - nu * nu);
        if (c.has_membranes) {
            c.rest.membrane_mu[e * W + lane] = T(membrane_mu);
            c.rest.membrane_lambda[e * W + lane] = T(membrane_lambda);
        }
        if (c.has_limits) {
            // A finger without limits in a chunk with them gets bounds that are never met.
            c.rest.limit_low[e * W + lane] = T(p.has_limits ? value_at(p.limit_low, m) : 1e-3);
            c.rest.limit_high[e * W + lane] = T(p.has_limits ? value_at(p.limit_high, m) : 1e3);
            c.rest.limit_penalty[e * W + lane] = T(p.limit_penalty_factor * (E + membrane));
        }
        for (int a : tet) mass[a] += p.density * volume / 4;
        if (!c.linear.weight.empty())
            c.linear.weight[e * W + lane] =
                T(volume * linear_error_weight(G, E / (2 * (1 + nu)) + membrane_mu,
                                               E * nu / ((1 + nu) * (1 - 2 * nu)) + membrane_lambda));
        if (!c.state.svd_guess.empty())
            for (int i = 0; i < 9; i += 4) c.state.svd_guess[(9 * e + i) * W + lane] = T(1);
    }
    for (std::size_t k = 0; k < t.patches.size(); ++k) {
        double compliance = 0;  // elements of unlike stiffness under one pressure
        for (int e = t.patches[k].first; e < t.patches[k].first + t.patches[k].count; ++e)
            compliance += double(c.rest.volume[e * W + lane]) / double(c.rest.lambda[e * W + lane]);
        c.rest.patch_bulk[k * std::size_t(W) + std::size_t(lane)] = T(1 / compliance);
    }
    if (c.has_limits && !t.limit_patches.empty()) set_patch_limits(c, lane, p.element_low_power);
    if (c.has_membranes) set_membrane_slopes(c, lane, p.membrane_normal);
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
    own_rest(c);
    const SkinTopology& t = *c.topology;
    const int W = c.width;
    c.finger[lane] = finger;
    c.used_lanes |= 1u << lane;
    set_elements(c, lane, p);
    double volume = 0, E = 0;
    for (std::size_t e = 0; e < t.elements.size(); ++e) {
        volume += c.rest.volume[e * W + lane];
        const std::size_t m = t.mesh_element[e];
        E += (value_at(p.young_modulus, m) + (p.membrane_young.empty() ? 0 : p.membrane_young.at(m))) *
             c.rest.volume[e * W + lane];
    }
    const double spacing = std::cbrt(8.5 * volume / double(t.elements.size()));  // edge of a regular tet
    for (std::size_t s = 0; s < t.sample_count(); ++s)
        c.rest.contact_penalty[s * W + lane] = T(p.contact_penalty_factor * E / volume * spacing);
    const std::vector<bool> on_pad = corners_on_pad(t, *p.mesh);
    for (std::size_t k = 0; k < on_pad.size(); ++k) c.rest.corner_on_pad[k * W + lane] = T(on_pad[k]);
    double farthest = 0;
    for (const Point& r : p.mesh->nodes) farthest = std::max(farthest, std::hypot(r[0], r[1], r[2]));
    c.rest.extent[lane] = T(farthest);
    c.rest.tissue_stiffness[lane] = T(detail::fitted::tissue_stiffness * E / volume * spacing);
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
    c.has_soft_objects = true;
    resize_fields(c);
    c.rest.contact_area.own();
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
    RestArray<T>& all = c.rest.object_friction;
    if (all.empty()) {
        c.own_frictions = int(objects.size());
        resize_fields(c);
        for (std::size_t i = 0; i < all.size(); ++i) all[i] = T(objects[i / W]);
    }
    all.own();
    all[std::size_t(object) * W + std::size_t(lane)] = T(friction);
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
void own_rest(SkinChunk<T>& c) {
    for_each_rest_field(c, [](auto& array, const Field&) { array.own(); });
}

template <class T>
void fill_empty_lanes(SkinChunk<T>& c) {
    const int W = c.width;
    own_rest(c);
    for_each_field(c, [&](auto& a, const Field&) {
        for (std::size_t i = 0; i + W <= a.size(); i += W)
            for (int l = 0; l < W; ++l)
                if (!((c.used_lanes >> l) & 1u)) a[i + l] = a[i];
    });
}

namespace {
template <class T>
std::size_t bytes_of(const LaneArray<T>& a) {
    return a.size() * sizeof(T);
}
template <class T>
std::size_t bytes_of(const RestArray<T>& a) {  // its part of what is shared
    return a.size() * sizeof(T) / std::size_t(a.sharers());
}
}  // namespace

template <class T>
std::size_t memory_bytes(const SkinChunk<T>& c) {
    std::size_t bytes = sizeof(c);
    for_each_field(const_cast<SkinChunk<T>&>(c), [&](const auto& a, const Field&) { bytes += bytes_of(a); });
    return bytes;
}

#define PALPATE_INSTANTIATE(T)                                                                                   \
    template void allocate_chunk(SkinChunk<T>&, std::shared_ptr<const SkinTopology>, int, bool, bool, int, bool, \
                                 bool);                                                                          \
    template void make_room_for_fingers(SkinChunk<T>&, bool);                                                    \
    template void allocate_linear_tissue(SkinChunk<T>&);                                                         \
    template void set_lane(SkinChunk<T>&, int, int, const SkinParameters&, const Pose<double>&);                 \
    template void set_contact_areas(SkinChunk<T>&, int, const TetMesh&);                                         \
    template void set_lane_friction(SkinChunk<T>&, int, int, double, const std::vector<double>&);                \
    template void resize_fields(SkinChunk<T>&);                                                                  \
    template void leave_linear_tissue(SkinChunk<T>&, unsigned);                                                  \
    template void rebase_lane(SkinChunk<T>&, int);                                                               \
    template Vec3<double> lane_origin(const SkinChunk<T>&, int);                                                 \
    template Vec3<double> node_position(const SkinChunk<T>&, int, int);                                          \
    template Pose<double> lane_bone(const SkinChunk<T>&, int);                                                   \
    template void own_rest(SkinChunk<T>&);                                                                       \
    template void fill_empty_lanes(SkinChunk<T>&);                                                               \
    template std::size_t memory_bytes(const SkinChunk<T>&);
PALPATE_INSTANTIATE(double)
PALPATE_INSTANTIATE(float)
#undef PALPATE_INSTANTIATE

}  // namespace palpate
