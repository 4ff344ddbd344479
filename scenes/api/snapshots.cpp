// Fingers, objects and thimbles as structs; snapshots for other threads.

#include <algorithm>
#include <cstring>

#include "scenes/api/fields.h"
#include "scenes/api/guard.h"
#include "scenes/run/finger_output.h"
#include "scenes/run/object_output.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

namespace {

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

}  // namespace

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

namespace {

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

}  // namespace palpate::api

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
    const VirtualObject& shape = w.shapes[std::size_t(row)];
    PalpateObjectState own{};
    const ObjectOutput output = object_output(w, std::size_t(row));
    own.moves = shape.body >= 0;
    put(own.pose, shape.pose);
    if (shape.body >= 0) {
        const RigidBody& b = w.bodies[std::size_t(shape.body)];
        put(own.velocity, b.velocity);
        put(own.spin, angular_velocity(b, shape.pose.rotation));
    }
    put(own.force, output.force);
    put(own.torque, output.torque);
    own.contact_area = output.area;
    own.soft = shape.soft >= 0;
    own.touching = output.touching;
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
