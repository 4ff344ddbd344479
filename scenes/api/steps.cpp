// Inputs, steps, states, recordings.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"
#include "scenes/recording/outputs.h"
#include "scenes/run/state.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

std::uint32_t PoseInput::lock() {
    std::uint32_t v = version.load(std::memory_order_relaxed);
    while (v % 2 == 1 || !version.compare_exchange_weak(v, v + 1, std::memory_order_acquire))
        v = version.load(std::memory_order_relaxed);
    return v;
}

bool PoseInput::set(std::int32_t whose, std::int64_t new_kind, const double* numbers) {
    const std::uint32_t v = lock();
    const bool still = id.load(std::memory_order_relaxed) == whose;
    if (still) kind.store(new_kind, std::memory_order_release);
    if (still && numbers)
        for (std::size_t i = 0; i < pose.size(); ++i) pose[i].store(numbers[i], std::memory_order_release);
    version.store(v + 2, std::memory_order_release);
    return still;
}

void PoseInput::give_to(std::int32_t whose, bool moves) {
    const std::uint32_t v = lock();
    id.store(whose, std::memory_order_release);
    moved_by_forces.store(moves, std::memory_order_relaxed);
    kind.store(released, std::memory_order_release);
    version.store(v + 2, std::memory_order_release);
    taken_kind = released;
}

void PoseInput::take() {
    for (int attempt = 0; attempt < 4; ++attempt) {
        const std::uint32_t v = version.load(std::memory_order_acquire);
        if (v % 2 == 1) continue;
        const std::int64_t now = kind.load(std::memory_order_acquire);
        double p[7];
        for (std::size_t i = 0; i < pose.size(); ++i) p[i] = pose[i].load(std::memory_order_acquire);
        if (version.load(std::memory_order_relaxed) != v) continue;
        taken_kind = now;
        taken = {{p[0], p[1], p[2]}, {p[3], p[4], p[5], p[6]}};
        return;
    }
}

namespace {

/// Scripts and recordings, where no pose was set from outside.
void gather_inputs(Session& s) {
    next_inputs(*s.simulation, s.inputs);
    for (std::size_t i = 0; i < s.fingers.ids.size(); ++i) {
        PoseInput& input = s.finger_input(i);
        input.take();
        if (input.taken_kind == PoseInput::released) continue;
        TrackerPose::Sample& sample = s.inputs.fingers[i];
        sample.valid = input.taken_kind == PoseInput::seen;
        if (sample.valid) sample.pose = input.taken;
        sample.time = s.world().time + s.world().solver.dt;
    }
    for (std::size_t i = 0; i < s.objects.ids.size(); ++i) {
        PoseInput& input = s.object_input(i);
        input.take();
        if (input.taken_kind == PoseInput::seen && s.world().shapes[i].body < 0) s.inputs.objects[i] = input.taken;
    }
}

std::int32_t step_replay(Session& s) {
    ReplaySource& r = *s.replay;
    if (r.done >= r.run.steps.size())
        return fail(PALPATE_ERROR_STATE,
                    "the recorded run has ended: it holds " + std::to_string(r.run.steps.size()) + " steps");
    const std::size_t first_change = r.change;
    for (; r.change < r.run.changes.size() && r.run.changes[r.change].step <= r.done; ++r.change)
        if (!change_settings(s, r.run.changes[r.change].overrides))
            return fail(PALPATE_ERROR_SCENE, r.file + ": the scene with the settings of step " +
                                                 std::to_string(r.done + 1) + " is built otherwise than it was");
    if (r.change != first_change) show_all(s);
    const RecordedStep& step = r.run.steps[r.done];
    if (step.inputs.fingers.size() != s.simulation->fingers.size() ||
        step.inputs.objects.size() != s.world().shapes.size())
        return fail(PALPATE_ERROR_SCENE, r.file + ": the scene builds other fingers or objects than the run had");
    advance(*s.simulation, step.inputs);
    log_step(s);
    if (s.frames_per_second > 0) keep_frame(s);
    ++r.done;
    if (r.different == 0 && outcome_of(*s.simulation).hashes != step.outcome.hashes) r.different = std::int64_t(r.done);
    return PALPATE_OK;
}

}  // namespace

