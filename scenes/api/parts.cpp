// Fingers, objects and thimbles: their ids, and how they come and go while a world lives.

#include <algorithm>
#include <bit>
#include <cstring>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/api/guard.h"
#include "scenes/api/session.h"
#include "scenes/run/carry_kept.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

void Ids::change(const std::vector<int>& kept) {
    std::vector<std::int32_t> now(kept.size(), -1);
    std::vector<int> places(rows.size(), -1);
    for (std::size_t i = 0; i < kept.size(); ++i) {
        if (kept[i] < 0) continue;
        now[i] = ids[std::size_t(kept[i])];
        places[std::size_t(slot_of(now[i]))] = int(i);
    }
    for (std::size_t slot = 0; slot < rows.size(); ++slot)
        if (rows[slot] >= 0 && places[slot] < 0) ++generation[slot];  // what was there is gone
    for (std::size_t i = 0; i < kept.size(); ++i) {
        if (kept[i] >= 0) continue;
        std::size_t slot = 0;
        while (slot < places.size() && (places[slot] >= 0 || generation[slot] > last_generation)) ++slot;
        if (slot >= std::size_t(most_slots)) throw std::bad_alloc();
        if (slot == places.size()) places.push_back(-1), generation.push_back(0);
        places[slot] = int(i);
        now[i] = std::int32_t(slot) | generation[slot] << 16;
    }
    ids = std::move(now);
    rows = std::move(places);
}

PoseInputs::~PoseInputs() {
    for (auto& block : blocks_) delete[] block.load();
}
PoseInput& PoseInputs::at(int slot) const {
    const auto place = std::uint32_t(slot + first_size);
    const int k = std::bit_width(place / first_size) - 1;
    return blocks_[std::size_t(k)].load(std::memory_order_acquire)[place - (std::uint32_t(first_size) << k)];
}
PoseInput* PoseInputs::find(std::int32_t id) const {
    if (id < 0) return nullptr;
    const int slot = Ids::slot_of(id);
    const auto k = std::size_t(std::bit_width(std::uint32_t(slot + first_size) / first_size) - 1);
    if (k >= blocks_.size() || !blocks_[k].load(std::memory_order_acquire)) return nullptr;
    PoseInput& input = at(slot);
    return input.id.load(std::memory_order_acquire) == id ? &input : nullptr;
}
void PoseInputs::reserve(std::size_t slots) {
    std::size_t have = 0;
    for (std::size_t k = 0; k < blocks_.size() && have < slots; have += std::size_t(first_size) << k, ++k)
        if (!blocks_[k].load())
            blocks_[k].store(new PoseInput[std::size_t(first_size) << k], std::memory_order_release);
}

std::int32_t fail_no_part(const char* what, std::int32_t id) noexcept {
    char text[160];
    plain_snprintf(text, sizeof text,
                   "there is no %s %d in this world, or it has been removed: palpate_list has the ids", what, int(id));
    return fail(PALPATE_ERROR_ARGUMENT, text);
}

namespace {

/// Who is new gets a released input; ids of those who are gone find none.
void give_inputs(const Ids& before, const Ids& now, PoseInputs& inputs, const std::vector<char>& moves) {
    inputs.reserve(now.rows.size());
    for (const std::int32_t id : before.ids)
        if (now.row(id) < 0) inputs.at(Ids::slot_of(id)).give_to(-1, false);
    for (std::size_t i = 0; i < now.ids.size(); ++i) {
        PoseInput& input = inputs.at(Ids::slot_of(now.ids[i]));
        if (input.id.load() != now.ids[i]) input.give_to(now.ids[i], moves[i] != 0);
    }
}

}  // namespace

void take_rows(Session& s, const std::vector<int>& fingers, const std::vector<int>& objects,
               const std::vector<int>& thimbles) {
    const Ids old_fingers = s.fingers, old_objects = s.objects;
    s.fingers.change(fingers);
    s.objects.change(objects);
    s.thimbles.change(thimbles);
    std::vector<char> moves;
    for (const VirtualObject& o : s.world().shapes) moves.push_back(o.body >= 0 || o.held_body >= 0);
    give_inputs(old_fingers, s.fingers, s.finger_inputs, std::vector<char>(s.fingers.ids.size(), 0));
    give_inputs(old_objects, s.objects, s.object_inputs, moves);
    s.inputs.fingers.reserve(s.fingers.ids.size());
    s.inputs.objects.reserve(s.objects.ids.size());
}

PosesNow poses_now(const World& w) {
    PosesNow now;
    for (std::size_t i = 0; i < w.skins.size(); ++i)
        now.fingers[w.skins[i].name] = w.step > 0 ? bone_pose(w, w.skins.owner(i)) : w.skins[i].start;
    for (const VirtualObject& o : w.shapes) now.objects[o.name] = o.pose;
    return now;
}

