#include <algorithm>
#include <cmath>
#include <span>

#include "engine/contact/contact_edge.h"
#include "engine/contact/crossed_skin.h"
#include "engine/contact/fitted.h"
#include "engine/skin/chunks/contact_slots.h"
#include "engine/skin/solve/fitted.h"
#include "engine/skin/solve/kernels.h"
#include "engine/systems.h"

namespace palpate {

namespace {

template <class T>
Vec3<double> read_vec3(const LaneArray<T>& a, std::size_t index, int width, int lane) {
    const T* p = &a[3 * index * width + lane];
    return {double(p[0]), double(p[width]), double(p[2 * width])};
}

/// A sample of a nodal array of positions, world [m].
template <class T>
Vec3<double> sample_position(const SkinChunk<T>& c, const LaneArray<T>& nodal, std::size_t s, int lane) {
    const SkinTopology& t = *c.topology;
    if (s < t.samples.size()) return lane_origin(c, lane) + read_vec3(nodal, t.samples[s], c.width, lane);
    const FaceSample& f = t.face_samples[s - t.samples.size()];
    Vec3<double> x = lane_origin(c, lane);
    for (int k = 0; k < 3; ++k) x += f.weight[k] * read_vec3(nodal, f.node[k], c.width, lane);
    return x;
}

/// A number that rounds as the kernels of wide registers do, and is no type of theirs.
template <class T>
using FusedNumber = Lanes<T, 1, 1024>;

/// Normal of an object at a sample, world, by the numbers that the solve had, which are of type R.
template <class R, class T>
Vec3<double> normal_of_solve(const SkinChunk<T>& c, int lane, int slot, std::size_t s, T side) {
    const SkinTopology& t = *c.topology;
    const std::size_t W = std::size_t(c.width), l = std::size_t(lane);
    const LaneContact& o = c.contacts.at(slot, lane);
    auto read = [&](const LaneArray<T>& a, std::size_t first) {
        return Vec3<R>{R(a[first * W + l]), R(a[(first + 1) * W + l]), R(a[(first + 2) * W + l])};
    };
    const std::size_t frame = 24 * std::size_t(slot);
    Mat3<R> rotation;
    for (std::size_t i = 0; i < 9; ++i) rotation.m[i / 3][i % 3] = R(c.scratch.slot_frame[(frame + i) * W + l]);
    const Vec3<R> position = read(c.scratch.slot_frame, frame + 9);
    auto node = [&](int n) { return read(c.state.position, 3 * std::size_t(n)); };
    Vec3<R> x;
    if (s < t.samples.size()) {
        x = node(t.samples[s]);
    } else {
        const FaceSample& f = t.face_samples[s - t.samples.size()];
        x = R(T(f.weight[0])) * node(f.node[0]);
        for (int k = 1; k < 3; ++k) x += R(T(f.weight[k])) * node(f.node[k]);
    }
    const Vec3<R> local = transposed_times(rotation, x - position);
    if (o.shape.kind == ShapeKind::mesh && side >= T(covered_mesh)) {
        const Vec3<double> at{double(palpate::lane(local.x, 0)), double(palpate::lane(local.y, 0)),
                              double(palpate::lane(local.z, 0))};
        return rotation_matrix(o.pose.rotation) * foot_point(o.shape, at, double(side), mesh_contact_distance).normal;
    }
    const Vec3<R> size{R(T(o.shape.size.x)), R(T(o.shape.size.y)), R(T(o.shape.size.z))};
    const Vec3<R> n =
        rotation * (has_sides(o.shape.kind) ? sided_point(o.shape.kind, size, R(T(o.shape.round)), local, R(side))
                                            : local_surface_point(o.shape, local))
                       .normal;
    return {double(palpate::lane(n.x, 0)), double(palpate::lane(n.y, 0)), double(palpate::lane(n.z, 0))};
}

/// Normal of an object at a sample, world. In single precision by the numbers that the solve had: where a sample
/// touches an edge, a rounding of its place turns the normal. (Then, of a mesh, of about length one.) Planes between
/// fingers are where balance_planes has put them since.
template <class T>
Vec3<double> pressed_normal(const SkinChunk<T>& c, int lane, int slot, std::size_t s) {
    const LaneContact& o = c.contacts.at(slot, lane);
    const std::size_t i = std::size_t(slot) * c.topology->sample_count() + s;
    const T side = c.state.contact_side[i * std::size_t(c.width) + std::size_t(lane)];
    if (std::is_same_v<T, double> || o.finger >= 0)
        return surface_point(o.shape, o.pose, sample_position(c, c.state.position, s, lane), double(side)).normal;
    if (&best_kernels() == &plain_kernels) return normal_of_solve<T>(c, lane, slot, s, side);
    return normal_of_solve<FusedNumber<T>>(c, lane, slot, s, side);
}

/// Force of an object on a sample, world [N].
struct SampleForce {
    Vec3<double> whole{0, 0, 0}, pressing{0, 0, 0};  ///< with friction; along the object's normal alone
    Vec3<double> normal{0, 0, 0};                    ///< of the object; where it presses
};

/// Force of an object on a sample at x; adds to the sums of the object. Friction acts with the normal force of
/// the last multiplier update: in the step in which a sample leaves the object, it acts alone.
template <class T>
SampleForce sample_force(const SkinChunk<T>& c, int lane, int slot, std::size_t s, const Vec3<double>& x,
                         ObjectContact& sums) {
    const LaneContact& object = c.contacts.at(slot, lane);
    const std::size_t i = std::size_t(slot) * c.topology->sample_count() + s;
    const double normal_force = c.state.normal_multiplier[i * std::size_t(c.width) + std::size_t(lane)];
    SampleForce force;
    if (c.has_friction && object.friction > 0) {
        const Vec3<double> friction = read_vec3(c.state.tangential_multiplier, i, c.width, lane);
        force.whole -= rotation_matrix(object.pose.rotation) * friction;
        sums.friction_force += norm(friction);
        sums.friction_available += object.friction * std::max(normal_force, 0.0);
    }
    if (normal_force > 0) {
        const Vec3<double> normal = force.normal = pressed_normal(c, lane, slot, s);
        force.pressing = normal_force * normal;
        force.whole = force.pressing + force.whole;
        const Vec3<double> before = sample_position(c, c.scratch.start_position, s, lane);
        const Vec3<double> moved = rotation_matrix(object.pose.rotation) *
                                   (inverse_transform(object.pose, x) - inverse_transform(object.start, before));
        const double total = sums.normal_force + normal_force;
        sums.slip += normal_force / total * (norm(moved - dot(moved, normal) * normal) - sums.slip);
        sums.normal_force = total;
    }
    sums.force += force.whole;
    return force;
}

void add_force(std::size_t sample, const Vec3<double>& whole, const Vec3<double>& pressing, ContactSurface& out) {
    out.force[sample] += whole;
    out.pressing[sample] += pressing;
    out.bears[sample] = 1;
}

/// Asks early for the memory that clear_forces() writes: of ten thousand fingers, no cache holds it.
void ask_for_forces(const ContactSurface& out) {
#if defined(__GNUC__)
    for (std::size_t s = 0; s < out.bears.size(); ++s)
        if (out.bears[s]) __builtin_prefetch(&out.force[s], 1), __builtin_prefetch(&out.pressing[s], 1);
#endif
}

/// Of the samples that had any: few of a pad's do, and the others' memory is not fetched.
void clear_forces(ContactSurface& out) {
    for (std::size_t s = 0; s < out.bears.size(); ++s)
        if (out.bears[s]) out.force[s] = out.pressing[s] = {0, 0, 0}, out.bears[s] = 0;
    std::fill(out.touches.begin(), out.touches.end(), 0);
}

/// Whether an object rubs a sample.
template <class T>
bool rubs(const SkinChunk<T>& c, int lane, int slot, std::size_t s) {
    if (!c.has_friction) return false;
    const std::size_t i = std::size_t(slot) * c.topology->sample_count() + s;
    const Vec3<double> friction = read_vec3(c.state.tangential_multiplier, i, c.width, lane);
    return dot(friction, friction) > 0;
}

/// From nodes to the skin that touches, as the solve had it: what of a bulge is along an object's normal made its gap
/// smaller (set_rise). A dent leaves nodes outside. Where nothing is near, bulges are not found.
template <class T>
void read_bulges(const SkinChunk<T>& c, int lane, ContactSurface& out) {
    const bool found = (near_lanes(c) >> lane) & 1u;
    const Mat3<double> bone = rotation_matrix(out.bone.rotation);
    for (std::size_t s = 0; s < out.bulge.size(); ++s) {
        const Vec3<double> b = transposed_times(bone, read_vec3(c.scratch.bulge, s, c.width, lane));
        out.bulge[s] = found && dot(b, lane_outward(c, lane)[s]) > 0 ? b : Vec3<double>{0, 0, 0};
    }
}

/// Outward normals of the pad at its nodes, as long as twice an area, finger frame.
void find_outward(const ContactSurface& surface, std::span<Vec3<double>> outward) {
    std::fill(outward.begin(), outward.end(), Vec3<double>{0, 0, 0});
    for (const auto& f : surface.faces) {
        const Vec3<double>& a = surface.position[std::size_t(f[0])];
        const Vec3<double> area =
            cross(surface.position[std::size_t(f[1])] - a, surface.position[std::size_t(f[2])] - a);
        for (int s : f) outward[std::size_t(s)] += area;
    }
}

/// Whether a node is pressed out of the finger, rather than into it: along its own outward normal. What presses there
/// has passed through the skin.
bool is_pressed_from_inside(const SampleForce& force, const Vec3<double>& outward) {
    constexpr double straight = 0.7;  // skin that folds around an edge meets it from the side
    return dot(force.normal, outward) > straight * norm(outward);
}

/// Of samples beside those that touch: how far what is nearest is from them. Nothing near: far.
template <class T>
void find_gaps(const SkinChunk<T>& c, int lane, ContactSurface& out) {
    mark_wanted_gaps(out);
    for (std::size_t s = 0; s < out.gap.size(); ++s) {
        if (!(out.gap[s] < 0)) continue;
        const Vec3<double> x = transform(out.bone, out.position[s]);
        double nearest = HUGE_VAL;
        for (int slot = 0; slot < c.contacts.count[std::size_t(lane)]; ++slot) {
            const LaneContact& o = c.contacts.at(slot, lane);
            const std::size_t i = (std::size_t(slot) * c.topology->sample_count() + s) * std::size_t(c.width);
            const double side = double(c.state.contact_side[i + std::size_t(lane)]);
            double gap = surface_point(o.shape, o.pose, x, side).distance;
            if (!c.scratch.rise.empty())
                gap -= double(c.scratch.rise[(std::size_t(slot) * out.gap.size() + s) * std::size_t(c.width) +
                                             std::size_t(lane)]);
            nearest = std::min(nearest, gap);
        }
        out.gap[s] = std::max(0.0, nearest);
    }
}

void measure_touching(ContactSurface& out) {
    out.touching = int(std::count(out.touches.begin(), out.touches.end(), char(1)));
    out.touching_area = out.touching > 0 ? area_in_contact(out) : 0;
}

/// Forces that contradict each other: samples of one face, or a node, are pushed one way by one object and back by
/// another, deep in both of them. Each update of multipliers makes them larger, and nothing else feels them. They let
/// go, and what is reported is what nodes feel.
template <class T>
bool let_go_of_contradictions(SkinChunk<T>& c, int lane, ContactSurface& out) {
    SkinStatus& status = c.status[std::size_t(lane)];
    if (status.converged || status.penetration_m < fitted::contradicts_from) return false;
    double felt = 0;
    for (const Vec3<double>& f : out.pressing) felt += norm(f);
    if (felt >= fitted::contradicts_below * out.normal_force) return false;
    const double share = felt / out.normal_force;
    out.normal_force = status.contact_force_N = felt;
    for (ObjectContact& o : out.objects) o.normal_force *= share, o.friction_available *= share;
    const auto W = std::size_t(c.width), l = std::size_t(lane), S = c.topology->sample_count();
    for (std::size_t i = 0; i < std::size_t(c.contacts.count[l]) * S; ++i) {
        c.state.normal_multiplier[i * W + l] = T(0);
        if (!c.has_friction) continue;
        for (std::size_t k = 0; k < 3; ++k) c.state.tangential_multiplier[(3 * i + k) * W + l] = T(0);
        c.state.friction_radius[i * W + l] = T(0);
    }
    c.state.penalty_scale[W + l] = T(1);
    return true;
}

template <class T>
void extract(SkinChunk<T>& c, int lane, double tolerance, Coupling& coupling, ContactSurface& out) {
    const SkinTopology& t = *c.topology;
    const int W = c.width;
    const Pose<double> bone = lane_bone(c, lane);
    out.bone = bone;
    Vec3<double> pull;  // both from the origin
    for (int d = 0; d < 3; ++d)
        pull[d] = double(c.scratch.bone_springs[(2 + d) * W + lane]) - double(c.state.bone[d * W + lane]);
    coupling.force_N = std::min(coupling.stiffness * norm(pull), coupling.max_force);
    out.rough = false;
    if ((c.rigid_lanes >> lane) & 1u) return;  // it touches nothing, and did not when its skin was solved last
    ask_for_forces(out);
    out.total = {0, 0, 0};
    out.normal_force = 0;
    const std::size_t S = t.samples.size();
    const int slots = c.contacts.count[std::size_t(lane)];
    out.objects.assign(std::size_t(slots), ObjectContact{});
    for (int slot = 0; slot < slots; ++slot) {
        const LaneContact& o = c.contacts.at(slot, lane);
        out.objects[std::size_t(slot)].object = o.finger < 0 ? o.object : -1;
        out.objects[std::size_t(slot)].finger = o.finger;
    }
    const Mat3<double> of_bone = rotation_matrix(bone.rotation);
    for (std::size_t s = 0; s < S; ++s) {
        out.position[s] = transposed_times(of_bone, node_position(c, t.samples[s], lane) - bone.position);
    }
    if (slots > 0 || !out.bulge.empty()) find_outward(out, lane_outward(c, lane));
    if (!out.bulge.empty()) read_bulges(c, lane, out);
    clear_forces(out);
    int pressed_from_inside = 0;
    for (std::size_t s = 0; s < t.sample_count(); ++s) {
        SampleForce force;
        double normal_force = 0;
        bool felt = false;
        for (int slot = 0; slot < slots; ++slot) {
            const double normal = c.state.normal_multiplier[(slot * t.sample_count() + s) * W + lane];
            if (normal <= 0 && !rubs(c, lane, slot, s)) continue;
            const Vec3<double> x = sample_position(c, c.state.position, s, lane);
            const SampleForce f = sample_force(c, lane, slot, s, x, out.objects[std::size_t(slot)]);
            force.whole += f.whole;
            force.pressing += f.pressing;
            normal_force += std::max(normal, 0.0);
            felt = true;
            if (s < S && normal > 0)
                pressed_from_inside += is_pressed_from_inside(f, of_bone * lane_outward(c, lane)[s]);
        }
        if (!felt) continue;
        const char touches = normal_force > 0;
        out.total += force.whole;
        out.normal_force += normal_force;
        if (s < S) {
            add_force(s, force.whole, force.pressing, out);
            out.touches[s] |= touches;
            continue;
        }
        // Between nodes: the nodes feel it.
        const FaceSample& f = t.face_samples[s - S];
        for (int k = 0; k < 3; ++k) {
            if (f.weight[k] <= 0) continue;
            const auto node = std::size_t(f.sample[k]);
            add_force(node, f.weight[k] * force.whole, f.weight[k] * force.pressing, out);
            out.touches[node] |= touches;
        }
    }
    find_gaps(c, lane, out);
    measure_touching(out);
    SkinStatus& status = c.status[std::size_t(lane)];
    status.wrong_sides = pressed_from_inside + nodes_behind(c, lane, out) + nodes_through_walls(c, lane, out) +
                         nodes_leapt(c, lane, out);
    // An island has converged as a whole: what little is left of its forces may be much of one finger's.
    const double share = std::max(fitted::own_residual, 3 * tolerance);
    const bool unbalanced = status.residual_N > std::max(share * status.contact_force_N, fitted::own_rounding);
    if (status.wrong_sides > 0 || unbalanced) status.converged = false;
    const bool contradicts = let_go_of_contradictions(c, lane, out);
    out.rough = contradicts || (!status.converged && status.contact_force_N > fitted::rough_from &&
                                status.residual_N > detail::fitted::rough_share * status.contact_force_N);
    out.rough_steps += out.rough;
}

/// A finger slips over another as far as both do over the plane between them.
void add_slips(Table<ContactSurface>& surfaces) {
    auto toward = [&](std::size_t row, int finger) {
        auto& all = surfaces[row].objects;
        return std::find_if(all.begin(), all.end(), [&](const ObjectContact& o) { return o.finger == finger; });
    };
    for (std::size_t row = 0; row < surfaces.size(); ++row)
        for (ObjectContact& o : surfaces[row].objects) {
            if (o.finger < int(row)) continue;
            const auto other = toward(std::size_t(o.finger), int(row));
            if (other != surfaces[std::size_t(o.finger)].objects.end()) o.slip = other->slip = o.slip + other->slip;
        }
}

/// The samples of a pad that are nodes of a stencil, with its weights; -1: held, or no sample.
template <class T>
int sample_of(const SkinChunk<T>& c, int node) {
    const std::vector<int>& samples = c.topology->samples;
    const auto at = std::lower_bound(samples.begin(), samples.end(), node);
    return at != samples.end() && *at == node ? int(at - samples.begin()) : -1;
}

/// Adds what one sample of a finger and a face of a soft object bear to one of the two; `sign` turns the finger's
/// force into its.
template <class T>
void add_soft_sample(const SkinChunk<T>& c, const Stencil& stencil, const SoftSample& s, double sign,
                     ContactSurface& out) {
    const Vec3<double> pressing = sign * s.terms.normal_force * s.normal, whole = -sign * s.terms.gradient;
    for (std::size_t k = 0; k < std::size_t(stencil.count); ++k) {
        const int i = sample_of(c, stencil.node[k]);
        if (i < 0 || !(stencil.weight[k] > 0)) continue;
        add_force(std::size_t(i), stencil.weight[k] * whole, stencil.weight[k] * pressing, out);
        if (s.terms.normal_force > 0) out.touches[std::size_t(i)] = 1;
    }
    out.total += whole;
    out.normal_force += s.terms.normal_force;
}

/// A soft object's surface is so far from a sample of a finger: where nothing else is nearer, that is its gap. Both
/// give way where they press, 1/E = 1/E_1 + 1/E_2: a gap against both is one against the skin alone of that share.
void add_gap(double gap, double modulus, std::size_t sample, ContactSurface& out) {
    gap = std::max(0.0, gap) * modulus / (modulus + out.modulus);
    out.gap[sample] = out.gap[sample] > 0 ? std::min(out.gap[sample], gap) : gap;
}

/// What a pair bears goes to both of its contact surfaces; what sleeps keeps what it had (null). The area is that of
/// the finger's skin, for a face of the object may be far larger than what presses on it.
template <class T>
void extract_pair(const SkinChunk<T>& finger, const SkinChunk<double>& soft, const SoftPair& p, const SoftObject& o,
                  ContactSurface* of_finger, ContactSurface* of_soft) {
    const int object = o.object;
    ObjectContact on_finger{object}, on_soft{-1, p.finger};
    const double before = of_finger ? of_finger->touching_area : 0;
    for (const SoftSample& s : p.samples) {
        if (of_finger && s.of_finger.count == 1) {
            const int sample = sample_of(finger, s.of_finger.node[0]);  // nothing near: far, as in find_gaps()
            if (sample >= 0) add_gap(s.near ? s.gap : HUGE_VAL, o.surface.modulus, std::size_t(sample), *of_finger);
        }
        if (!s.near || s.idle) continue;
        on_finger.normal_force += s.terms.normal_force;
        on_finger.friction_force += norm(s.terms.tangential);
        on_finger.force += -1.0 * s.terms.gradient;
        if (of_finger) add_soft_sample(finger, s.of_finger, s, 1, *of_finger);
        if (of_soft) add_soft_sample(soft, s.of_face, s, -1, *of_soft);
        if (!(s.terms.normal_force > 0)) continue;
        const double share = s.terms.normal_force / on_finger.normal_force;
        on_finger.slip += share * (s.slip - on_finger.slip);
    }
    on_finger.friction_available = p.friction * on_finger.normal_force;
    on_soft.force = -1.0 * on_finger.force;
    on_soft.normal_force = on_finger.normal_force, on_soft.friction_force = on_finger.friction_force;
    on_soft.friction_available = on_finger.friction_available, on_soft.slip = on_finger.slip;
    if (of_finger) {
        const auto later = [&](const ObjectContact& o) { return o.object < 0 || o.object > object; };
        of_finger->objects.insert(std::find_if(of_finger->objects.begin(), of_finger->objects.end(), later), on_finger);
        measure_touching(*of_finger);
    }
    if (of_soft) {
        of_soft->objects.push_back(on_soft);
        const double own = of_soft->touching_area;
        measure_touching(*of_soft);
        of_soft->touching_area = own + (of_finger ? of_finger->touching_area - before : 0);
    }
}

void extract_soft(const Table<Skin>& skins, double tolerance, SoftObjects& soft, SkinChunks& chunks,
                  Table<ContactSurface>& surfaces) {
    const auto fresh = [](const auto& c, int lane) { return !((c.unchanged_lanes >> lane) & 1u); };
    for (SoftObject& o : soft.all) {
        auto& chunk = chunks.doubles[std::size_t(o.skin.chunk)];
        if (fresh(chunk, o.skin.lane)) extract(chunk, o.skin.lane, tolerance, o.hold, o.surface);
    }
    for (const SoftPair& p : soft.pairs) {
        if (!p.near) continue;
        SoftObject& o = soft.all[std::size_t(p.soft)];
        const SkinChunk<double>& of_soft = chunks.doubles[std::size_t(o.skin.chunk)];
        const Skin& finger = skins[std::size_t(p.finger)];
        chunks.with(finger.single_precision, finger.chunk, [&](const auto& c) {
            extract_pair(c, of_soft, p, o, fresh(c, finger.lane) ? &surfaces[std::size_t(p.finger)] : nullptr,
                         fresh(of_soft, o.skin.lane) ? &o.surface : nullptr);
        });
    }
}

template <class T>
void extract_lane(SkinChunk<T>& c, int lane, const Table<Skin>& skins, double tolerance, Table<Coupling>& couplings,
                  Table<ContactSurface>& surfaces) {
    const int row = c.finger[std::size_t(lane)];
    if (row < 0 || row >= int(skins.size()) || ((c.unchanged_lanes >> lane) & 1u)) return;
    const EntityId finger = skins.owner(std::size_t(row));
    extract(c, lane, tolerance, *couplings.find(finger), *surfaces.find(finger));
}

/// The fingers of a chunk.
template <class T>
void extract_lanes(SkinChunk<T>& c, const Table<Skin>& skins, double tolerance, Table<Coupling>& couplings,
                   Table<ContactSurface>& surfaces) {
    for (int lane = 0; lane < c.width; ++lane) extract_lane(c, lane, skins, tolerance, couplings, surfaces);
}

/// How long reading the contact of some fingers takes, about [us].
double reading_us(const Table<Skin>& skins, SkinChunks& chunks) {
    constexpr double apart = 0.4, touching = 2, at_mesh = 8;
    double sum = 0;
    for (const Skin& skin : skins)
        chunks.with(skin.single_precision, skin.chunk, [&](const auto& c) {
            if (!has_own_work(c) || ((c.unchanged_lanes >> skin.lane) & 1u)) return;
            double most = apart;
            for (int slot = 0; slot < c.contacts.count[std::size_t(skin.lane)]; ++slot)
                most =
                    std::max(most, c.contacts.at(slot, skin.lane).shape.kind == ShapeKind::mesh ? at_mesh : touching);
            sum += most;
        });
    return sum;
}

}  // namespace

void extract_chunk(int chunk, const Table<Skin>& skins, double tolerance, SkinChunks& chunks,
                   Table<Coupling>& couplings, Table<ContactSurface>& surfaces) {
    chunks.with(chunk, [&](auto& c) { extract_lanes(c, skins, tolerance, couplings, surfaces); });
}

void extract_contact(const Table<Skin>& skins, double tolerance, Threads& threads, const FingerPairs& pairs,
                     SoftObjects& soft, SkinChunks& chunks, Table<Coupling>& couplings,
                     Table<ContactSurface>& surfaces) {
    auto extract_own = [&](int chunk) {
        chunks.with(chunk, [&](auto& c) {
            if (has_own_work(c)) extract_lanes(c, skins, tolerance, couplings, surfaces);
        });
    };
    auto extract_finger = [&](int row) {
        const Skin& skin = skins[std::size_t(row)];
        chunks.with(skin.single_precision, skin.chunk, [&](auto& c) {
            if (has_own_work(c)) extract_lane(c, skin.lane, skins, tolerance, couplings, surfaces);
        });
    };
    constexpr std::size_t few = 48;   // fingers of a chunk are read together, where there are enough chunks
    constexpr double waking_us = 25;  // what takes less is done sooner than threads are woken
    if (surfaces.size() >= few)
        threads.for_each(chunks.count(), extract_own);
    else if (threads.count() > 1 && reading_us(skins, chunks) > waking_us)
        threads.for_each(int(skins.size()), extract_finger);
    else
        for (int chunk = 0; chunk < chunks.count(); ++chunk) extract_own(chunk);
    if (!pairs.near.empty()) add_slips(surfaces);
    extract_soft(skins, tolerance, soft, chunks, surfaces);
}

}  // namespace palpate