std::int32_t step_once(Session& s) {
    if (s.replay) return step_replay(s);
    gather_inputs(s);
    advance(*s.simulation, s.inputs);
    log_step(s);
    if (s.frames_per_second > 0) keep_frame(s);
    if (!s.recorder) return PALPATE_OK;
    s.recorder->record(s.inputs, *s.simulation);
    if (s.recorder->failure().empty()) return PALPATE_OK;
    const std::string why = s.recorder->failure() + "; the recording ends there, the world goes on";
    s.recorder.reset();
    return fail(PALPATE_ERROR_FILE, why);
}

namespace {

/// Some steps of one world; what is shown follows even where one fails.
std::int32_t step_some(Session& s, std::int32_t n) {
    std::int32_t result = PALPATE_OK;
    for (std::int32_t k = 0; k < n && result == PALPATE_OK; ++k) result = guarded([&] { return step_once(s); });
    const std::int32_t shown = guarded([&] {
        show(s);
        return PALPATE_OK;
    });
    return result != PALPATE_OK ? result : shown;
}

bool possible(std::int32_t n) { return n >= 1 && n <= PALPATE_MOST_STEPS; }

std::int32_t fail_count(double n) {
    char text[120];
    plain_snprintf(text, sizeof text, "expected 1 to %d steps at once, found %.6g: step in parts", PALPATE_MOST_STEPS,
                   n);
    return fail(PALPATE_ERROR_ARGUMENT, text);
}

/// A pose that can be used, with its rotation made a unit; says what is wrong otherwise.
std::int32_t read_pose(const double* given, double* pose) {
    double square = 0;
    for (int i = 0; i < 7; ++i) {
        if (!std::isfinite(given[i]) || std::abs(given[i]) > 1e6)
            return fail(PALPATE_ERROR_ARGUMENT, "a pose is 7 finite numbers: position x y z [m], rotation w x y z");
        pose[i] = given[i];
        if (i >= 3) square += given[i] * given[i];
    }
    if (square < 1e-12) return fail(PALPATE_ERROR_ARGUMENT, "the rotation w x y z of a pose must not be zero");
    // A unit to rounding stays as it is, bit for bit.
    if (std::abs(square - 1) > 1e-14)
        for (int i = 3; i < 7; ++i) pose[i] /= std::sqrt(square);
    return PALPATE_OK;
}

/// Of fingers, then of objects.
std::vector<PoseInput*> inputs_of(const Session& s) {
    std::vector<PoseInput*> all;
    for (std::size_t i = 0; i < s.fingers.ids.size(); ++i) all.push_back(&s.finger_input(i));
    for (std::size_t i = 0; i < s.objects.ids.size(); ++i) all.push_back(&s.object_input(i));
    return all;
}

}  // namespace

}  // namespace palpate::api

int32_t palpate_set_finger_pose(PalpateWorld world, int32_t finger, const double* given) {
    Use session(world);
    if (!session) return fail_no_world(world);
    PoseInput* const input = session->finger_inputs.find(finger);
    if (!input) return fail_no_part("finger", finger);
    double pose[7];
    if (given)
        if (const int32_t result = read_pose(given, pose); result != PALPATE_OK) return result;
    return input->set(finger, given ? PoseInput::seen : PoseInput::unseen, given ? pose : nullptr)
               ? PALPATE_OK
               : fail_no_part("finger", finger);
}

int32_t palpate_release_finger(PalpateWorld world, int32_t finger) {
    Use session(world);
    if (!session) return fail_no_world(world);
    PoseInput* const input = session->finger_inputs.find(finger);
    return input && input->set(finger, PoseInput::released, nullptr) ? PALPATE_OK : fail_no_part("finger", finger);
}

