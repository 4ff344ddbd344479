// Worlds: made, copied, changed, named, freed.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"
#include "scenes/load/find_scene.h"
#include "scenes/load/key.h"
#include "scenes/run/carry_over.h"
#include "scenes/run/state.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

namespace {

/// Settings of a list of texts. Throws InputError.
std::vector<std::string> settings_of(const char* const* settings, std::int32_t count) {
    if (count < 0 || count > 10000 || (count > 0 && !settings))
        throw InputError("settings: expected a list of 0 to 10000 texts, found " + std::to_string(count));
    std::vector<std::string> list;
    for (std::int32_t i = 0; i < count; ++i) {
        if (!settings[i]) throw InputError("setting " + std::to_string(i) + " is NULL; expected \"key=value\"");
        list.emplace_back(settings[i]);
    }
    return list;
}

/// A world's definition as read; throws InputError where it cannot be.
PalpateWorldDef read_def(const PalpateWorldDef* given) {
    PalpateWorldDef def{};
    palpate_default_world_def(&def, sizeof def);
    if (!read_struct(given, def)) throw InputError(wrong_size);
    if (def.threads < 0 || def.threads > 1024)
        throw InputError("threads: expected 0 (as many as the machine has) to 1024, found " +
                         std::to_string(def.threads));
    return def;
}

PalpateWorld adopt_scene(Scene scene, const PalpateWorldDef& def, std::vector<std::string> settings,
                         FingerTemplates templates, std::unique_ptr<ReplaySource> replay = nullptr) {
    log_scene(scene);
    auto session = std::make_unique<Session>(make_simulation(std::move(scene), def.threads, false));
    session->settings = std::move(settings);
    session->templates = std::move(templates);
    session->threads = def.threads;
    session->replay = std::move(replay);
    return adopt(std::move(session));
}

std::filesystem::path text_place(const PalpateWorldDef& def) {
    return (def.folder ? std::filesystem::path(def.folder) : std::filesystem::path(".")) / "scene";
}

std::int32_t make_from_text(const std::string& text, const PalpateWorldDef* given, PalpateWorld* world) {
    const PalpateWorldDef def = read_def(given);
    std::vector<std::string> settings = settings_of(def.settings, def.setting_count);
    FingerTemplates templates;
    Scene scene = load_scene_text(text, text_place(def), settings, &templates);
    *world = adopt_scene(std::move(scene), def, std::move(settings), std::move(templates));
    return PALPATE_OK;
}

Scene scene_again(Session& session, const std::vector<std::string>& settings) {
    const Scene& scene = session.simulation->scene;
    if (session.changed)
        return load_scene_now(*scene.text, scene.file, settings, &session.templates, poses_now(session.world()));
    return scene.text ? load_scene_text(*scene.text, scene.file, settings, &session.templates)
                      : load_scene(scene.file, settings, &session.templates);
}

}  // namespace

Session::Session(Simulation s) : simulation(std::make_unique<Simulation>(std::move(s))) {
    const auto fresh = [](std::size_t n) { return std::vector<int>(n, -1); };
    take_rows(*this, fresh(world().skins.size()), fresh(world().shapes.size()), fresh(world().matchings.size()));
    stamps = stamps_of(simulation->scene.files);
}

void refuse_changed_files(const Session& session, const Scene& again) {
    std::vector<FileStamp> both;
    for (const FileStamp& now : stamps_of(again.files))
        for (const FileStamp& then : session.stamps)
            if (then.file == now.file) both.push_back(then);
    std::vector<std::string> changes = changes_of(both, "the world was made");
    for (std::string& change : changes) change += ": put it back, or load the scene anew";
    if (!changes.empty()) throw InputError(changes);
}

bool change_settings(Session& session, const std::vector<std::string>& settings) {
    Scene again = scene_again(session, settings);
    refuse_changed_files(session, again);
    auto fresh = std::make_unique<Simulation>(make_simulation(std::move(again), session.threads, false));
    // What carry_over moves out of the old world it moves only where it succeeds.
    if (!carry_over(*session.simulation, *fresh)) return false;
    fresh->finger_counts = session.simulation->finger_counts;
    session.simulation = std::move(fresh);
    session.settings = settings;
    session.stamps = stamps_of(session.simulation->scene.files);
    return true;
}

}  // namespace palpate::api

int32_t palpate_api_version(void) { return PALPATE_API_VERSION; }
const char* palpate_version(void) { return PALPATE_VERSION; }