namespace {

/// [row now] row before, by names that are there once.
template <class Rows>
std::vector<int> rows_before(const Rows& now, const Rows& before) {
    std::vector<int> out;
    for (const auto& row : now) {
        const auto same = std::find_if(before.begin(), before.end(), [&](const auto& r) { return r.name == row.name; });
        out.push_back(same == before.end() ? -1 : int(same - before.begin()));
    }
    return out;
}

/// [thimble now] thimble before: of the same kind, on the same finger.
std::vector<int> thimbles_before(const World& now, const World& before, const std::vector<int>& fingers) {
    const auto finger_of = [](const World& w, const Matching& m) {
        for (std::size_t i = 0; i < w.skins.size(); ++i)
            if (w.skins.owner(i) == m.finger) return int(i);
        return -1;
    };
    std::vector<int> out;
    for (const Matching& m : now.matchings) {
        const int was = fingers[std::size_t(finger_of(now, m))];
        out.push_back(-1);
        for (std::size_t t = 0; was >= 0 && t < before.matchings.size(); ++t)
            if (finger_of(before, before.matchings[t]) == was && before.matchings[t].model.kind == m.model.kind)
                out.back() = int(t);
    }
    return out;
}

/// PALPATE_OK, or why nothing may come or go.
std::int32_t may_change(const Session& s) {
    if (s.replay) return fail(PALPATE_ERROR_STATE, "a replay has the fingers and objects of its recording");
    if (s.recorder)
        return fail(PALPATE_ERROR_STATE,
                    "a recording has the same fingers and objects to its end: palpate_end_recording first");
    return PALPATE_OK;
}

std::string text_of_scene(const Session& s) {
    const Scene& scene = s.simulation->scene;
    return scene.text ? *scene.text : read_file(scene.file);
}

/// Builds the scene as it is to be, and moves into it what the old one has come to. Throws InputError, and then nothing
/// has changed.
void rebuild(Session& s, const std::string& text, const std::vector<std::string>& settings) {
    Scene scene =
        load_scene_now(text, s.simulation->scene.file, settings, &s.templates, poses_now(s.simulation->world));
    refuse_changed_files(s, scene);
    auto fresh = std::make_unique<Simulation>(make_simulation(std::move(scene), s.threads, false));
    const World &before = s.world(), &now = fresh->world;
    KeptRows kept{rows_before(now.skins, before.skins), rows_before(now.shapes, before.shapes)};
    const std::vector<int> thimbles = thimbles_before(now, before, kept.fingers);
    carry_kept(*s.simulation, *fresh, kept);
    s.simulation = std::move(fresh);
    s.settings = settings;
    s.stamps = stamps_of(s.simulation->scene.files);
    s.changed = true;
    take_rows(s, kept.fingers, kept.objects, thimbles);
    renew_views(s);
}

/// Without what was said about "finger.index".
std::vector<std::string> settings_without(const Session& s, const std::string& path) {
    std::vector<std::string> out;
    for (const std::string& setting : s.settings)
        if (!setting.starts_with(path + ".") && !setting.starts_with(path + "=")) out.push_back(setting);
    return out;
}

/// A name that nobody has: "finger 3".
template <class Rows>
std::string free_name(const char* what, const Rows& rows) {
    for (std::size_t k = rows.size();; ++k) {
        const std::string name = std::string(what) + " " + std::to_string(k);
        if (std::none_of(rows.begin(), rows.end(), [&](const auto& r) { return r.name == name; })) return name;
    }
}

template <class Rows>
void add(Session& s, const char* what, const Rows& rows, const char* given, const std::string& name,
         const std::string& part) {
    for (const auto& row : rows)
        if (given && row.name == given)
            throw InputError(std::string("there is a ") + what + " \"" + given + "\" already");
    const std::string text = text_of_scene(s);
    const std::string key = std::string(what) + "." + name;
    // What a file says and a setting takes out stays in its text: its name comes back with the next world.
    if (std::find(s.settings.begin(), s.settings.end(), key + "=none") != s.settings.end())
        throw InputError(std::string("a ") + what + " \"" + name +
                         "\" was removed that the scene's own text describes: give the new one another name");
    rebuild(s, text + "\n" + part, s.settings);
    s.added[key] = "\n" + part;
}

void remove(Session& s, const std::string& what, const std::string& name) {
    const std::string key = what + "." + name;
    std::string text = text_of_scene(s);
    std::vector<std::string> settings = settings_without(s, key);
    const auto own = s.added.find(key);
    if (const std::size_t at = own == s.added.end() ? std::string::npos : text.find(own->second);
        at != std::string::npos)
        text.erase(at, own->second.size());
    else
        settings.push_back(key + "=none");
    rebuild(s, text, settings);
    s.added.erase(key);
}

}  // namespace

}  // namespace palpate::api

