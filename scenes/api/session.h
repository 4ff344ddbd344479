#pragma once
// What lies behind the id of a world.

#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "scenes/api/palpate.h"
#include "scenes/load/load_now.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/simulation.h"

namespace palpate {
class ReportRecorder;
}

namespace palpate::api {

/// A pose that any thread may set and the next step takes. Writers that meet wait for each other, the step for nobody:
/// where one is being written it takes the one before.
struct PoseInput {
    enum Kind : std::int64_t { released = 0, seen = 1, unseen = 2 };
    // Stores of what is guarded release, loads acquire: they stay between those of the version.
    std::atomic<std::uint32_t> version{0};  ///< odd while it is written
    std::atomic<std::int64_t> kind{released};
    std::array<std::atomic<double>, 7> pose{};
    std::atomic<std::int32_t> id{-1};          ///< whose it is; -1: nobody's
    std::atomic<bool> moved_by_forces{false};  ///< an object
    // Of the step alone:
    std::int64_t taken_kind = released;
    Pose<double> taken = Pose<double>::identity();

    /// False where it is no longer `whose`.
    bool set(std::int32_t whose, std::int64_t kind, const double* pose);
    void take();
    /// Belongs to `whose` from now on, and is released.
    void give_to(std::int32_t whose, bool moves);

  private:
    std::uint32_t lock();
};

/// Ids of fingers, objects or thimbles: a slot, and the generation of what is in it. Those that a world begins with are
/// 0, 1, 2, ...; whoever is removed leaves an id that is never valid again, unless its slot has been used 32,767 times.
struct Ids {
    std::vector<std::int32_t> ids;         ///< [row]
    std::vector<int> rows;                 ///< [slot]; -1: free
    std::vector<std::int32_t> generation;  ///< [slot]

    static constexpr std::int32_t most_slots = 32768, last_generation = 32767;
    static int slot_of(std::int32_t id) { return id & 0xffff; }
    int row(std::int32_t id) const {
        const int slot = slot_of(id);
        if (id < 0 || std::size_t(slot) >= rows.size() || rows[std::size_t(slot)] < 0) return -1;
        return ids[std::size_t(rows[std::size_t(slot)])] == id ? rows[std::size_t(slot)] : -1;
    }
    /// Rows that were there before keep their ids, new ones (-1) get fresh ones. Throws std::bad_alloc.
    void change(const std::vector<int>& kept);
};

/// Inputs by slot, in places that never move: other threads find them without a lock.
class PoseInputs {
  public:
    PoseInputs() = default;
    ~PoseInputs();
    PoseInputs(const PoseInputs&) = delete;
    PoseInputs& operator=(const PoseInputs&) = delete;
    /// Null where the id is nobody's.
    PoseInput* find(std::int32_t id) const;
    PoseInput& at(int slot) const;
    /// Memory for this many slots.
    void reserve(std::size_t slots);

