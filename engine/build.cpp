#include "engine/build.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <stdexcept>

#include "engine/bodies/islands.h"
#include "engine/bodies/prepare_bodies.h"
#include "engine/contact/fitted.h"
#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/chunks/work_memory.h"
#include "engine/skin/solve/kernels.h"
#include "engine/skin/solve/solve_skin.h"

namespace palpate {

namespace {

ContactSurface contact_surface_of(const FingerSpec& finger, const Pose<double>& bone);

/// Lets b have a's rest data, where they are the same.
void share_rest(const ContactSurface& a, ContactSurface& b) {
    if (a.area == b.area) b.area.share(a.area);
    if (a.faces == b.faces) b.faces.share(a.faces);
    if (a.rim_faces == b.rim_faces) b.rim_faces.share(a.rim_faces);
    if (a.back_faces == b.back_faces) b.back_faces.share(a.back_faces);
}

/// Fingers of one archetype: same connectivity, precision and material.
struct Archetype {
    const TetMesh* mesh;
    bool single_precision;
    Material material;
    std::vector<int> fingers;
};

bool same_connectivity(const TetMesh& a, const TetMesh& b) {
    return a.nodes.size() == b.nodes.size() && a.tets == b.tets && a.bone_nodes == b.bone_nodes &&
           a.pad_nodes == b.pad_nodes && a.patches == b.patches && a.limit_patches == b.limit_patches &&
           a.limit_shares == b.limit_shares && a.membrane_patches == b.membrane_patches &&
           a.curved_skin == b.curved_skin;
}

std::vector<Archetype> sort_into_archetypes(const SceneSpec& spec) {
    std::vector<Archetype> archetypes;
    for (int i = 0; i < int(spec.fingers.size()); ++i) {
        const FingerSpec& f = spec.fingers[i];
        auto fits = [&](const Archetype& a) {
            return a.single_precision == f.single_precision && a.material == f.material &&
                   same_connectivity(*a.mesh, f.mesh);
        };
        auto it = std::find_if(archetypes.begin(), archetypes.end(), fits);
        if (it == archetypes.end()) {
            archetypes.push_back({&f.mesh, f.single_precision, f.material, {}});
            it = std::prev(archetypes.end());
        }
        it->fingers.push_back(i);
    }
    return archetypes;
}

SkinParameters parameters_of(const FingerSpec& f) {
    SkinParameters p;
    p.mesh = &f.mesh;
    p.young_modulus = f.element_young.empty() ? std::vector{f.young_modulus} : f.element_young;
    p.membrane_young = f.element_membrane;
    p.membrane_normal = f.element_normal;
    p.poisson_ratio = f.poisson_ratio;
    p.density = f.density;
    p.has_limits = f.has_limits;
    p.limit_low = f.element_low.empty() ? std::vector{f.limit_low} : f.element_low;
    p.element_low_power = f.element_low_power;
    p.limit_high = f.element_high.empty() ? std::vector{f.limit_high} : f.element_high;
    return p;
}

/// In very short steps a node's inertia is what contact and limits have to overcome, rather than tissue: a penalty far
/// below it takes many updates of multipliers to be felt, which with a few iterations a step never settle (at 0.05 ms
/// they made a pressed finger bounce, with forces off by more than themselves).
SkinParameters stiffened_for_inertia(SkinParameters p, const SolverSettings& solver) {
    if (!solver.inertia) return p;
    double volume = 0, softest = HUGE_VAL, mean = 0;
    for (const auto& tet : p.mesh->tets) {
        Eigen::Matrix3d edges;
        for (int a = 1; a < 4; ++a)
            for (int d = 0; d < 3; ++d) edges(d, a - 1) = p.mesh->nodes[tet[a]][d] - p.mesh->nodes[tet[0]][d];
        volume += std::abs(edges.determinant()) / 6;
    }
    for (double young : p.young_modulus) {
        softest = std::min(softest, young);
        mean += young / double(p.young_modulus.size());
    }
    const double spacing = std::cbrt(8.5 * volume / double(p.mesh->tets.size()));  // edge of a regular tetrahedron
    // Six times the inertia of a node of a third of spacing^3: as many times as the penalty is above tissue's
    // stiffness.
    const double inertia = 2 * p.density * spacing * spacing / (solver.dt * solver.dt);
    p.contact_penalty_factor = std::max(p.contact_penalty_factor, inertia / mean);
    p.limit_penalty_factor = std::max(p.limit_penalty_factor, inertia / softest);
    return p;
}

bool has_bodies(const SceneSpec& spec) {
    return std::any_of(spec.objects.begin(), spec.objects.end(), [](auto& o) { return o.body.has_value(); });
}

bool has_tissue(const SceneSpec& spec) {
    return std::any_of(spec.objects.begin(), spec.objects.end(), [](auto& o) { return o.tissue.has_value(); });
}

/// Fingers of larger meshes are solved one by one: the factor of a finger alone works on panels, whose advantage grows
/// with the mesh (five of 4,000 elements are still 1.5 times as fast in shared lanes).
constexpr std::size_t largest_shared_mesh = 6000;

/// The error of linear tissue is known for corotational tissue alone.
bool tissue_may_be_linear(const SceneSpec& spec, const Archetype& a) {
    return spec.solver.detail_error > 0 && a.material == Material::corotational;
}

/// Whether some object gives way without being of tissue.
bool yielding(const SceneSpec& spec) {
    return std::any_of(spec.objects.begin(), spec.objects.end(), [](auto& o) { return o.stiffness > 0; });
}

/// Where some fingers of a chunk may be solved together with bodies or each other, and others not: a chunk in which
/// these can go on by themselves (gather_lanes), for each kind of chunk.
template <class T>
void add_places_to_part(const SceneSpec& spec, std::vector<SkinChunk<T>>& chunks, std::size_t first) {
    if (!has_bodies(spec) && !has_tissue(spec) && !(spec.fingers_touch && spec.fingers.size() > 2)) return;
    const std::size_t last = chunks.size();
    for (std::size_t k = first; k < last; ++k) {
        int widest = 0;
        bool before = false;
        for (std::size_t i = first; i < last; ++i) {
            if (!alike(chunks[k], chunks[i])) continue;
            before |= i < k;
            if (std::popcount(chunks[i].used_lanes) > 1) widest = std::max(widest, chunks[i].width);
        }
        if (!before && widest > 0) chunks.push_back(spare_chunk(chunks[k], widest));
    }
}

template <class T>
void fill_chunks(const SceneSpec& spec, const Archetype& a, std::vector<SkinChunk<T>>& chunks, SkinChunks& all,
                 std::vector<Skin>& skins) {
    auto rough = [](const auto& o) { return o.friction > 0; };
    const bool friction = std::any_of(spec.objects.begin(), spec.objects.end(), rough) ||
                          std::any_of(spec.finger_frictions.begin(), spec.finger_frictions.end(), rough);
    std::vector<double> object_frictions;
    for (const ObjectSpec& o : spec.objects) object_frictions.push_back(o.friction);
    const bool soft = yielding(spec);
    const bool shared = a.fingers.size() > 1 && a.mesh->tets.size() <= largest_shared_mesh;
    const auto topology =
        std::make_shared<const SkinTopology>(build_topology(*a.mesh, shared, spec.solver.sample_refinement));
    const std::size_t first_chunk = chunks.size();
    for (std::size_t first = 0; first < a.fingers.size();) {
        const int width = shared ? chunk_width<T>(int(a.fingers.size() - first)) : 1;
        const std::size_t last = std::min(a.fingers.size(), first + width);
        bool limits = false, membranes = false;
        for (std::size_t k = first; k < last; ++k) {
            limits |= spec.fingers[a.fingers[k]].has_limits;
            membranes |= !spec.fingers[a.fingers[k]].element_membrane.empty();
        }
        SkinChunk<T>& chunk = chunks.emplace_back();
        chunk.material = a.material;
        allocate_chunk(chunk, topology, width, limits, friction, int(spec.objects.size()), has_bodies(spec), membranes);
        if (tissue_may_be_linear(spec, a)) allocate_linear_tissue(chunk);
        chunk.keeps_matrix = may_keep_matrix(chunk, spec.solver);
        for (std::size_t k = first; k < last; ++k) {
            const int finger = a.fingers[k];
            const FingerSpec& f = spec.fingers[finger];
            set_lane(chunk, int(k - first), finger, stiffened_for_inertia(parameters_of(f), spec.solver), f.start);
            if (soft) set_contact_areas(chunk, int(k - first), f.mesh);
            for (const FingerFriction& own : spec.finger_frictions)
                if (own.finger == finger)
                    set_lane_friction(chunk, int(k - first), own.object, own.friction, object_frictions);
            skins[finger] = {f.name, sizeof(T) == 4, int(chunks.size()) - 1, int(k - first), f.mesh, f.start};
        }
        fill_empty_lanes(chunk);
        first = last;
    }
    add_places_to_part(spec, chunks, first_chunk);
    if (!has_tissue(spec)) share_work(chunks, first_chunk, all);  // else they may be solved with it
    share_rest(chunks, first_chunk);
    if (!shared || !spec.solver.inertia || spec.solver.sleep_speed <= 0) return;
    // A few fingers that touch, of many, are solved apart from the others (gather_lanes).
    const std::size_t last = chunks.size();
    for (const Kernel<T>& kernel : kernels_of<T>(best_kernels())) {
        bool here = kernel.width == 0, wider = false;
        for (std::size_t k = first_chunk; k < last; ++k) {
            here |= chunks[k].width == kernel.width;
            wider |= chunks[k].width > kernel.width;
        }
        if (wider && !here) chunks.push_back(spare_chunk(chunks[last - 1], kernel.width));
    }
}

/// What holds a soft object's fixed part at its pose: as good as nothing gives.
Coupling rigid_hold() {
    Coupling c;
    c.stiffness = 1e7, c.angular_stiffness = 1e4;
    c.damping = 0, c.angular_damping = 0;
    c.max_force = c.max_torque = 1e4;
    return c;
}

/// Of the faces of a mesh's surface [m].
double mean_edge(const TetMesh& mesh) {
    double sum = 0;
    for (const auto& face : mesh.surface)
        for (std::size_t k = 0; k < 3; ++k) {
            const Point &a = mesh.nodes[std::size_t(face[k])], &b = mesh.nodes[std::size_t(face[(k + 1) % 3])];
            sum += std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        }
    return mesh.surface.empty() ? 0 : sum / double(3 * mesh.surface.size());
}

/// A chunk of its own for each soft object.
void add_soft_objects(const SceneSpec& spec, World& world) {
    const bool friction = std::any_of(spec.objects.begin(), spec.objects.end(), [](auto& o) { return o.friction > 0; });
    const int refinement = tissue_refinement(spec);
    int unknowns = 0;
    for (int object = 0; object < int(spec.objects.size()); ++object) {
        const ObjectSpec& o = spec.objects[std::size_t(object)];
        if (!o.tissue) continue;
        const FingerSpec& f = *o.tissue;
        world.shapes[std::size_t(object)].soft = int(world.soft.all.size());
        SoftObject& soft = world.soft.all.emplace_back();
        SkinChunk<double>& chunk = world.chunks.doubles.emplace_back();
        allocate_chunk(chunk, std::make_shared<const SkinTopology>(build_topology(f.mesh, false, refinement)), 1,
                       f.has_limits, friction, int(spec.objects.size()), has_bodies(spec), false);
        chunk.material = f.material;
        chunk.edge_round = fitted::round_edges / refinement * mean_edge(f.mesh);
        // Its number among fingers is one that none of them has.
        set_lane(chunk, 0, int(spec.fingers.size() + world.soft.all.size()) - 1,
                 stiffened_for_inertia(parameters_of(f), spec.solver), o.pose);
        if (yielding(spec)) set_contact_areas(chunk, 0, f.mesh);
        soft.object = object;
        soft.skin = {o.name, false, int(world.chunks.doubles.size()) - 1, 0, f.mesh, o.pose};
        soft.hold = rigid_hold();
        soft.surface = contact_surface_of(f, o.pose);
        soft.nodes.resize(f.mesh.nodes.size());
        const auto& bone = f.mesh.bone_nodes;
        for (const auto& face : f.mesh.surface)
            if (std::any_of(face.begin(), face.end(),
                            [&](int node) { return !std::binary_search(bone.begin(), bone.end(), node); }))
                soft.faces.push_back(face);
        unknowns += int(chunk.topology->unknowns.size());
    }
    if (unknowns == 0) return;
    reserve_islands(world.body_solve, std::max(1, int(world.bodies.size())), world.chunks.count());
    for (std::size_t finger = 0; finger < spec.fingers.size(); ++finger) {
        const Skin& skin = world.skins[finger];
        const std::size_t samples = world.chunks.with(skin.single_precision, skin.chunk,
                                                      [](const auto& c) { return c.topology->sample_count(); });
        for (std::size_t k = 0; k < world.soft.all.size(); ++k) {
            SoftPair& pair = world.soft.pairs.emplace_back();
            pair.finger = int(finger), pair.soft = int(k);
            pair.samples.resize(samples);
        }
    }
}

ContactSurface contact_surface_of(const FingerSpec& finger, const Pose<double>& bone) {
    const TetMesh& mesh = finger.mesh;
    const std::vector<double> area = nodal_areas(mesh);
    ContactSurface c;
    c.bone = bone;
    const double young = finger.skin_modulus > 0 ? finger.skin_modulus : finger.young_modulus;
    c.modulus = young / (1 - finger.poisson_ratio * finger.poisson_ratio);
    for (int node : mesh.pad_nodes) {
        c.area.push_back(area[node]);
        c.position.push_back({mesh.nodes[node][0], mesh.nodes[node][1], mesh.nodes[node][2]});
    }
    c.force.assign(c.area.size(), {0, 0, 0});
    c.touches.assign(c.area.size(), 0);
    c.bears.assign(c.area.size(), 0);
    c.gap.assign(c.area.size(), 0.0);
    c.pressing.assign(c.area.size(), {0, 0, 0});
    if (mesh.curved_skin) c.bulge.assign(c.area.size(), {0, 0, 0});
    for (const auto& face : mesh.surface) {
        std::array<int, 3> samples;
        int in_pad = 0;
        for (std::size_t k = 0; k < 3; ++k) {
            const auto at = std::lower_bound(mesh.pad_nodes.begin(), mesh.pad_nodes.end(), face[k]);
            in_pad += at != mesh.pad_nodes.end() && *at == face[k];
            samples[k] = int(at - mesh.pad_nodes.begin());
        }
        if (in_pad < 3) {
            (in_pad > 0 ? c.rim_faces : c.back_faces).push_back(face);
            continue;
        }
        c.faces.push_back(samples);
        for (std::size_t k = 0; k < 3; ++k) {
            const Vec3<double> edge =
                c.position[std::size_t(samples[k])] - c.position[std::size_t(samples[(k + 1) % 3])];
            c.longest_edge = std::max(c.longest_edge, norm(edge));
        }
    }
    c.objects.reserve(8);
    return c;
}

}  // namespace

int tissue_refinement(const SceneSpec& spec) {
    const int wanted = spec.solver.sample_refinement;
    return has_bodies(spec) ? std::max(wanted, fitted::tissue_refinement) : wanted;
}

World build_world(const SceneSpec& spec) {
    if (const auto wrong = spec.validate(); !wrong.empty()) {
        std::string all;
        for (const auto& w : wrong) all += (all.empty() ? "" : "\n") + w;
        throw std::invalid_argument(all);
    }
    World world;
    world.solver = spec.solver;
    std::vector<Skin> skins(spec.fingers.size());
    for (const Archetype& a : sort_into_archetypes(spec)) {
        if (a.single_precision)
            fill_chunks(spec, a, world.chunks.floats, world.chunks, skins);
        else
            fill_chunks(spec, a, world.chunks.doubles, world.chunks, skins);
    }
    std::vector<EntityId> ids;
    for (std::size_t i = 0; i < spec.fingers.size(); ++i) {
        const EntityId finger = world.fingers.create(), tracker = world.trackers.create();
        ids.push_back(finger);
        world.tracker_poses.add(tracker);
        if (spec.fingers[i].filter) world.pose_filters.add(tracker, *spec.fingers[i].filter);
        world.couplings.add(finger, spec.fingers[i].coupling).tracker = tracker;
        world.skins.add(finger, std::move(skins[i]));
        ContactSurface& surface =
            world.contact_surfaces.add(finger, contact_surface_of(spec.fingers[i], spec.fingers[i].start));
        if (i > 0) share_rest(world.contact_surfaces[i - 1], surface);
    }
    for (const ObjectSpec& o : spec.objects) {
        const EntityId object = world.objects.create();
        VirtualObject& shape = world.shapes.add(object, {o.name, o.shape, o.pose, o.pose, o.friction});
        shape.mesh = o.mesh;
        shape.shape.mesh = o.mesh.get();
        shape.stiffness = o.stiffness;
        if (!o.body) continue;
        shape.body = int(world.bodies.size());
        world.bodies.add(object, *o.body);
    }
    world.gravity = spec.gravity;
    world.pair_frictions = spec.pair_frictions;
    prepare_finger_pairs(spec, world);
    add_soft_objects(spec, world);
    prepare_bodies(world);
    prepare_touching_fingers(world);
    for (VirtualObject& shape : world.shapes)
        if (shape.body >= 0 && world.bodies[shape.body].release > 0) {
            std::swap(shape.body, shape.held_body);
            world.bodies[shape.held_body].asleep = true;
        }
    for (const ThimbleSpec& t : spec.thimbles) {
        // Nothing can be touched: nothing to render.
        if (spec.objects.empty() && !(spec.fingers_touch && spec.fingers.size() > 1)) break;
        Matching m;
        m.finger = ids[t.finger];
        m.model = t.model;
        m.method = t.method;
        m.settings = t.settings;
        m.period = t.period;
        m.force_mode = t.force_mode;
        m.points.resize(spec.fingers[t.finger].mesh.pad_nodes.size());
        m.result.w = t.model.rest;
        m.result.q = t.model.kind->joints(t.model, t.model.rest).q;
        m.geometric = m.result;
        const EntityId thimble = world.thimbles.create();
        if (t.method == MatchingMethod::force)
            world.force_matchers.add(thimble, build_force_matcher(spec.fingers[t.finger], t.model, t.settings));
        world.matchings.add(thimble, std::move(m));
        world.device_links.add(thimble);
    }
    return world;
}

ForceMatcher build_force_matcher(const FingerSpec& f, const DeviceModel& model, const MatchingSettings& settings) {
    return build_force_matcher(parameters_of(f), f.material, model, settings);
}

namespace {
template <class Read>
auto with_chunk(const World& world, EntityId finger, Read read) {
    const Skin& skin = *world.skins.find(finger);
    return skin.single_precision ? read(world.chunks.floats[skin.chunk], skin.lane)
                                 : read(world.chunks.doubles[skin.chunk], skin.lane);
}
}  // namespace

std::vector<Point> finger_positions(const World& world, EntityId finger) {
    return with_chunk(world, finger, [](const auto& c, int lane) {
        std::vector<Point> nodes(c.topology->node_count);
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            const Vec3<double> x = node_position(c, int(i), lane);
            nodes[i] = {x.x, x.y, x.z};
        }
        return nodes;
    });
}