int32_t palpate_default_world_def(PalpateWorldDef* def, int32_t size) {
    if (!def) return fail(PALPATE_ERROR_ARGUMENT, "def is NULL");
    PalpateWorldDef own{};
    own.threads = 1;
    def->size = size;
    return write_struct(own, def) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

int32_t palpate_load(const char* file, const PalpateWorldDef* def, PalpateWorld* world) {
    if (!file || !world) return fail(PALPATE_ERROR_ARGUMENT, file ? "world is NULL" : "file is NULL");
    return guarded([&] {
        const PalpateWorldDef own = read_def(def);
        std::vector<std::string> settings = settings_of(own.settings, own.setting_count);
        FingerTemplates templates;
        Scene scene = load_scene(std::filesystem::absolute(find_scene(file)).lexically_normal(), settings, &templates);
        *world = adopt_scene(std::move(scene), own, std::move(settings), std::move(templates));
        return PALPATE_OK;
    });
}

int32_t palpate_load_text(const char* text, const PalpateWorldDef* def, PalpateWorld* world) {
    if (!text || !world) return fail(PALPATE_ERROR_ARGUMENT, text ? "world is NULL" : "text is NULL");
    return guarded([&] { return make_from_text(text, def, world); });
}

int32_t palpate_build(const PalpateSceneDef* scene, const PalpateWorldDef* def, PalpateWorld* world) {
    if (!scene || !world) return fail(PALPATE_ERROR_ARGUMENT, scene ? "world is NULL" : "scene is NULL");
    return guarded([&] { return make_from_text(scene_text(*scene), def, world); });
}

int32_t palpate_load_replay(const char* file, int32_t run, const PalpateWorldDef* def, PalpateWorld* world) {
    if (!file || !world) return fail(PALPATE_ERROR_ARGUMENT, file ? "world is NULL" : "file is NULL");
    return guarded([&] {
        const PalpateWorldDef own = read_def(def);
        Recording recording = read_recording(file);
        if (run < 1 || std::size_t(run) > recording.runs.size())
            throw InputError(std::string(file) + ": it holds runs 1 to " + std::to_string(recording.runs.size()) +
                             ", there is no run " + std::to_string(run));
        auto replay = std::make_unique<ReplaySource>();
        replay->run = std::move(recording.runs[std::size_t(run - 1)]);
        replay->file = file;
        if (!replay->run.gaps.empty()) replay->run.steps.resize(replay->run.gaps[0].step);
        Scene scene = recorded_scene(replay->run, file, replay->run.overrides);
        std::vector<std::string> settings = replay->run.overrides;
        const std::size_t objects = scene.spec.objects.size();
        if (objects != replay->run.objects.size())
            throw InputError(std::string(file) + ": the scene builds other objects than the recorded run had");
        *world = adopt_scene(std::move(scene), own, std::move(settings), {}, std::move(replay));
        return PALPATE_OK;
    });
}

int32_t palpate_clone(PalpateWorld world, PalpateWorld* clone) {
    if (!clone) return fail(PALPATE_ERROR_ARGUMENT, "clone is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        session->state.clear();
        append_state(session->state, *session->simulation);
        auto other =
            std::make_unique<Session>(make_simulation(Scene(session->simulation->scene), session->threads, false));
        other->settings = session->settings;
        other->templates = session->templates;
        other->stamps = session->stamps;
        other->threads = session->threads;
        std::string why;
        if (!restore_state(*other->simulation, session->state.data(), session->state.size(), why))
            return fail(PALPATE_ERROR_INTERNAL, why);
        other->fingers = session->fingers, other->objects = session->objects, other->thimbles = session->thimbles;
        other->added = session->added, other->changed = session->changed;
        const auto copy = [](const Ids& ids, const PoseInputs& from, PoseInputs& to) {
            to.reserve(ids.rows.size());
            for (const std::int32_t id : ids.ids) {
                PoseInput &a = from.at(Ids::slot_of(id)), &b = to.at(Ids::slot_of(id));
                a.take();
                const Pose<double>& p = a.taken;
                const double pose[7] = {p.position.x, p.position.y, p.position.z, p.rotation.w,
                                        p.rotation.x, p.rotation.y, p.rotation.z};
                b.give_to(id, a.moved_by_forces);
                b.set(id, a.taken_kind, pose);
            }
        };
        copy(session->fingers, session->finger_inputs, other->finger_inputs);
        copy(session->objects, session->object_inputs, other->object_inputs);
        *clone = adopt(std::move(other));
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_destroy(PalpateWorld world) {
    return guarded([&] { return discard(world); });
}

int32_t palpate_get_info(PalpateWorld world, PalpateWorldInfo* info) {
    if (!info) return fail(PALPATE_ERROR_ARGUMENT, "info is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const World& w = session->world();
    PalpateWorldInfo own{};
    own.finger_count = int32_t(session->simulation->fingers.size());
    own.object_count = int32_t(w.shapes.size());
    own.thimble_count = int32_t(w.matchings.size());
    own.time = w.time, own.dt = w.solver.dt, own.step = w.step;
    own.duration = session->simulation->scene.duration;
    own.generation = session->generation;
    return write_struct(own, info) ? PALPATE_OK : fail(PALPATE_ERROR_ARGUMENT, wrong_size);
}

namespace {

std::string joined_lines(const std::vector<std::string>& lines) {
    std::string all;
    for (const auto& line : lines) all += (all.empty() ? "" : "\n") + line;
    return all;
}

/// A text of a world. False where there is none.
bool text_of(const Session& s, std::int32_t text, std::int32_t index, std::string& out) {
    const Scene& scene = s.simulation->scene;
    const World& w = s.world();
    switch (text) {
        case PALPATE_TEXT_SCENE:
            out = scene.text ? *scene.text : read_file(scene.file);
            return true;
        case PALPATE_TEXT_WARNINGS:
            out = joined_lines(scene.warnings);
            return true;
        case PALPATE_TEXT_SETTINGS:
            out = joined_lines(s.settings);
            return true;
        case PALPATE_TEXT_FOLDER:
            out = std::filesystem::absolute(scene.file).parent_path().lexically_normal();
            return true;
        case PALPATE_TEXT_REPORT:
            out = report_of(s);
            return true;
        case PALPATE_TEXT_FILE:
            out = scene.text ? "" : scene.file.string();
            return true;
        case PALPATE_TEXT_FINGER:
            if (s.fingers.row(index) < 0) return false;
            out = w.skins[std::size_t(s.fingers.row(index))].name;
            return true;
        case PALPATE_TEXT_OBJECT:
            if (s.objects.row(index) < 0) return false;
            out = w.shapes[std::size_t(s.objects.row(index))].name;
            return true;
        case PALPATE_TEXT_THIMBLE:
            if (s.thimbles.row(index) < 0) return false;
            out = w.matchings[std::size_t(s.thimbles.row(index))].model.kind->name;
            return true;
        default:
            return false;
    }
}

template <class Rows>
std::int32_t find_named(const Rows& rows, const Ids& ids, const char* name, const char* what, std::int32_t* index) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < rows.size(); ++i) {
        if (rows[i].name == name) {
            *index = ids.ids[i];
            return PALPATE_OK;
        }
        names.push_back(rows[i].name);
    }
    return fail(PALPATE_ERROR_ARGUMENT, std::string("there is no ") + what + " \"" + std::string(name).substr(0, 80) +
                                            "\"; there are: " + joined(names));
}

}  // namespace

int32_t palpate_get_text(PalpateWorld world, int32_t text, int32_t index, char* buffer, int64_t capacity,
                         int64_t* needed) {
    if (capacity < 0 || (capacity > 0 && !buffer))
        return fail(PALPATE_ERROR_ARGUMENT, "expected a buffer and its capacity, or capacity 0");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        std::string found;
        if (!text_of(*session, text, index, found))
            return fail(PALPATE_ERROR_ARGUMENT, "there is no such text, finger, object or thimble");
        const auto size = std::int64_t(found.size() + 1);
        if (needed) *needed = size;
        if (capacity == 0 && needed) return int32_t(PALPATE_OK);
        if (capacity < size)
            return fail(PALPATE_ERROR_SIZE,
                        "the text has " + std::to_string(size) + " bytes, the buffer " + std::to_string(capacity));
        std::memcpy(buffer, found.c_str(), std::size_t(size));
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_find_finger(PalpateWorld world, const char* name, int32_t* finger) {
    if (!name || !finger) return fail(PALPATE_ERROR_ARGUMENT, name ? "finger is NULL" : "name is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] { return find_named(session->world().skins, session->fingers, name, "finger", finger); });
}

int32_t palpate_find_object(PalpateWorld world, const char* name, int32_t* object) {
    if (!name || !object) return fail(PALPATE_ERROR_ARGUMENT, name ? "object is NULL" : "name is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] { return find_named(session->world().shapes, session->objects, name, "object", object); });
}

int32_t palpate_set(PalpateWorld world, const char* const* settings, int32_t count) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    return guarded([&] {
        if (session->replay)
            return fail(PALPATE_ERROR_STATE,
                        "a replay has the settings of its recording; load the scene to change them");
        std::vector<std::string> all = session->settings;
        for (std::string& setting : settings_of(settings, count)) {
            // A key that was set before is replaced.
            const std::string key = setting.substr(0, setting.find('=') + 1);
            std::erase_if(all, [&](const std::string& old) { return old.starts_with(key); });
            all.push_back(std::move(setting));
        }
        if (!change_settings(*session, all))
            return fail(
                PALPATE_ERROR_STATE,
                "these settings build other meshes, fingers, objects or thimbles: palpate_add_finger and its like "
                "change those while a world lives, a new world has others");
        if (session->recorder) session->recorder->change_settings(*session->simulation, all);
        show_all(*session);
        return int32_t(PALPATE_OK);
    });
}
