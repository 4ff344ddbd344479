// What is felt, shown: fields in memory of the world, states as structs, snapshots for other threads.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "meshes/input_error.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"
#include "scenes/run/finger_output.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

namespace {

enum class Of { finger, thimble, world };
struct FieldKind {
    Of of;
    std::int32_t type;
    bool changes;  ///< from step to step
};
constexpr FieldKind field_kinds[PALPATE_FIELD_COUNT] = {
    {Of::finger, PALPATE_FLOAT64, true},   // positions
    {Of::finger, PALPATE_FLOAT64, true},   // forces
    {Of::finger, PALPATE_UINT8, true},     // touches
    {Of::finger, PALPATE_FLOAT64, true},   // pressures
    {Of::finger, PALPATE_FLOAT64, false},  // areas
    {Of::finger, PALPATE_INT32, false},    // faces
    {Of::finger, PALPATE_INT32, false},    // sample nodes
    {Of::finger, PALPATE_FLOAT64, true},   // nodes
    {Of::finger, PALPATE_FLOAT64, false},  // rest nodes
    {Of::finger, PALPATE_INT32, false},    // tetrahedra
    {Of::finger, PALPATE_FLOAT64, true},   // stretches
    {Of::thimble, PALPATE_FLOAT64, true},  // configuration
    {Of::thimble, PALPATE_FLOAT64, true},  // joints wanted
    {Of::thimble, PALPATE_FLOAT64, true},  // sent
    {Of::thimble, PALPATE_FLOAT64, true},  // reached
    {Of::world, PALPATE_FLOAT64, true},    // bone poses
    {Of::world, PALPATE_FLOAT64, true},    // tracked poses
    {Of::world, PALPATE_FLOAT64, true},    // net forces
    {Of::world, PALPATE_FLOAT64, true},    // net torques
    {Of::world, PALPATE_FLOAT64, true},    // centres
    {Of::world, PALPATE_FLOAT64, true},    // contact areas
    {Of::world, PALPATE_FLOAT64, true},    // object poses
    {Of::world, PALPATE_FLOAT64, true},    // object motions
};

void put(double* out, const Vec3<double>& v) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }
void put(double* out, const Pose<double>& p) {
    put(out, p.position);
    out[3] = p.rotation.w, out[4] = p.rotation.x, out[5] = p.rotation.y, out[6] = p.rotation.z;
}

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
            Eigen::Matrix3d now, rest;
            const Vec3<double> origin = node_position(chunk, tet[0], skin.lane);
            for (int a = 1; a < 4; ++a) {
                const Vec3<double> edge = node_position(chunk, tet[std::size_t(a)], skin.lane) - origin;
                now.col(a - 1) << edge.x, edge.y, edge.z;
                for (std::size_t d = 0; d < 3; ++d)
                    rest(Eigen::Index(d), a - 1) =
                        mesh.nodes[std::size_t(tet[std::size_t(a)])][d] - mesh.nodes[std::size_t(tet[0])][d];
            }
            const Eigen::Matrix3d F = now * rest.inverse();
            const Eigen::Vector3d sigma = Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues();
            *out++ = sigma[2];
            *out++ = sigma[0];
        }
    });
}

void fill_finger(const World& w, std::size_t i, int field, FieldMemory& m) {
    const ContactSurface& c = w.contact_surfaces[i];
    const Skin& skin = w.skins[i];
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
            for (std::size_t s = 0; s < S; ++s) out[s] = c.area[s] > 0 ? norm(c.force[s]) / c.area[s] : 0;
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

void fill_thimble(const Simulation& s, std::size_t i, int field, FieldMemory& m) {
    const Matching& t = s.world.matchings[i];
    const ThimbleLoop& loop = *s.loops[i];
    const Coordinates q = field == PALPATE_CONFIGURATION   ? t.result.w
                          : field == PALPATE_JOINTS_WANTED ? t.result.q
                          : field == PALPATE_JOINTS_SENT   ? loop.q
                                                           : loop.driver->actual(s.world.time);
    std::copy(q.begin(), q.end(), rows(m, std::size_t(q.size()), 1));
}

/// The newest that was seen; at first the one that it began with.
Pose<double> tracked_pose(const World& w, std::size_t i) {
    const TrackerPose& tracker = w.tracker_poses[i];
    return tracker.accepted > 0 ? tracker.newest.pose : w.skins[i].start;
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
        default:
            return;
    }
}