int32_t palpate_set_object_pose(PalpateWorld world, int32_t object, const double* given) {
    Use session(world);
    if (!session) return fail_no_world(world);
    if (!given) return fail(PALPATE_ERROR_ARGUMENT, "pose is NULL; palpate_release_object gives an object back");
    PoseInput* const input = session->object_inputs.find(object);
    if (!input) return fail_no_part("object", object);
    if (input->moved_by_forces.load(std::memory_order_relaxed))
        return fail(PALPATE_ERROR_STATE, "forces move this object; give it no mass, and it goes where it is put");
    double pose[7];
    if (const int32_t result = read_pose(given, pose); result != PALPATE_OK) return result;
    return input->set(object, PoseInput::seen, pose) ? PALPATE_OK : fail_no_part("object", object);
}

int32_t palpate_release_object(PalpateWorld world, int32_t object) {
    Use session(world);
    if (!session) return fail_no_world(world);
    PoseInput* const input = session->object_inputs.find(object);
    return input && input->set(object, PoseInput::released, nullptr) ? PALPATE_OK : fail_no_part("object", object);
}

int32_t palpate_step(PalpateWorld world, int32_t n) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (!possible(n)) return fail_count(n);
    return step_some(*session, n);
}

int32_t palpate_step_to(PalpateWorld world, double time) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const World& w = session->world();
    const double n = std::round((time - w.time) / w.solver.dt);
    if (!std::isfinite(time) || n > PALPATE_MOST_STEPS)
        return fail(PALPATE_ERROR_ARGUMENT, "the time must be finite, and no more than a million steps ahead");
    return n < 1 ? int32_t(PALPATE_OK) : step_some(*session, int32_t(n));
}

