#pragma once
// What lies behind the id of a world.

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "scenes/api/palpate.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/simulation.h"

namespace palpate::api {

/// A pose that any thread may set and the next step takes. Writers that meet wait for each other, the step for nobody:
/// where one is being written it takes the one before.
struct PoseInput {
    enum Kind : std::int64_t { released = 0, seen = 1, unseen = 2 };
    // Stores of what is guarded release, loads acquire: they stay between those of the version.
    std::atomic<std::uint32_t> version{0};  ///< odd while it is written
    std::atomic<std::int64_t> kind{released};
    std::array<std::atomic<double>, 7> pose{};
    // Of the step alone:
    std::int64_t taken_kind = released;
    Pose<double> taken = Pose<double>::identity();

    void set(std::int64_t kind, const double* pose);
    void take();
};

/// Numbers of a field, in the place that views show.
struct FieldMemory {
    std::vector<double> doubles;
    std::vector<std::int32_t> integers;
    std::vector<std::uint8_t> bytes;
    std::int32_t rank = 0, shape[2] = {0, 0};
    bool wanted = false;
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
    std::vector<std::size_t> first;     ///< [finger] where its words begin: state, positions, forces
    std::vector<std::int32_t> samples;  ///< [finger]
    std::atomic<std::uint32_t> newest{0};
    std::atomic<bool> on{false}, any{false};
    std::vector<std::uint64_t> scratch;
};

/// A recorded run that is run again.
struct ReplaySource {
    RecordedRun run;
    std::string file;
    std::size_t done = 0, change = 0;
    std::int64_t different = 0;  ///< first step that came out otherwise; 0: none
};

struct Session {
    std::atomic_flag owned = ATOMIC_FLAG_INIT;
    std::unique_ptr<Simulation> simulation;
    std::vector<std::string> settings;
    FingerTemplates templates;  ///< meshes, so that new settings need no mesher
    int threads = 1;
    StepInputs inputs;
    std::vector<PoseInput> finger_inputs, object_inputs;
    std::vector<char> moved_by_forces;  ///< [object]
    std::int64_t generation = 1;
    std::vector<FieldMemory> fields;               ///< [field][index + 1]
    std::vector<std::pair<int, int>> live_fields;  ///< (field, index) that every step fills
    Snapshots snapshots;
    std::unique_ptr<RunWriter> recorder;
    std::unique_ptr<ReplaySource> replay;
    std::vector<std::uint8_t> state;  ///< scratch of palpate_save

    explicit Session(Simulation s);
    const World& world() const { return simulation->world; }
};

/// One step; writes no views.
std::int32_t step_once(Session& session);
/// After steps, a restore, or new settings: fills what is shown.
void show(Session& session);
/// The same for what stays from step to step, too: after new settings.
void show_all(Session& session);

/// Goes on with other settings. Throws InputError; false where the scene would be built otherwise.
bool change_settings(Session& session, const std::vector<std::string>& settings);

/// The text of a scene (TOML) that says what the descriptions do. Throws InputError.
std::string scene_text(const PalpateSceneDef& scene);

}  // namespace palpate::api