void fill(Session& s, int field, int row, FieldMemory& m) {
    switch (field_kinds[field].of) {
        case Of::finger:
            return fill_finger(s.world(), std::size_t(row), field, m);
        case Of::thimble:
            return fill_thimble(*s.simulation, std::size_t(row), field, m);
        case Of::world:
            return fill_world(s.world(), field, m);
    }
}

/// Row of an id of a field; -1 where there is none, or the field is the world's.
int row_of(const Session& s, int field, std::int32_t id) {
    const Of of = field_kinds[field].of;
    return of == Of::finger ? s.fingers.row(id) : of == Of::thimble ? s.thimbles.row(id) : -1;
}

/// Memory of what was removed, large enough to stay where it is: whoever adds and removes for hours fills no memory.
std::unique_ptr<FieldMemory> reused(Session& s, const FieldMemory& like) {
    for (auto it = s.old_fields.begin(); it != s.old_fields.end(); ++it) {
        const FieldMemory& m = **it;
        if (m.doubles.capacity() < like.doubles.size() || m.integers.capacity() < like.integers.size() ||
            m.bytes.capacity() < like.bytes.size())
            continue;
        std::unique_ptr<FieldMemory> found = std::move(*it);
        s.old_fields.erase(it);
        return found;
    }
    return nullptr;
}

PalpateFingerState state_of(const Session& s, std::size_t i) {
    const World& w = s.world();
    const FingerOutput o = finger_output(w.contact_surfaces[i]);
    const SkinStatus& status = skin_status(w, s.simulation->fingers[i]);
    PalpateFingerState f{};
    f.size = sizeof f;
    f.touching = o.touching;
    f.time = w.time;
    put(f.tracked_pose, tracked_pose(w, i));
    put(f.bone_pose, o.bone);
    put(f.force, o.force);
    put(f.torque, o.torque);
    put(f.centre, o.centre);
    f.normal_force = o.normal_force;
    f.contact_area = o.area;
    f.coupling_force = w.couplings[i].force_N;
    f.silent = w.tracker_poses[i].silent;
    f.residual = status.residual_N;
    f.converged = status.converged;
    f.iterations = status.newton_iterations;
    f.resets = s.simulation->finger_counts[i].resets;
    return f;
}

constexpr std::size_t state_words = (sizeof(PalpateFingerState) + 7) / 8;
static_assert(sizeof(PalpateFingerState) % 8 == 0);

/// Memory of the ring.
void prepare_snapshots(Session& s) {
    if (s.snapshots.load(std::memory_order_relaxed)) return;
    auto shots = std::make_unique<Snapshots>();
    shots->ids = s.fingers.ids;
    std::size_t words = 0;
    for (const ContactSurface& c : s.world().contact_surfaces) {
        shots->first.push_back(words);
        shots->samples.push_back(std::int32_t(c.position.size()));
        words += state_words + 6 * c.position.size();
    }
    for (auto& entry : shots->entries) entry.words = std::vector<std::atomic<std::uint64_t>>(words);
    s.all_snapshots.push_back(std::move(shots));
}

void take_snapshot(Session& s) {
    Snapshots& shots = *s.all_snapshots.back();
    const std::uint32_t next = (shots.newest.load(std::memory_order_relaxed) + 1) % Snapshots::ring;
    Snapshots::Entry& entry = shots.entries[next];
    const std::uint32_t version = entry.version.load(std::memory_order_relaxed);
    entry.version.store(version + 1, std::memory_order_relaxed);
    auto out = entry.words.begin();
    const auto put_word = [&](const void* from) {
        std::uint64_t word;
        std::memcpy(&word, from, sizeof word);
        (out++)->store(word, std::memory_order_release);
    };
    const auto put_vector = [&](const Vec3<double>& v) { put_word(&v.x), put_word(&v.y), put_word(&v.z); };
    for (std::size_t i = 0; i < shots.first.size(); ++i) {
        const PalpateFingerState state = state_of(s, i);
        for (std::size_t k = 0; k < state_words; ++k) put_word(reinterpret_cast<const char*>(&state) + 8 * k);
        const ContactSurface& c = s.world().contact_surfaces[i];
        const Mat3<double> R = rotation_matrix(c.bone.rotation);
        for (const Vec3<double>& x : c.position) put_vector(c.bone.position + R * x);
        for (const Vec3<double>& f : c.force) put_vector(f);
    }
    entry.version.store(version + 2, std::memory_order_release);
    shots.newest.store(next, std::memory_order_release);
    s.snapshots.store(&shots, std::memory_order_release);
}