std::vector<Point> soft_positions(const World& world, const SoftObject& object) {
    const SkinChunk<double>& c = world.chunks.doubles[std::size_t(object.skin.chunk)];
    std::vector<Point> nodes(std::size_t(c.topology->node_count));
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        const Vec3<double> x = node_position(c, int(i), object.skin.lane);
        nodes[i] = {x.x, x.y, x.z};
    }
    return nodes;
}

std::vector<Vec3<double>> bone_reactions(const World& world, EntityId finger) {
    return with_chunk(world, finger, [](const auto& c, int lane) {
        std::vector<Vec3<double>> reactions(c.topology->node_count, {0, 0, 0});
        if (!((active_lanes(c) >> lane) & 1u)) return reactions;  // nothing pulls at it
        for (int node : c.topology->bone_nodes)
            for (int d = 0; d < 3; ++d) reactions[node][d] = c.scratch.gradient[(3 * node + d) * c.width + lane];
        return reactions;
    });
}

Pose<double> bone_pose(const World& world, EntityId finger) {
    return with_chunk(world, finger, [](const auto& c, int lane) { return lane_bone(c, lane); });
}

const SkinStatus& skin_status(const World& world, EntityId finger) {
    const Skin& skin = *world.skins.find(finger);
    return skin.single_precision ? world.chunks.floats[skin.chunk].status[skin.lane]
                                 : world.chunks.doubles[skin.chunk].status[skin.lane];
}

std::size_t skin_memory_bytes(const World& world) {
    std::size_t bytes = 0;
    for (const auto& c : world.chunks.doubles) bytes += memory_bytes(c);
    for (const auto& c : world.chunks.floats) bytes += memory_bytes(c);
    for (const WorkMemory& m : world.chunks.work) {
        for (const auto& c : m.doubles) bytes += memory_bytes(c);
        for (const auto& c : m.floats) bytes += memory_bytes(c);
    }
    return bytes;
}

}  // namespace palpate