int32_t palpate_list(PalpateWorld world, int32_t what, int32_t* ids, int32_t capacity, int32_t* count) {
    if (capacity < 0 || (capacity > 0 && !ids))
        return fail(PALPATE_ERROR_ARGUMENT, "expected a list and its capacity, or capacity 0");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (what < PALPATE_FINGERS || what > PALPATE_THIMBLES)
        return fail(PALPATE_ERROR_ARGUMENT, "what: expected PALPATE_FINGERS, PALPATE_OBJECTS or PALPATE_THIMBLES");
    const Ids& all = what == PALPATE_FINGERS   ? session->fingers
                     : what == PALPATE_OBJECTS ? session->objects
                                               : session->thimbles;
    const auto n = int32_t(all.ids.size());
    if (count) *count = n;
    if (capacity == 0 && count) return PALPATE_OK;
    if (capacity < n) return fail(PALPATE_ERROR_SIZE, "the list has no room for all ids; their number was written");
    std::copy(all.ids.begin(), all.ids.end(), ids);
    return PALPATE_OK;
}

int32_t palpate_add_finger(PalpateWorld world, const PalpateFingerDef* def, int32_t* finger) {
    if (!def || !finger) return fail(PALPATE_ERROR_ARGUMENT, def ? "finger is NULL" : "def is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (const int32_t result = may_change(*session); result != PALPATE_OK) return result;
    return guarded([&] {
        const auto& skins = session->world().skins;
        const std::string name = free_name("finger", skins);
        PalpateFingerDef own{};
        if (!read_struct(def, own)) throw InputError(wrong_size);
        const std::string text = finger_text(def, name);
        add(*session, "finger", skins, own.name, own.name ? own.name : name, text);
        *finger = session->fingers.ids.back();
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_add_object(PalpateWorld world, const PalpateObjectDef* def, int32_t* object) {
    if (!def || !object) return fail(PALPATE_ERROR_ARGUMENT, def ? "object is NULL" : "def is NULL");
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (const int32_t result = may_change(*session); result != PALPATE_OK) return result;
    return guarded([&] {
        const auto& shapes = session->world().shapes;
        const std::string name = free_name("object", shapes);
        PalpateObjectDef own{};
        if (!read_struct(def, own)) throw InputError(wrong_size);
        const std::string text = object_text(def, name);
        add(*session, "object", shapes, own.name, own.name ? own.name : name, text);
        *object = session->objects.ids.back();
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_remove_finger(PalpateWorld world, int32_t finger) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const int row = session->fingers.row(finger);
    if (row < 0) return fail_no_part("finger", finger);
    if (const int32_t result = may_change(*session); result != PALPATE_OK) return result;
    return guarded([&] {
        if (session->fingers.ids.size() == 1)
            return fail(PALPATE_ERROR_STATE, "a world has one finger at least: add another one first");
        remove(*session, "finger", std::string(session->world().skins[std::size_t(row)].name));
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_remove_object(PalpateWorld world, int32_t object) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const int row = session->objects.row(object);
    if (row < 0) return fail_no_part("object", object);
    if (const int32_t result = may_change(*session); result != PALPATE_OK) return result;
    return guarded([&] {
        remove(*session, "object", std::string(session->world().shapes[std::size_t(row)].name));
        return int32_t(PALPATE_OK);
    });
}

int32_t palpate_set_thimble(PalpateWorld world, int32_t finger, const char* kind, const char* method) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    const int row = session->fingers.row(finger);
    if (row < 0) return fail_no_part("finger", finger);
    if (const int32_t result = may_change(*session); result != PALPATE_OK) return result;
    return guarded([&] {
        const std::string path = "finger." + session->world().skins[std::size_t(row)].name + ".device";
        std::vector<std::string> settings = settings_without(*session, path);
        for (const char* text : {kind, method})
            if (text && std::strpbrk(text, "\"\\\n")) throw InputError("kind and method: expected a name");
        if (kind)
            settings.push_back(path + "={ kind = \"" + kind + "\"" +
                               (method ? std::string(", method = \"") + method + "\"" : "") + " }");
        else  // whether the scene's text has one or not
            settings.insert(settings.end(), {path + "={}", path + "=none"});
        rebuild(*session, text_of_scene(*session), settings);
        return int32_t(PALPATE_OK);
    });
}