  private:
    static constexpr int first_size = 8;
    std::array<std::atomic<PoseInput*>, 13> blocks_{};  ///< of 8, 16, 32, ...
};

/// Numbers of a field, in the place that views show.
struct FieldMemory {
    std::vector<double> doubles;
    std::vector<std::int32_t> integers;
    std::vector<std::uint8_t> bytes;
    std::int32_t rank = 0, shape[2] = {0, 0};
};

/// A field that every step fills.
struct LiveField {
    int field, index;  ///< row; -1: of the world
    FieldMemory* memory;
};

/// What palpate_step leaves for other threads: a ring of whole snapshots, each of which has a version that is odd while
/// it is written.
struct Snapshots {
    struct Entry {
        std::atomic<std::uint32_t> version{0};
        std::vector<std::atomic<std::uint64_t>> words;
    };
    static constexpr std::uint32_t ring = 4;
    std::array<Entry, ring> entries;
    std::vector<std::int32_t> ids;      ///< [finger]
    std::vector<std::size_t> first;     ///< [finger] where its words begin: state, positions, forces
    std::vector<std::int32_t> samples;  ///< [finger]
    std::atomic<std::uint32_t> newest{0};
};

/// A recorded run that is run again.
struct ReplaySource {
    RecordedRun run;
    std::string file;
    std::size_t done = 0, change = 0;
    std::int64_t different = 0;  ///< first step that came out otherwise; 0: none
};

struct Session {
    PalpateWorld id = 0;
    std::atomic_flag owned = ATOMIC_FLAG_INIT;
    std::unique_ptr<Simulation> simulation;
    std::vector<std::string> settings;
    std::vector<FileStamp> stamps;  ///< of files that the scene names, as they were when they were read
    FingerTemplates templates;      ///< meshes, so that new settings need no mesher
    int threads = 1;
    StepInputs inputs;
    Ids fingers, objects, thimbles;
    PoseInputs finger_inputs, object_inputs;
    std::map<std::string, std::string> added;  ///< what was added, and its part of the scene's text
    bool changed = false;                      ///< something was added or removed
    std::int64_t generation = 1;
    std::map<std::pair<int, std::int32_t>, std::unique_ptr<FieldMemory>> fields;  ///< by field and id; -1: the world's
    std::vector<std::unique_ptr<FieldMemory>> old_fields;  ///< of what was removed: views of them may be held still
    std::vector<LiveField> live_fields;
    std::atomic<Snapshots*> snapshots{nullptr};             ///< the last of `all_snapshots`; null: there are none yet
    std::vector<std::unique_ptr<Snapshots>> all_snapshots;  ///< older ones: other threads may be reading them
    bool keeps_snapshots = false;
    std::unique_ptr<RunWriter> recorder;
    std::unique_ptr<ReplaySource> replay;
    std::vector<std::uint8_t> state;        ///< scratch of palpate_save
    std::vector<std::int64_t> unconverged;  ///< [finger] steps that did not converge since there is a log
    double frames_per_second = 0;
    std::shared_ptr<ReportRecorder> frames;  ///< null: none yet

    explicit Session(Simulation s);
    PoseInput& finger_input(std::size_t row) const { return finger_inputs.at(Ids::slot_of(fingers.ids[row])); }
    PoseInput& object_input(std::size_t row) const { return object_inputs.at(Ids::slot_of(objects.ids[row])); }
    const World& world() const { return simulation->world; }
};

/// Tells the log, where there is one.
void log(std::int32_t level, PalpateWorld world, const char* message);
/// What a scene that was loaded is likely to have wrong.
void log_scene(const Scene& scene);
/// What the last step had wrong.
void log_step(Session& session);

/// After a step: keeps a frame where one is due.
void keep_frame(Session& session);
/// Kept frames are those of another past.
void drop_frames(Session& session);
/// An HTML page of kept frames, or of now.
std::string report_of(const Session& session);

/// One step; writes no views.
std::int32_t step_once(Session& session);
/// After steps, a restore, or new settings: fills what is shown.
void show(Session& session);
/// The same for what stays from step to step, too: after new settings.
void show_all(Session& session);

/// A living world is changed by loading its scene again: throws InputError where a file has changed that both name,
/// for what was built of it would change unasked.
void refuse_changed_files(const Session& session, const Scene& again);
/// Goes on with other settings. Throws InputError; false where the scene would be built otherwise.
bool change_settings(Session& session, const std::vector<std::string>& settings);

/// Ids, inputs and views follow a world whose rows have changed, or which is new.
void take_rows(Session& session, const std::vector<int>& fingers, const std::vector<int>& objects,
               const std::vector<int>& thimbles);
/// The same for views and snapshots alone.
void renew_views(Session& session);
/// Memory for snapshots of the fingers that there are, where there is none.
void prepare_snapshots(Session& session);
/// Leaves one for other threads.
void take_snapshot(Session& session);
std::int32_t fail_no_part(const char* what, std::int32_t id) noexcept;
/// Where fingers and objects are now, by their names.
PosesNow poses_now(const World& world);

/// The text of one finger or object (TOML), called `name` where the description has no name. Throws InputError.
std::string finger_text(const PalpateFingerDef* def, const std::string& name);
std::string object_text(const PalpateObjectDef* def, const std::string& name);
/// The text of a scene (TOML) that says what the descriptions do. Throws InputError.
std::string scene_text(const PalpateSceneDef& scene);

}  // namespace palpate::api
