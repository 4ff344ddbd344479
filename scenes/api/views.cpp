// What is felt, shown: fields in memory of the world.

#include <algorithm>

#include "scenes/api/fields.h"
#include "scenes/api/guard.h"

using namespace palpate;
using namespace palpate::api;

namespace palpate::api {

namespace {

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
        // Those with a row for each have other sizes now, and are asked for anew; whoever holds the old ones still may.
        if (row < 0 || kind_of(field).by_object) {
            s.old_fields.push_back(std::move(it->second));
            it = s.fields.erase(it);
            continue;
        }
        if (kind_of(field).changes) s.live_fields.push_back({field, row, it->second.get()});
        ++it;
    }
    if (!s.all_snapshots.empty()) {
        s.snapshots.store(nullptr);
        if (alone_in(s.id)) s.all_snapshots.clear();
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
    const FieldKind& kind = kind_of(field);
    const int row = row_of(*session, field, index);
    if (kind.of == Of::world && index != -1) return fail(PALPATE_ERROR_ARGUMENT, "a field of the world has index -1");
    if (kind.of != Of::world && row < 0)
        return fail_no_part(kind.of == Of::finger ? "finger" : kind.of == Of::object ? "object" : "thimble", index);
    if (kind.of == Of::object && session->world().shapes[std::size_t(row)].soft < 0)
        return fail(PALPATE_ERROR_STATE,
                    "this object is rigid: it has a pose (PALPATE_OBJECT_POSES); only tissue has places of its own");
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