/// Whether the words of a finger could be read whole.
bool read_entry(const Snapshots::Entry& entry, std::size_t first, std::int32_t samples, PalpateFingerState& state,
                double* positions, double* forces) {
    const std::uint32_t version = entry.version.load(std::memory_order_acquire);
    if (version % 2 == 1) return false;
    const auto get = [&](std::size_t k, void* to) {
        const std::uint64_t word = entry.words[first + k].load(std::memory_order_acquire);
        std::memcpy(to, &word, sizeof word);
    };
    for (std::size_t k = 0; k < state_words; ++k) get(k, reinterpret_cast<char*>(&state) + 8 * k);
    const auto S3 = 3 * std::size_t(samples);
    for (std::size_t k = 0; positions && k < S3; ++k) get(state_words + k, positions + k);
    for (std::size_t k = 0; forces && k < S3; ++k) get(state_words + S3 + k, forces + k);
    return entry.version.load(std::memory_order_relaxed) == version;
}

}  // namespace

void show(Session& s) {
    ++s.generation;
    for (const LiveField& live : s.live_fields) fill(s, live.field, live.index, *live.memory);
    if (s.keeps_snapshots) take_snapshot(s);
}

void show_all(Session& s) {
    for (auto& [which, memory] : s.fields)
        fill(s, which.first, which.second < 0 ? -1 : row_of(s, which.first, which.second), *memory);
    show(s);
}

void renew_views(Session& s) {
    s.unconverged.clear();
    drop_frames(s);
    s.live_fields.clear();
    for (auto it = s.fields.begin(); it != s.fields.end();) {
        const auto [field, id] = it->first;
        const int row = id < 0 ? -1 : row_of(s, field, id);
        // Those of the world have other sizes now, and are asked for anew; whoever holds the old ones still may.
        if (row < 0) {
            s.old_fields.push_back(std::move(it->second));
            it = s.fields.erase(it);
            continue;
        }
        if (field_kinds[field].changes) s.live_fields.push_back({field, row, it->second.get()});
        ++it;
    }
    if (!s.all_snapshots.empty()) {
        s.snapshots.store(nullptr);
        prepare_snapshots(s);
    }
    show_all(s);
}

}  // namespace palpate::api