int32_t palpate_step_many(const PalpateWorld* worlds, int32_t count, int32_t n) {
    if (count < 0 || count > 65536 || (count > 0 && !worlds))
        return fail(PALPATE_ERROR_ARGUMENT, "worlds: expected a list of 0 to 65536 ids");
    if (!possible(n)) return fail_count(n);
    return guarded([&] {
        static Threads threads(0);
        struct Outcome {
            int32_t result;
            char message[200];
        };
        thread_local std::vector<Outcome> outcomes;
        outcomes.resize(std::size_t(count));
        Outcome* all = outcomes.data();
        threads.for_each(count, [&](int i) {
            Owner session(worlds[i]);
            Outcome& o = all[i];
            o.result = session.result() != PALPATE_OK ? session.result() : step_some(*session, n);
            if (o.result != PALPATE_OK)
                plain_snprintf(o.message, sizeof o.message, "world %d of the list: %.160s", i, palpate_last_error());
        });
        for (int32_t i = 0; i < count; ++i)
            if (all[i].result != PALPATE_OK) return fail(all[i].result, all[i].message);
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_save(PalpateWorld world, void* buffer, int64_t capacity, int64_t* needed) {
    if (capacity < 0 || (capacity > 0 && !buffer))
        return fail(PALPATE_ERROR_ARGUMENT, "expected a buffer and its capacity, or capacity 0");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        std::vector<std::uint8_t>& state = session->state;
        state.clear();
        for (PoseInput* input : inputs_of(*session)) {
            input->take();
            const auto* kind = reinterpret_cast<const std::uint8_t*>(&input->taken_kind);
            const auto* pose = reinterpret_cast<const std::uint8_t*>(&input->taken);
            state.insert(state.end(), kind, kind + sizeof input->taken_kind);
            state.insert(state.end(), pose, pose + sizeof input->taken);
        }
        const std::uint64_t sum = checksum(state.data(), state.size());
        const auto* sum_bytes = reinterpret_cast<const std::uint8_t*>(&sum);
        state.insert(state.end(), sum_bytes, sum_bytes + sizeof sum);
        append_state(state, *session->simulation);
        const auto size = std::int64_t(state.size());
        if (needed) *needed = size;
        if (capacity == 0 && needed) return int32_t(PALPATE_OK);
        if (capacity < size)
            return fail(PALPATE_ERROR_SIZE,
                        "the state has " + std::to_string(size) + " bytes, the buffer " + std::to_string(capacity));
        std::memcpy(buffer, state.data(), state.size());
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_restore(PalpateWorld world, const void* bytes, int64_t size) {
    if (!bytes || size < 0) return fail(PALPATE_ERROR_ARGUMENT, "expected the bytes of a saved state and their number");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        if (session->replay) return fail(PALPATE_ERROR_STATE, "a replay goes through its recording from the beginning");
        if (session->recorder)
            return fail(PALPATE_ERROR_STATE,
                        "a recording goes on: palpate_end_recording first, a replay could not follow");
        constexpr std::size_t one = sizeof(std::int64_t) + sizeof(Pose<double>);
        const std::size_t inputs = one * (session->fingers.ids.size() + session->objects.ids.size());
        const auto* p = static_cast<const std::uint8_t*>(bytes);
        std::uint64_t sum = 0;
        const std::size_t before = inputs + sizeof sum;
        if (std::size_t(size) < before) return fail(PALPATE_ERROR_SCENE, "these bytes are no saved state");
        std::memcpy(&sum, p + inputs, sizeof sum);
        if (sum != checksum(p, inputs))
            return fail(
                PALPATE_ERROR_SCENE,
                "these bytes are no saved state, one with other fingers or objects than there are now, or damaged");
        std::string why;
        if (!restore_state(*session->simulation, p + before, std::size_t(size) - before, why))
            return fail(PALPATE_ERROR_SCENE, why);
        for (PoseInput* input : inputs_of(*session)) {
            std::int64_t kind = 0;
            double given[7], pose[7];
            std::memcpy(&kind, p, sizeof kind);
            std::memcpy(given, p + sizeof kind, sizeof given);
            if (kind < PoseInput::released || kind > PoseInput::unseen || read_pose(given, pose) != PALPATE_OK)
                kind = PoseInput::released;
            input->set(input->id, kind, kind == PoseInput::released ? nullptr : pose);
            p += one;
        }
        drop_frames(*session);
        show(*session);
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_record(PalpateWorld world, const char* file) {
    if (!file) return fail(PALPATE_ERROR_ARGUMENT, "file is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        if (session->world().step > 0)
            return fail(PALPATE_ERROR_STATE, "a recording begins with the first step: record before it");
        if (session->replay) return fail(PALPATE_ERROR_STATE, "a replay is not recorded again");
        if (session->recorder) return fail(PALPATE_ERROR_STATE, "it is being recorded: palpate_end_recording first");
        try {
            refuse_to_replace("palpate_record:", file, Output::recording);
            session->recorder = std::make_unique<RunWriter>(file, *session->simulation, session->settings);
        } catch (const std::runtime_error& error) { return fail(PALPATE_ERROR_FILE, error.what()); }
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_end_recording(PalpateWorld world) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        if (!session->recorder) return fail(PALPATE_ERROR_STATE, "nothing is being recorded");
        session->recorder->finish();
        const std::string why = session->recorder->failure();
        session->recorder.reset();
        return why.empty() ? int32_t(PALPATE_OK) : fail(PALPATE_ERROR_FILE, why);
    });
}

int32_t palpate_get_replay(PalpateWorld world, PalpateReplayState* state) {
    if (!state) return fail(PALPATE_ERROR_ARGUMENT, "state is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (!session->replay) return fail(PALPATE_ERROR_STATE, "this world is no replay: palpate_load_replay makes one");
    const ReplaySource& r = *session->replay;
    PalpateReplayState own{};
    own.same = r.different == 0;
    own.steps = std::int64_t(r.run.steps.size());
    own.done = std::int64_t(r.done);
    own.different = r.different;
    return write_struct(own, state) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}
