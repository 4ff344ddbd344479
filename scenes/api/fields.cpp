// Numbers of fields, as they are now.

#include "scenes/api/fields.h"

#include <algorithm>

#include "scenes/run/finger_output.h"
#include "scenes/run/object_output.h"
#include "scenes/run/stretches.h"

namespace palpate::api {

namespace {

/// Of a finger or of a soft object, in the order of PALPATE_POSITIONS to PALPATE_STRETCHES.
constexpr FieldKind of_tissue(Of of, int field) {
    constexpr std::int32_t types[] = {PALPATE_FLOAT64, PALPATE_FLOAT64, PALPATE_UINT8,  PALPATE_FLOAT64,
                                      PALPATE_FLOAT64, PALPATE_INT32,   PALPATE_INT32,  PALPATE_FLOAT64,
                                      PALPATE_FLOAT64, PALPATE_INT32,   PALPATE_FLOAT64};
    const bool stays = (field >= PALPATE_AREAS && field <= PALPATE_SAMPLE_NODES) || field == PALPATE_REST_NODES ||
                       field == PALPATE_TETRAHEDRA;
    return {of, types[field], !stays, false};
}
constexpr FieldKind find_kind(int field) {
    if (field <= PALPATE_STRETCHES) return of_tissue(Of::finger, field);
    if (field >= PALPATE_SOFT_POSITIONS) return of_tissue(Of::object, field - PALPATE_SOFT_POSITIONS);
    if (field <= PALPATE_JOINTS_REACHED) return {Of::thimble, PALPATE_FLOAT64, true, false};
    return {field == PALPATE_FORCES_BY_OBJECT ? Of::finger : Of::world, PALPATE_FLOAT64, true,
            field == PALPATE_FORCES_BY_OBJECT};
}
constexpr auto field_kinds = [] {
    std::array<FieldKind, PALPATE_FIELD_COUNT> all{};
    for (int field = 0; field < PALPATE_FIELD_COUNT; ++field) all[std::size_t(field)] = find_kind(field);
    return all;
}();

/// Rows of numbers, in memory that is there after the first time.
double* rows(FieldMemory& m, std::size_t count, int each) {
    m.rank = each == 1 ? 1 : 2;
    m.shape[0] = std::int32_t(count), m.shape[1] = each == 1 ? 0 : each;
    m.doubles.resize(count * std::size_t(each));
    return m.doubles.data();
}
std::int32_t* integer_rows(FieldMemory& m, std::size_t count, int each) {
    rows(m, 0, each);
    m.shape[0] = std::int32_t(count);
    m.integers.resize(count * std::size_t(each));
    return m.integers.data();
}

void fill_nodes(const World& w, const Skin& skin, double* out) {
    w.chunks.with(skin.single_precision, skin.chunk, [&](const auto& chunk) {
        for (int i = 0; i < chunk.topology->node_count; ++i) put(out + 3 * i, node_position(chunk, i, skin.lane));
    });
}

void fill_stretches(const World& w, const Skin& skin, double* out) {
    const TetMesh& mesh = skin.mesh;
    w.chunks.with(skin.single_precision, skin.chunk, [&](const auto& chunk) {
        for (const auto& tet : mesh.tets) {
            std::array<Point, 4> now;
            for (std::size_t a = 0; a < 4; ++a) {
                const Vec3<double> x = node_position(chunk, tet[a], skin.lane);
                now[a] = {x.x, x.y, x.z};
            }
            const Vec3<double> sigma = principal_stretches(corners(mesh.nodes, tet), now);
            *out++ = sigma.z;
            *out++ = sigma.x;
        }
    });
}

/// A finger's, or a soft object's.
void fill_tissue(const World& w, const ContactSurface& c, const Skin& skin, int field, FieldMemory& m) {
    const std::size_t S = c.position.size();
    switch (field) {
        case PALPATE_POSITIONS: {
            const Mat3<double> R = rotation_matrix(c.bone.rotation);
            double* out = rows(m, S, 3);
            for (std::size_t s = 0; s < S; ++s) put(out + 3 * s, c.bone.position + R * c.position[s]);
            break;
        }
        case PALPATE_FORCES: {
            double* out = rows(m, S, 3);
            for (std::size_t s = 0; s < S; ++s) put(out + 3 * s, c.force[s]);
            break;
        }
        case PALPATE_TOUCHES:
            rows(m, 0, 1);
            m.shape[0] = std::int32_t(S);
            m.bytes.resize(S);
            std::copy(c.touches.begin(), c.touches.end(), m.bytes.begin());
            break;
        case PALPATE_PRESSURES: {
            double* out = rows(m, S, 1);
            for (std::size_t s = 0; s < S; ++s) out[s] = pressure_on(c, s);
            break;
        }
        case PALPATE_AREAS:
            std::copy(c.area.begin(), c.area.end(), rows(m, S, 1));
            break;
        case PALPATE_FACES: {
            std::int32_t* out = integer_rows(m, c.faces.size(), 3);
            for (const auto& face : c.faces) out = std::copy(face.begin(), face.end(), out);
            break;
        }
        case PALPATE_SAMPLE_NODES:
            std::copy(skin.mesh.pad_nodes.begin(), skin.mesh.pad_nodes.end(),
                      integer_rows(m, skin.mesh.pad_nodes.size(), 1));
            break;
        case PALPATE_NODES:
            fill_nodes(w, skin, rows(m, skin.mesh.nodes.size(), 3));
            break;
        case PALPATE_REST_NODES: {
            double* out = rows(m, skin.mesh.nodes.size(), 3);
            for (const Point& p : skin.mesh.nodes) out = std::copy(p.begin(), p.end(), out);
            break;
        }
        case PALPATE_TETRAHEDRA: {
            std::int32_t* out = integer_rows(m, skin.mesh.tets.size(), 4);
            for (const auto& tet : skin.mesh.tets) out = std::copy(tet.begin(), tet.end(), out);
            break;
        }
        case PALPATE_STRETCHES:
            fill_stretches(w, skin, rows(m, skin.mesh.tets.size(), 2));
            break;
        default:
            break;
    }
}

/// What each object presses a finger with.
void fill_by_object(const World& w, std::size_t finger, FieldMemory& m) {
    double* out = rows(m, w.shapes.size(), 3);
    std::fill(out, out + 3 * w.shapes.size(), 0.0);
    for (const ObjectContact& o : w.contact_surfaces[finger].objects)
        if (o.object >= 0) put(out + 3 * o.object, o.force);
}

void fill_thimble(const Simulation& s, std::size_t i, int field, FieldMemory& m) {
    const Matching& t = s.world.matchings[i];
    const ThimbleLoop& loop = *s.loops[i];
    const Coordinates q = field == PALPATE_CONFIGURATION   ? t.result.w
                          : field == PALPATE_JOINTS_WANTED ? t.result.q
                          : field == PALPATE_JOINTS_SENT   ? loop.q
                                                           : loop.driver->actual(s.world.time);
    std::copy(q.begin(), q.end(), rows(m, std::size_t(q.size()), 1));
}

void fill_world(const World& w, int field, FieldMemory& m) {
    const std::size_t fingers = w.skins.size(), objects = w.shapes.size();
    const auto each_finger = [&](int width, auto write) {
        double* out = rows(m, fingers, width);
        for (std::size_t i = 0; i < fingers; ++i) write(out + width * int(i), i);
    };
    const auto output = [&](std::size_t i) { return finger_output(w.contact_surfaces[i]); };
    switch (field) {
        case PALPATE_BONE_POSES:
            return each_finger(7, [&](double* out, std::size_t i) { put(out, w.contact_surfaces[i].bone); });
        case PALPATE_TRACKED_POSES:
            return each_finger(7, [&](double* out, std::size_t i) { put(out, tracked_pose(w, i)); });
        case PALPATE_NET_FORCES:
            return each_finger(3, [&](double* out, std::size_t i) { put(out, w.contact_surfaces[i].total); });
        case PALPATE_NET_TORQUES:
            return each_finger(3, [&](double* out, std::size_t i) { put(out, output(i).torque); });
        case PALPATE_CENTRES:
            return each_finger(3, [&](double* out, std::size_t i) { put(out, output(i).centre); });
        case PALPATE_CONTACT_AREAS:
            return each_finger(1, [&](double* out, std::size_t i) { *out = w.contact_surfaces[i].touching_area; });
        case PALPATE_OBJECT_POSES: {
            double* out = rows(m, objects, 7);
            for (std::size_t i = 0; i < objects; ++i) put(out + 7 * i, w.shapes[i].pose);
            return;
        }
        case PALPATE_OBJECT_MOTIONS: {
            double* out = rows(m, objects, 6);
            for (std::size_t i = 0; i < objects; ++i) {
                std::fill(out + 6 * i, out + 6 * i + 6, 0.0);
                if (w.shapes[i].body < 0) continue;
                const RigidBody& b = w.bodies[std::size_t(w.shapes[i].body)];
                put(out + 6 * i, b.velocity);
                put(out + 6 * i + 3, angular_velocity(b, w.shapes[i].pose.rotation));
            }
            return;
        }
        case PALPATE_OBJECT_FORCES: {
            double* out = rows(m, objects, 3);
            for (std::size_t i = 0; i < objects; ++i) put(out + 3 * i, object_output(w, i).force);
            return;
        }
        default:
            return;
    }
}

}  // namespace

const FieldKind& kind_of(int field) { return field_kinds[std::size_t(field)]; }

/// The newest that was seen; at first the one that it began with.
Pose<double> tracked_pose(const World& w, std::size_t i) {
    const TrackerPose& tracker = w.tracker_poses[i];
    return tracker.accepted > 0 ? tracker.newest.pose : w.skins[i].start;
}

void fill(Session& s, int field, int row, FieldMemory& m) {
    const World& w = s.world();
    const auto i = std::size_t(row);
    switch (kind_of(field).of) {
        case Of::finger:
            if (field == PALPATE_FORCES_BY_OBJECT) return fill_by_object(w, i, m);
            return fill_tissue(w, w.contact_surfaces[i], w.skins[i], field, m);
        case Of::object: {
            const SoftObject& o = w.soft.all[std::size_t(w.shapes[i].soft)];
            return fill_tissue(w, o.surface, o.skin, field - PALPATE_SOFT_POSITIONS, m);
        }
        case Of::thimble:
            return fill_thimble(*s.simulation, i, field, m);
        case Of::world:
            return fill_world(w, field, m);
    }
}

int row_of(const Session& s, int field, std::int32_t id) {
    switch (kind_of(field).of) {
        case Of::finger:
            return s.fingers.row(id);
        case Of::object:
            return s.objects.row(id);
        case Of::thimble:
            return s.thimbles.row(id);
        case Of::world:
            break;
    }
    return -1;
}

}  // namespace palpate::api