int32_t palpate_view(PalpateWorld world, int32_t field, int32_t index, PalpateView* view) {
    if (!view) return fail(PALPATE_ERROR_ARGUMENT, "view is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (field < 0 || field >= PALPATE_FIELD_COUNT)
        return fail(PALPATE_ERROR_ARGUMENT, "there is no such field: palpate.h lists them, PALPATE_POSITIONS and on");
    const FieldKind& kind = field_kinds[field];
    const int row = row_of(*session, field, index);
    if (kind.of == Of::world && index != -1) return fail(PALPATE_ERROR_ARGUMENT, "a field of the world has index -1");
    if (kind.of != Of::world && row < 0) return fail_no_part(kind.of == Of::finger ? "finger" : "thimble", index);
    return guarded([&] {
        auto at = session->fields.find({field, index});
        if (at == session->fields.end()) {
            auto fresh = std::make_unique<FieldMemory>();
            fill(*session, field, row, *fresh);
            if (auto old = reused(*session, *fresh)) {
                fresh = std::move(old);
                fill(*session, field, row, *fresh);
            }
            session->live_fields.reserve(session->live_fields.size() + 1);
            at = session->fields.emplace(std::pair{field, index}, std::move(fresh)).first;
            if (kind.changes) session->live_fields.push_back({field, row, at->second.get()});
        }
        const FieldMemory& m = *at->second;
        PalpateView own{};
        own.type = kind.type;
        own.rank = m.rank;
        own.shape[0] = m.shape[0], own.shape[1] = m.shape[1];
        own.generation = session->generation;
        own.data = kind.type == PALPATE_FLOAT64 ? static_cast<const void*>(m.doubles.data())
                   : kind.type == PALPATE_INT32 ? static_cast<const void*>(m.integers.data())
                                                : m.bytes.data();
        return write_struct(own, view) ? int32_t(PALPATE_OK) : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
    });
}

int32_t palpate_get_finger(PalpateWorld world, int32_t finger, PalpateFingerState* state) {
    if (!state) return fail(PALPATE_ERROR_ARGUMENT, "state is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const int row = session->fingers.row(finger);
    if (row < 0) return fail_no_part("finger", finger);
    return write_struct(state_of(*session, std::size_t(row)), state) ? PALPATE_OK
                                                                     : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_get_object(PalpateWorld world, int32_t object, PalpateObjectState* state) {
    if (!state) return fail(PALPATE_ERROR_ARGUMENT, "state is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const World& w = session->world();
    const int row = session->objects.row(object);
    if (row < 0) return fail_no_part("object", object);
    const RigidShape& shape = w.shapes[std::size_t(row)];
    PalpateObjectState own{};
    own.moves = shape.body >= 0;
    put(own.pose, shape.pose);
    if (shape.body >= 0) {
        const RigidBody& b = w.bodies[std::size_t(shape.body)];
        put(own.velocity, b.velocity);
        put(own.spin, angular_velocity(b, shape.pose.rotation));
        put(own.force, b.contact_force);
        put(own.torque, b.contact_torque);
    }
    return write_struct(own, state) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_get_thimble(PalpateWorld world, int32_t thimble, PalpateThimbleState* state) {
    if (!state) return fail(PALPATE_ERROR_ARGUMENT, "state is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const Simulation& s = *session->simulation;
    const int row = session->thimbles.row(thimble);
    if (row < 0) return fail_no_part("thimble", thimble);
    const Matching& m = s.world.matchings[std::size_t(row)];
    const ThimbleLoop& loop = *s.loops[std::size_t(row)];
    PalpateThimbleState own{};
    for (std::size_t i = 0; i < s.fingers.size(); ++i)
        if (s.fingers[i] == m.finger) own.finger = session->fingers.ids[i];
    own.configuration_count = int32_t(m.result.w.size());
    own.joint_count = int32_t(loop.q.size());
    const auto copy = [](const Coordinates& from, double* to) { std::copy(from.begin(), from.end(), to); };
    copy(m.result.w, own.configuration);
    copy(m.result.q, own.wanted);
    copy(loop.q, own.sent);
    copy(loop.driver->actual(s.world.time), own.reached);
    own.error = m.result.rms_m;
    own.matches = m.result.status != MatchingStatus::no_contact;
    own.at_limit = m.result.constraint_active;
    return write_struct(own, state) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_keep_snapshots(PalpateWorld world, int32_t on) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        session->keeps_snapshots = on != 0;
        if (!on) return PALPATE_OK;
        prepare_snapshots(*session);
        take_snapshot(*session);
        return PALPATE_OK;
    });
}

int32_t palpate_read_snapshot(PalpateWorld world, int32_t finger, PalpateFingerState* state, double* positions,
                              double* forces, int32_t capacity, int32_t* samples) {
    if (!state) return fail(PALPATE_ERROR_ARGUMENT, "state is NULL");
    Use session(world);
    if (!session) return fail_no_world(world);
    const Snapshots* const newest = session->snapshots.load(std::memory_order_acquire);
    if (!newest)
        return fail(PALPATE_ERROR_STATE, "there is no snapshot yet: its owner calls palpate_keep_snapshots first");
    const Snapshots& shots = *newest;
    const auto found = std::find(shots.ids.begin(), shots.ids.end(), finger);
    if (found == shots.ids.end()) return fail_no_part("finger", finger);
    const auto row = std::size_t(found - shots.ids.begin());
    const std::int32_t S = shots.samples[row];
    if (samples) *samples = S;
    if ((positions || forces) && capacity < S)
        return fail(PALPATE_ERROR_SIZE, "the finger has more samples than the buffers have room for");
    // A reader that is overtaken takes the next newest. Whoever is overtaken a thousand times has stopped in between.
    for (int attempt = 0; attempt < 1000; ++attempt) {
        PalpateFingerState own{};
        if (!read_entry(shots.entries[shots.newest.load(std::memory_order_acquire)], shots.first[row], S, own,
                        positions, forces))
            continue;
        return write_struct(own, state) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
    }
    return fail(PALPATE_ERROR_BUSY, "snapshots came faster than this one could be read: try again");
}
