// libpalpate.so as its users see it: palpate.h and nothing else of palpate.

#include <gtest/gtest.h>
#include <palpate/palpate.h>

#include <sys/wait.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <new>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace {
std::atomic<long> allocations{0};
}  // namespace

// Sanitisers bring their own allocator.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PALPATE_COUNTS_ALLOCATIONS 0
#else
#define PALPATE_COUNTS_ALLOCATIONS 1
#pragma GCC diagnostic ignored "-Wmismatched-new-delete"
void* operator new(std::size_t size) {
    ++allocations;
    if (void* p = std::malloc(size ? size : 1)) return p;
    throw std::bad_alloc();
}
void* operator new(std::size_t size, std::align_val_t alignment) {
    ++allocations;
    const auto line = std::size_t(alignment);
    if (void* p = std::aligned_alloc(line, (size + line - 1) / line * line)) return p;
    throw std::bad_alloc();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }
#endif

namespace {

std::string scene_file(const std::string& name) { return std::string(PALPATE_SOURCE_DIR) + "/scenes/" + name; }

struct Outcome {
    int code;
    std::string out;
};
Outcome shell(const std::string& command) {
    Outcome o;
    FILE* pipe = popen((command + " 2>&1").c_str(), "r");
    char text[4096];
    for (std::size_t n; (n = std::fread(text, 1, sizeof text, pipe)) > 0;) o.out.append(text, n);
    const int status = pclose(pipe);
    o.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128;
    return o;
}

class Folder {
  public:
    Folder() {
        std::string name = (std::filesystem::temp_directory_path() / "palpate-api-XXXXXX").string();
        if (!mkdtemp(name.data())) throw std::runtime_error("no scratch folder");
        path = name;
    }
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
    std::filesystem::path path;
};

/// A world that is destroyed at the end of the test.
class Held {
  public:
    Held() = default;
    ~Held() { palpate_destroy(id); }
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;
    operator PalpateWorld() const { return id; }
    PalpateWorld id = 0;
};

PalpateWorldDef with_settings(const std::vector<const char*>& settings) {
    PalpateWorldDef def;
    palpate_default_world_def(&def, sizeof def);
    def.settings = settings.data();
    def.setting_count = std::int32_t(settings.size());
    return def;
}

PalpateWorldInfo info_of(PalpateWorld world) {
    PalpateWorldInfo info{};
    info.size = sizeof info;
    EXPECT_EQ(PALPATE_OK, palpate_get_info(world, &info)) << palpate_last_error();
    return info;
}

std::vector<char> bytes_of(PalpateWorld world, std::int32_t field, std::int32_t index) {
    PalpateView v{};
    v.size = sizeof v;
    EXPECT_EQ(PALPATE_OK, palpate_view(world, field, index, &v)) << palpate_last_error();
    const std::size_t each = v.type == PALPATE_FLOAT64 ? 8 : v.type == PALPATE_INT32 ? 4 : 1;
    const auto* p = static_cast<const char*>(v.data);
    return {p, p + each * std::size_t(v.shape[0]) * std::size_t(v.rank == 2 ? v.shape[1] : 1)};
}

/// All that changes in a world, as bytes.
std::vector<std::vector<char>> all_of(PalpateWorld world) {
    const PalpateWorldInfo info = info_of(world);
    std::vector<std::vector<char>> all;
    for (std::int32_t i = 0; i < info.finger_count; ++i)
        for (int field : {PALPATE_NODES, PALPATE_FORCES, PALPATE_TOUCHES, PALPATE_POSITIONS, PALPATE_PRESSURES})
            all.push_back(bytes_of(world, field, i));
    for (std::int32_t i = 0; i < info.thimble_count; ++i)
        for (int field : {PALPATE_CONFIGURATION, PALPATE_JOINTS_WANTED, PALPATE_JOINTS_SENT, PALPATE_JOINTS_REACHED})
            all.push_back(bytes_of(world, field, i));
    for (int field : {PALPATE_BONE_POSES, PALPATE_NET_FORCES, PALPATE_NET_TORQUES, PALPATE_CENTRES,
                      PALPATE_OBJECT_POSES, PALPATE_OBJECT_MOTIONS})
        all.push_back(bytes_of(world, field, -1));
    return all;
}

std::vector<char> saved(PalpateWorld world) {
    std::int64_t size = 0;
    EXPECT_EQ(PALPATE_OK, palpate_save(world, nullptr, 0, &size)) << palpate_last_error();
    std::vector<char> state(static_cast<std::size_t>(size));
    EXPECT_EQ(PALPATE_OK, palpate_save(world, state.data(), size, &size)) << palpate_last_error();
    return state;
}

const char* const small_scene = R"(
duration_s = 0.2
dt_ms = 1
[solver]
preset = "balanced"
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[object]]
name = "cube"
kind = "box"
size_mm = [10, 10, 10]
position_mm = [60, 0, 5]
mass_g = 5
[[finger]]
name = "index"
elements = 120
track = [ { t_s = 0, position_mm = [0, 0, 10] }, { t_s = 0.05, position_mm = [0, 0, 6] } ]
)";

TEST(Api, TheSameBitsAsTheProgram) {
    Folder folder;
    const std::string file = folder.path / "run.palpate";
    const Outcome ran =
        shell(std::string(PALPATE_PROGRAM) + " run " + scene_file("hand.toml") +
              " --duration 0.05 --quiet --set dt_ms=1 --record " + file + " --out " + (folder.path / "out").string());
    ASSERT_EQ(0, ran.code) << ran.out;
    Held replay, world;
    ASSERT_EQ(PALPATE_OK, palpate_load_replay(file.c_str(), 1, nullptr, &replay.id)) << palpate_last_error();
    const std::vector<const char*> settings{"dt_ms=1", "duration_s=0.05"};
    const PalpateWorldDef def = with_settings(settings);
    ASSERT_EQ(PALPATE_OK, palpate_load(scene_file("hand.toml").c_str(), &def, &world.id)) << palpate_last_error();
    PalpateReplayState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_replay(replay, &state));
    EXPECT_EQ(50, state.steps);
    for (int k = 0; k < state.steps; ++k) {
        ASSERT_EQ(PALPATE_OK, palpate_step(replay, 1)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_step(world, 1)) << palpate_last_error();
        ASSERT_EQ(all_of(replay), all_of(world)) << "step " << k + 1;
    }
    ASSERT_EQ(PALPATE_OK, palpate_get_replay(replay, &state));
    EXPECT_EQ(1, state.same);
    EXPECT_EQ(50, state.done);
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_step(replay, 1));
}

TEST(Api, TheProgramReplaysWhatWasRecordedHere) {
    Folder folder;
    const std::string file = folder.path / "run.palpate";
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_record(world, file.c_str())) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 30));
    const double pose[7] = {0.001, 0, 0.0055, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, 0, pose));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    const char* const softer[] = {"finger.index.material.young_kPa=20"};
    ASSERT_EQ(PALPATE_OK, palpate_set(world, softer, 1)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    ASSERT_EQ(PALPATE_OK, palpate_end_recording(world)) << palpate_last_error();
    const Outcome replayed = shell(std::string(PALPATE_PROGRAM) + " replay " + file);
    EXPECT_EQ(0, replayed.code) << replayed.out;
    EXPECT_NE(std::string::npos, replayed.out.find("70 steps")) << replayed.out;
}

class ApiStates : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Api, ApiStates,
                         ::testing::Values("hand.toml dt_ms=2", "pinch.toml solver.preset=fast",
                                           "hold_mug.toml solver.preset=fast solver.level_of_detail=auto",
                                           "hand.toml solver.precision=float solver.level_of_detail=auto dt_ms=2",
                                           "ball.toml finger.0.device.method=force"),
                         [](const auto& i) { return std::to_string(i.index); });

TEST_P(ApiStates, GoOnWithTheSameBits) {
    std::istringstream words(GetParam());
    std::string name;
    words >> name;
    std::vector<std::string> texts{"solver.preset=balanced"};
    for (std::string word; words >> word;) texts.push_back(word);
    std::vector<const char*> settings;
    for (const auto& text : texts) settings.push_back(text.c_str());
    const PalpateWorldDef def = with_settings(settings);
    Held world, fresh, clone;
    ASSERT_EQ(PALPATE_OK, palpate_load(scene_file(name).c_str(), &def, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 40)) << palpate_last_error();
    const std::vector<char> state = saved(world);
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &clone.id)) << palpate_last_error();
    const auto at_branch = all_of(world);
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 40));
    const auto first = all_of(world);
    ASSERT_NE(at_branch, first);
    ASSERT_EQ(PALPATE_OK, palpate_restore(world, state.data(), std::int64_t(state.size()))) << palpate_last_error();
    EXPECT_EQ(at_branch, all_of(world));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 40));
    EXPECT_EQ(first, all_of(world)) << "the same world";
    ASSERT_EQ(PALPATE_OK, palpate_load(scene_file(name).c_str(), &def, &fresh.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_restore(fresh, state.data(), std::int64_t(state.size()))) << palpate_last_error();
    EXPECT_EQ(at_branch, all_of(fresh));
    ASSERT_EQ(PALPATE_OK, palpate_step(fresh, 40));
    EXPECT_EQ(first, all_of(fresh)) << "another world";
    ASSERT_EQ(PALPATE_OK, palpate_step(clone, 40));
    EXPECT_EQ(first, all_of(clone)) << "its clone";
}

TEST(Api, DamagedAndForeignStatesAreRefused) {
    Held world, other;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    const char* const stiffer[] = {"finger.index.material.young_kPa=90"};
    PalpateWorldDef def = with_settings({stiffer[0]});
    def.settings = stiffer;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, &def, &other.id)) << palpate_last_error();
    palpate_step(world, 20);
    std::vector<char> state = saved(world);
    const auto before = all_of(other);
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_restore(other, state.data(), std::int64_t(state.size())));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "other settings")) << palpate_last_error();
    state[state.size() / 2] ^= 1;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_restore(world, state.data(), std::int64_t(state.size())));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "damaged"));
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_restore(world, state.data(), 5));
    EXPECT_EQ(before, all_of(other));
}

TEST(Api, BuiltFromDescriptions) {
    PalpateFingerDef finger;
    PalpateObjectDef objects[2];
    PalpateSceneDef scene;
    palpate_default_finger_def(&finger, sizeof finger);
    for (auto& o : objects) palpate_default_object_def(&o, sizeof o);
    palpate_default_scene_def(&scene, sizeof scene);
    finger.name = "in\"dex\\";
    finger.pose[2] = 0.009;
    finger.elements = 120;
    objects[0].friction = 0.3;
    objects[1].shape = PALPATE_BOX;
    objects[1].dimensions[0] = objects[1].dimensions[1] = objects[1].dimensions[2] = 0.01;
    objects[1].pose[0] = 0.05;
    objects[1].pose[2] = 0.005;
    objects[1].mass = 0.004;
    scene.fingers = &finger;
    scene.finger_count = 1;
    scene.objects = objects;
    scene.object_count = 2;
    Held world;
    // All that is wrong is said at once, where it stands.
    objects[1].friction = -1;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_build(&scene, nullptr, &world.id));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "friction")) << palpate_last_error();
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "slashes, quotes")) << palpate_last_error();
    objects[1].friction = 0.3;
    finger.name = "index";
    ASSERT_EQ(PALPATE_OK, palpate_build(&scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step_to(world, 0.1)) << palpate_last_error();
    EXPECT_EQ(100, info_of(world).step);
    PalpateFingerState state{};
    state.size = sizeof state;
    std::int32_t index = -1;
    ASSERT_EQ(PALPATE_OK, palpate_find_finger(world, "index", &index));
    const double pose[7] = {0, 0, 0.006, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, index, pose));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 200));
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, index, &state)) << palpate_last_error();
    EXPECT_GT(state.force[2], 0.1);
    EXPECT_GT(state.contact_area, 1e-6);
    EXPECT_NEAR(state.centre[2], 0, 1e-3);
    // The torque is that of the net force at the centre of pressure, where forces are alike and pressed flat.
    const double arm[3] = {state.centre[0] - state.bone_pose[0], state.centre[1] - state.bone_pose[1],
                           state.centre[2] - state.bone_pose[2]};
    EXPECT_NEAR(state.torque[1], arm[2] * state.force[0] - arm[0] * state.force[2], 2e-4);
    // A struct of an older version is filled as far as it goes.
    struct {
        std::int32_t size, touching;
        double time, after;
    } older{16, 0, 0, -7};
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, index, reinterpret_cast<PalpateFingerState*>(&older)));
    EXPECT_EQ(state.time, older.time);
    EXPECT_EQ(-7, older.after);
    // A body goes where forces move it; the cube fell asleep on the table.
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_set_object_pose(world, 1, pose));
    char text[5000];
    ASSERT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_SCENE, 0, text, sizeof text, nullptr));
    Held again;
    EXPECT_EQ(PALPATE_OK, palpate_load_text(text, nullptr, &again.id)) << palpate_last_error();
}

TEST(Api, ManyWorldsAreTheSameAsEachAlone) {
    std::vector<Held> worlds(6);
    Held alone;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &alone.id)) << palpate_last_error();
    std::vector<PalpateWorld> ids;
    for (Held& w : worlds) {
        ASSERT_EQ(PALPATE_OK, palpate_clone(alone, &w.id)) << palpate_last_error();
        ids.push_back(w);
    }
    ASSERT_EQ(PALPATE_OK, palpate_step_many(ids.data(), 6, 80)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(alone, 80));
    for (PalpateWorld w : ids) EXPECT_EQ(all_of(alone), all_of(w));
    ids.push_back(ids[0]);
    const std::int32_t twice = palpate_step_many(ids.data(), 7, 1);
    EXPECT_TRUE(twice == PALPATE_OK || twice == PALPATE_ERROR_BUSY);
    ids.back() = 12345;
    EXPECT_EQ(PALPATE_ERROR_WORLD, palpate_step_many(ids.data(), 7, 1));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "world 6 of the list")) << palpate_last_error();
}

TEST(Api, ViewsFollowTheStepsInTheirPlace) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    PalpateView v{};
    v.size = sizeof v;
    ASSERT_EQ(PALPATE_OK, palpate_view(world, PALPATE_FORCES, 0, &v)) << palpate_last_error();
    const auto* force = static_cast<const double*>(v.data);
    const int samples = v.shape[0];
    ASSERT_GT(samples, 10);
    EXPECT_EQ(3, v.shape[1]);
    const auto sum = [&] {
        double z = 0;
        for (int s = 0; s < samples; ++s) z += force[3 * s + 2];
        return z;
    };
    EXPECT_EQ(0, sum());
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 80));
    PalpateFingerState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, 0, &state));
    EXPECT_GT(state.force[2], 0.05);
    EXPECT_NEAR(state.force[2], sum(), 1e-12);
    const std::int64_t generation = v.generation;
    ASSERT_EQ(PALPATE_OK, palpate_view(world, PALPATE_FORCES, 0, &v));
    EXPECT_EQ(force, v.data);
    EXPECT_GT(v.generation, generation);
    // Stretches: of a finger at rest 1, of one that is pressed not.
    const auto stretches = bytes_of(world, PALPATE_STRETCHES, 0);
    double smallest = 1;
    for (std::size_t i = 0; i < stretches.size(); i += 8) {
        double s;
        std::memcpy(&s, stretches.data() + i, 8);
        smallest = std::min(smallest, s);
    }
    EXPECT_LT(smallest, 0.99);
    EXPECT_GT(smallest, 0.1);
}

TEST(Api, ViewsFollowNewSettings) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    palpate_step(world, 20);
    const auto areas = bytes_of(world, PALPATE_AREAS, 0), rest = bytes_of(world, PALPATE_REST_NODES, 0);
    const char* const longer[] = {"finger.index.shape.length_mm=30"};
    const char* const another[] = {"finger.index.elements=300"};
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_set(world, another, 1));
    ASSERT_EQ(PALPATE_OK, palpate_set(world, longer, 1)) << palpate_last_error();
    EXPECT_NE(areas, bytes_of(world, PALPATE_AREAS, 0));
    EXPECT_NE(rest, bytes_of(world, PALPATE_REST_NODES, 0));
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 20)) << palpate_last_error();
}

TEST(Api, NothingIsAllocatedInAStep) {
    if (!PALPATE_COUNTS_ALLOCATIONS) GTEST_SKIP() << "a sanitiser has the allocator";
    Held world;
    const long at_first = allocations;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_GT(allocations, at_first) << "those of the library are not counted";
    all_of(world);
    bytes_of(world, PALPATE_STRETCHES, 0);
    ASSERT_EQ(PALPATE_OK, palpate_keep_snapshots(world, 1));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    const double pose[7] = {0.001, 0, 0.006, 1, 0, 0, 0};
    PalpateFingerState state{};
    state.size = sizeof state;
    const long before = allocations;
    for (int k = 0; k < 60; ++k) {
        palpate_set_finger_pose(world, 0, pose);
        palpate_step(world, 1);
        palpate_get_finger(world, 0, &state);
        palpate_read_snapshot(world, 0, &state, nullptr, nullptr, 0, nullptr);
    }
    EXPECT_EQ(0, allocations - before);
    EXPECT_GT(state.force[2], 0.05);
}

TEST(Api, OtherThreadsReadWholeSnapshots) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    PalpateFingerState none{};
    none.size = sizeof none;
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_read_snapshot(world, 0, &none, nullptr, nullptr, 0, nullptr));
    ASSERT_EQ(PALPATE_OK, palpate_keep_snapshots(world, 1));
    std::atomic<bool> done = false;
    std::atomic<long> reads = 0, wrong = 0, busy = 0;
    const auto reader = [&] {
        std::vector<double> positions(3000), forces(3000);
        while (!done) {
            PalpateFingerState state{};
            state.size = sizeof state;
            std::int32_t samples = 0;
            if (palpate_read_snapshot(world, 0, &state, positions.data(), forces.data(), 1000, &samples) !=
                PALPATE_OK) {
                ++wrong;
                continue;
            }
            double z = 0;
            for (int s = 0; s < samples; ++s) z += forces[3 * std::size_t(s) + 2];
            wrong += std::abs(z - state.force[2]) > 1e-12;
            ++reads;
            const double pose[7] = {0, 0, 0.006, 1, 0, 0, 0};
            palpate_set_finger_pose(world, 0, pose);
            PalpateFingerState mine{};
            mine.size = sizeof mine;
            busy += palpate_get_finger(world, 0, &mine) == PALPATE_ERROR_BUSY;
        }
    };
    std::thread a(reader), b(reader);
    std::int64_t steps = 0;
    for (int k = 0; k < 400; ++k) steps += palpate_step(world, 1) == PALPATE_OK;
    done = true;
    a.join(), b.join();
    EXPECT_EQ(0, wrong);
    EXPECT_GT(reads, 10);
    EXPECT_GT(steps, 0);  // others that read as owners may have been in the way
}

std::vector<std::int32_t> ids_of(PalpateWorld world, std::int32_t what) {
    std::int32_t count = 0;
    EXPECT_EQ(PALPATE_OK, palpate_list(world, what, nullptr, 0, &count)) << palpate_last_error();
    std::vector<std::int32_t> ids(static_cast<std::size_t>(count));
    EXPECT_EQ(PALPATE_OK, palpate_list(world, what, ids.data(), count, &count)) << palpate_last_error();
    return ids;
}
double force_on(PalpateWorld world, std::int32_t finger) {
    PalpateFingerState state{};
    state.size = sizeof state;
    EXPECT_EQ(PALPATE_OK, palpate_get_finger(world, finger, &state)) << palpate_last_error();
    return state.force[2];
}
PalpateFingerDef finger_at(const char* name, double x, double z) {
    PalpateFingerDef def;
    palpate_default_finger_def(&def, sizeof def);
    def.name = name;
    def.elements = 120;
    def.pose[0] = x, def.pose[2] = z;
    return def;
}

TEST(ApiParts, ComeAndGoWithoutOthersFeelingIt) {
    Held world, alone;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &alone.id));
    const auto same = [&](const char* when) {
        ASSERT_EQ(PALPATE_OK, palpate_step(world, 30)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_step(alone, 30));
        for (int field : {PALPATE_NODES, PALPATE_FORCES, PALPATE_TOUCHES})
            EXPECT_EQ(bytes_of(alone, field, 0), bytes_of(world, field, 0)) << when << ", field " << field;
    };
    same("as it began");
    // Another finger, far away, presses the table; the first one has the same bits as without it.
    const PalpateFingerDef def = finger_at("thumb", -0.06, 0.006), deep = finger_at("thumb", -0.06, -0.003);
    std::int32_t thumb = -1, again = -1, ball = -1;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_add_finger(world, &deep, &thumb)) << "it begins inside the table";
    PalpateFingerDef above = finger_at("thumb", -0.06, 0.010);
    ASSERT_EQ(PALPATE_OK, palpate_add_finger(world, &above, &thumb)) << palpate_last_error();
    EXPECT_EQ(1, thumb);
    EXPECT_EQ(2, info_of(world).finger_count);
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_add_finger(world, &above, &again)) << "there is one of that name";
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, thumb, def.pose)) << palpate_last_error();
    same("with a thumb");
    EXPECT_GT(force_on(world, thumb), 0.02);
    PalpateObjectDef sphere;
    palpate_default_object_def(&sphere, sizeof sphere);
    sphere.shape = PALPATE_SPHERE;
    sphere.dimensions[0] = 0.01;
    sphere.pose[1] = 0.1, sphere.pose[2] = 0.0105;
    sphere.mass = 0.01;
    ASSERT_EQ(PALPATE_OK, palpate_add_object(world, &sphere, &ball)) << palpate_last_error();
    same("with a ball");
    PalpateObjectState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_object(world, ball, &state));
    EXPECT_NEAR(0.01, state.pose[2], 1e-4) << "it lies on the table";
    // Gone: ids are errors, views of it may still be read, the next one has another id.
    PalpateView forces{};
    forces.size = sizeof forces;
    ASSERT_EQ(PALPATE_OK, palpate_view(world, PALPATE_FORCES, thumb, &forces));
    const double felt = force_on(world, thumb);
    ASSERT_EQ(PALPATE_OK, palpate_remove_finger(world, thumb)) << palpate_last_error();
    double sum = 0;
    for (int k = 0; k < forces.shape[0]; ++k) sum += static_cast<const double*>(forces.data)[3 * k + 2];
    EXPECT_NEAR(felt, sum, 1e-12);
    for (const std::int32_t result :
         {palpate_set_finger_pose(world, thumb, def.pose), palpate_remove_finger(world, thumb),
          palpate_release_finger(world, thumb), palpate_view(world, PALPATE_FORCES, thumb, &forces)})
        EXPECT_EQ(PALPATE_ERROR_ARGUMENT, result);
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "removed"));
    ASSERT_EQ(PALPATE_OK, palpate_remove_object(world, ball)) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_get_object(world, ball, &state));
    same("without them");
    ASSERT_EQ(PALPATE_OK, palpate_add_finger(world, &above, &again)) << palpate_last_error();
    EXPECT_NE(thumb, again);
    EXPECT_EQ((std::vector<std::int32_t>{0, again}), ids_of(world, PALPATE_FINGERS));
    same("with another thumb");
    EXPECT_EQ(PALPATE_OK, palpate_remove_finger(world, 0)) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_remove_finger(world, again)) << "a world has one finger at least";
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 5)) << palpate_last_error();
    std::int32_t found = -1;
    EXPECT_EQ(PALPATE_OK, palpate_find_finger(world, "thumb", &found));
    EXPECT_EQ(again, found);
}

TEST(ApiParts, GoWithTheirContactsAndFriction) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    EXPECT_GT(force_on(world, 0), 0.05);
    // What it presses on is taken away, and comes back: as before.
    std::int32_t table = -1;
    ASSERT_EQ(PALPATE_OK, palpate_find_object(world, "table", &table));
    ASSERT_EQ(PALPATE_OK, palpate_remove_object(world, table)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60)) << palpate_last_error();
    EXPECT_EQ(0, force_on(world, 0));
    PalpateObjectState cube{};
    cube.size = sizeof cube;
    ASSERT_EQ(PALPATE_OK, palpate_get_object(world, 1, &cube)) << palpate_last_error();
    EXPECT_LT(cube.pose[2], 0) << "nothing bears it: it falls";
    const double up[7] = {0, 0, 0.02, 1, 0, 0, 0}, down[7] = {0, 0, 0.006, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, 0, up));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    ASSERT_EQ(PALPATE_OK, palpate_remove_object(world, 1)) << palpate_last_error();
    PalpateObjectDef plane;
    palpate_default_object_def(&plane, sizeof plane);
    plane.name = "floor";
    plane.friction = 0.5;
    ASSERT_EQ(PALPATE_OK, palpate_add_object(world, &plane, &table)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, 0, down));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    EXPECT_GT(force_on(world, 0), 0.05);
}

TEST(ApiParts, ComeWhileOthersPressEachOtherDeeply) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    const double deep[7] = {0, 0, -0.004, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, 0, deep));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 200));
    std::int32_t thumb = -1;
    const PalpateFingerDef def = finger_at("thumb", -0.06, 0.010), inside = finger_at("middle", -0.12, -0.004);
    EXPECT_EQ(PALPATE_OK, palpate_add_finger(world, &def, &thumb)) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_add_finger(world, &inside, &thumb)) << "what is new must be outside";
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 5));
}

TEST(ApiParts, ThimblesArePutOnAndTakenOff) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    const auto before = bytes_of(world, PALPATE_NODES, 0);
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_set_thimble(world, 0, "no such kind", nullptr));
    ASSERT_EQ(PALPATE_OK, palpate_set_thimble(world, 0, "chinello-3rrs", nullptr)) << palpate_last_error();
    EXPECT_EQ(before, bytes_of(world, PALPATE_NODES, 0));
    const auto thimbles = ids_of(world, PALPATE_THIMBLES);
    ASSERT_EQ(1u, thimbles.size());
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 60));
    PalpateThimbleState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_thimble(world, thimbles[0], &state)) << palpate_last_error();
    EXPECT_EQ(0, state.finger);
    EXPECT_EQ(1, state.matches);
    ASSERT_EQ(PALPATE_OK, palpate_set_thimble(world, 0, nullptr, nullptr)) << palpate_last_error();
    EXPECT_EQ(0u, ids_of(world, PALPATE_THIMBLES).size());
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_get_thimble(world, thimbles[0], &state));
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 5));
}

TEST(ApiParts, AreThereInCopiesStatesAndTexts) {
    Held world, clone, text_world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    std::int32_t thumb = -1;
    const PalpateFingerDef def = finger_at("thumb", -0.06, 0.010);
    ASSERT_EQ(PALPATE_OK, palpate_add_finger(world, &def, &thumb)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_remove_finger(world, 0)) << palpate_last_error();
    const double pose[7] = {-0.06, 0, 0.006, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, thumb, pose));
    const auto state = saved(world);
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &clone.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 40));
    ASSERT_EQ(PALPATE_OK, palpate_step(clone, 40));
    EXPECT_EQ(bytes_of(world, PALPATE_NODES, thumb), bytes_of(clone, PALPATE_NODES, thumb));
    EXPECT_GT(force_on(clone, thumb), 0.02);
    // Its text and settings make a world that the state fits.
    char text[5000], settings[1000];
    ASSERT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_SCENE, 0, text, sizeof text, nullptr));
    ASSERT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_SETTINGS, 0, settings, sizeof settings, nullptr));
    const std::vector<const char*> lines{settings};
    const PalpateWorldDef with = with_settings(lines);
    ASSERT_EQ(PALPATE_OK, palpate_load_text(text, &with, &text_world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_restore(text_world, state.data(), std::int64_t(state.size())))
        << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(text_world, 40));
    EXPECT_EQ(bytes_of(world, PALPATE_NODES, thumb), bytes_of(text_world, PALPATE_NODES, 0));
    // Settings change while it runs, what is recorded stays as it is.
    const char* const softer[] = {"finger.thumb.material.young_kPa=20"};
    ASSERT_EQ(PALPATE_OK, palpate_set(world, softer, 1)) << palpate_last_error();
    Folder folder;
    ASSERT_EQ(PALPATE_ERROR_STATE, palpate_record(world, (folder.path / "run").c_str()));
    Held fresh;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &fresh.id));
    ASSERT_EQ(PALPATE_OK, palpate_record(fresh, (folder.path / "run").c_str())) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_add_finger(fresh, &def, &thumb));
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_set_thimble(fresh, 0, nullptr, nullptr));
}

TEST(ApiParts, ForeverComingAndGoingFillsNoMemory) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    PalpateObjectDef sphere;
    palpate_default_object_def(&sphere, sizeof sphere);
    sphere.shape = PALPATE_SPHERE;
    sphere.dimensions[0] = 0.01;
    sphere.pose[2] = 0.05;
    std::int32_t last = -1;
    std::int64_t text_size = 0;
    const void* place = nullptr;
    ASSERT_EQ(PALPATE_OK, palpate_keep_snapshots(world, 1));
    for (int k = 0; k < 40; ++k) {
        std::int32_t ball = -1;
        ASSERT_EQ(PALPATE_OK, palpate_add_object(world, &sphere, &ball)) << palpate_last_error();
        EXPECT_NE(last, ball);
        last = ball;
        PalpateView v{};
        v.size = sizeof v;
        ASSERT_EQ(PALPATE_OK, palpate_view(world, PALPATE_OBJECT_POSES, -1, &v));
        EXPECT_TRUE(k < 3 || place == v.data) << "memory of views is used again";
        if (k > 1) place = v.data;
        ASSERT_EQ(PALPATE_OK, palpate_step(world, 1));
        ASSERT_EQ(PALPATE_OK, palpate_remove_object(world, ball)) << palpate_last_error();
        std::int64_t size = 0;
        palpate_get_text(world, PALPATE_TEXT_SCENE, 0, nullptr, 0, &size);
        EXPECT_TRUE(k == 0 || text_size == size);
        text_size = size;
    }
}

TEST(ApiParts, OthersMaySetAndReadMeanwhile) {
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_keep_snapshots(world, 1));
    std::atomic<std::int32_t> newest{0};
    std::atomic<bool> done{false};
    std::atomic<long> set{0}, refused{0}, wrong{0};
    const auto other = [&] {
        const double pose[7] = {-0.06, 0, 0.008, 1, 0, 0, 0};
        std::vector<double> forces(3000);
        while (!done) {
            const std::int32_t id = newest;
            ++(palpate_set_finger_pose(world, id, pose) == PALPATE_OK ? set : refused);
            palpate_release_object(world, 0);
            PalpateFingerState state{};
            state.size = sizeof state;
            std::int32_t samples = 0;
            if (palpate_read_snapshot(world, id, &state, nullptr, forces.data(), 1000, &samples) != PALPATE_OK)
                continue;
            double z = 0;
            for (int k = 0; k < samples; ++k) z += forces[3 * std::size_t(k) + 2];
            wrong += std::abs(z - state.force[2]) > 1e-12;
        }
    };
    std::thread a(other), b(other);
    const PalpateFingerDef def = finger_at("thumb", -0.06, 0.010);
    for (int k = 0; k < 12; ++k) {
        std::int32_t thumb = -1;
        ASSERT_EQ(PALPATE_OK, palpate_add_finger(world, &def, &thumb)) << palpate_last_error();
        newest = thumb;
        ASSERT_EQ(PALPATE_OK, palpate_step(world, 5)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_remove_finger(world, thumb)) << palpate_last_error();
    }
    done = true;
    a.join(), b.join();
    EXPECT_EQ(0, wrong);
    EXPECT_GT(set, 0);
    EXPECT_GT(refused, 0);
}

/// Numbers that nobody should pass.
struct Chance {
    std::mt19937 random{7};
    std::vector<PalpateWorld> worlds;

    int below(int n) { return int(random() % unsigned(n)); }
    PalpateWorld world() {
        switch (below(6)) {
            case 0:
                return std::int64_t(random()) << 32 | random();
            case 1:
                return std::int64_t(below(5)) - 2;
            default:
                return worlds[std::size_t(below(int(worlds.size())))];
        }
    }
    std::int32_t index() {
        static constexpr std::int32_t odd[] = {-1, 0, 0, 0, 1, 2, 100, -100000, INT32_MAX, INT32_MIN};
        return odd[below(10)];
    }
    double number() {
        static constexpr double odd[] = {0, 1, -1, 0.005, 0.01, 1e-300, 1e300, NAN, INFINITY, -INFINITY, 5e-324};
        return below(3) ? 0.01 * (random() % 1000) / 1000.0 : odd[below(11)];
    }
};

/// One call at random; true where it said how it went in the way that all do.
bool random_call(Chance& c) {
    double numbers[7];
    for (double& x : numbers) x = c.number();
    const double* pose = c.below(5) ? numbers : nullptr;
    const PalpateWorld w = c.world();
    const std::int32_t i = c.index();
    std::int32_t result = PALPATE_OK;
    std::int64_t needed = 0;
    std::int32_t found = 0;
    char text[300];
    static std::vector<double> room(100000);
    switch (c.below(27)) {
        case 0:
            result = palpate_set_finger_pose(w, i, pose);
            break;
        case 1:
            result = palpate_set_object_pose(w, i, pose);
            break;
        case 2:
            result = palpate_release_finger(w, i);
            break;
        case 3:
            result = palpate_release_object(w, i);
            break;
        case 4:
            result = palpate_step(w, c.below(40) ? (c.below(2) ? i : INT32_MAX) : 1);
            break;
        case 5:
            result = palpate_step_to(w, c.below(10) ? NAN : 1e300);
            break;
        case 6: {
            PalpateView v{};
            v.size = c.below(4) ? int(sizeof v) : i;
            result = palpate_view(w, c.below(30) - 3, i, c.below(9) && v.size <= int(sizeof v) ? &v : nullptr);
            break;
        }
        case 7: {
            PalpateFingerState s{};
            s.size = c.below(4) ? int(sizeof s) : std::min(i, int(sizeof s));
            result = palpate_get_finger(w, i, c.below(9) ? &s : nullptr);
            break;
        }
        case 8: {
            PalpateObjectState s{};
            s.size = c.below(4) ? int(sizeof s) : std::min(i, int(sizeof s));
            result = palpate_get_object(w, i, c.below(9) ? &s : nullptr);
            break;
        }
        case 9: {
            PalpateThimbleState s{};
            s.size = c.below(4) ? int(sizeof s) : std::min(i, int(sizeof s));
            result = palpate_get_thimble(w, i, c.below(9) ? &s : nullptr);
            break;
        }
        case 10: {
            PalpateFingerState s{};
            s.size = sizeof s;
            result = palpate_read_snapshot(w, i, c.below(9) ? &s : nullptr, c.below(2) ? room.data() : nullptr,
                                           room.data() + 50000, c.below(2) ? 10000 : i, c.below(2) ? &found : nullptr);
            break;
        }
        case 11:
            result = palpate_keep_snapshots(w, i);
            break;
        case 12:
            result = palpate_get_text(w, c.below(12) - 2, i, c.below(5) ? text : nullptr, c.below(2) ? 300 : c.below(3),
                                      c.below(2) ? &needed : nullptr);
            break;
        case 13:
            result = palpate_find_finger(w, c.below(4) ? "index" : nullptr, c.below(4) ? &found : nullptr);
            break;
        case 14:
            result = palpate_find_object(w, c.below(4) ? "nothing" : "table", c.below(4) ? &found : nullptr);
            break;
        case 15:
            result = palpate_restore(w, c.below(4) ? room.data() : nullptr, c.below(2) ? 1000 : i);
            break;
        case 16:
            result = palpate_step_many(&w, c.below(3) ? 1 : i == INT32_MAX || i <= 0 ? i : 1, c.below(9) ? i : 1);
            break;
        case 17:
            result = palpate_get_replay(w, nullptr);
            break;
        case 18: {
            const char* const settings[] = {nullptr, "nonsense"};
            result = c.below(200) ? PALPATE_OK : palpate_set(w, c.below(2) ? settings : nullptr, i);
            break;
        }
        case 19: {
            std::int32_t ids[4];
            result = palpate_list(w, c.below(5) - 1, c.below(4) ? ids : nullptr, c.below(2) ? 4 : std::min(i, 4),
                                  c.below(2) ? &found : nullptr);
            break;
        }
        case 20: {  // mostly refused: a good one takes milliseconds
            PalpateObjectDef def;
            palpate_default_object_def(&def, sizeof def);
            def.shape = c.below(8) - 1;
            def.name = c.below(2) ? "table" : nullptr;
            std::copy(numbers, numbers + 3, def.dimensions);
            std::copy(numbers, numbers + 7, def.pose);
            if (c.below(3)) def.size = i;
            result = palpate_add_object(w, c.below(6) && c.below(300) ? nullptr : &def, c.below(3) ? &found : nullptr);
            break;
        }
        case 21: {
            PalpateFingerDef def;
            palpate_default_finger_def(&def, sizeof def);
            def.elements = 60;
            def.device = c.below(2) ? "no such kind" : nullptr;
            std::copy(numbers, numbers + 7, def.pose);
            if (c.below(3)) def.size = i;
            result = palpate_add_finger(w, c.below(6) && c.below(300) ? nullptr : &def, c.below(3) ? &found : nullptr);
            break;
        }
        case 22:
            if (i != 0 || c.below(500) == 0) result = palpate_remove_finger(w, i);
            break;
        case 23:
            if (i != 0 || c.below(500) == 0) result = palpate_remove_object(w, i);
            break;
        case 24:
            if (i != 0 || c.below(300) == 0)
                result = palpate_set_thimble(w, i,
                                             c.below(2)   ? "chinello-3rrs"
                                             : c.below(2) ? "a\"b"
                                                          : nullptr,
                                             c.below(2) ? "plane" : nullptr);
            break;
        case 25:
            result = c.below(4) ? palpate_keep_frames(w, c.number())
                                : palpate_log_about(c.below(2) ? &found : nullptr, nullptr);
            break;
        default:
            result = palpate_end_recording(w);
            break;
    }
    return result == PALPATE_OK || (result < 0 && result > PALPATE_ERROR_INTERNAL && *palpate_last_error());
}

TEST(Api, RandomCallsGiveCodes) {
    const char* given = std::getenv("PALPATE_API_CALLS");
    const long calls = given ? std::atol(given) : 20000;
    Chance chance;
    Held world, freed;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &freed.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_destroy(freed));
    EXPECT_EQ(PALPATE_ERROR_WORLD, palpate_destroy(freed));
    chance.worlds = {world, world, world, freed, 0};
    for (long k = 0; k < calls; ++k) ASSERT_TRUE(random_call(chance)) << "call " << k << ": " << palpate_last_error();
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 1)) << palpate_last_error();
}

TEST(Api, WrongScenesSayEverythingAtOnce) {
    PalpateWorld world = 77;
    EXPECT_EQ(PALPATE_ERROR_SCENE,
              palpate_load_text("duration_s = -1\n[[object]]\nkind = \"ball\"\n", nullptr, &world));
    EXPECT_EQ(77, world);
    const std::string said = palpate_last_error();
    EXPECT_NE(std::string::npos, said.find("scene:1:")) << said;
    EXPECT_NE(std::string::npos, said.find("[[finger]]")) << said;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_load("no such scene", nullptr, &world));
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_load_text("this is = = no TOML", nullptr, &world));
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_load(nullptr, nullptr, &world));
    PalpateWorldDef def{};
    def.size = 1;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_load_text(small_scene, &def, &world));
}

/// What programs that were compiled earlier rely on: new fields come at the end alone.
TEST(Api, StructsKeepTheirLayout) {
    EXPECT_EQ(32u, sizeof(PalpateWorldDef));
    EXPECT_EQ(104u, sizeof(PalpateFingerDef));
    EXPECT_EQ(128u, sizeof(PalpateObjectDef));
    EXPECT_EQ(80u, sizeof(PalpateSceneDef));
    EXPECT_EQ(56u, sizeof(PalpateWorldInfo));
    EXPECT_EQ(40u, sizeof(PalpateView));
    EXPECT_EQ(256u, sizeof(PalpateFingerState));
    EXPECT_EQ(160u, sizeof(PalpateObjectState));
    EXPECT_EQ(224u, sizeof(PalpateThimbleState));
    EXPECT_EQ(32u, sizeof(PalpateReplayState));
    EXPECT_EQ(24u, offsetof(PalpateView, generation));
    EXPECT_EQ(128u, offsetof(PalpateFingerState, force));
    EXPECT_EQ(40u, offsetof(PalpateFingerDef, pose));
}

TEST(Api, TheLibraryShowsWhatItsHeaderDeclares) {
    const Outcome nm = shell("nm -D --defined-only --format=posix " + std::string(PALPATE_LIBRARY));
    ASSERT_EQ(0, nm.code) << nm.out;
    std::set<std::string> shown, declared;
    std::istringstream lines(nm.out);
    for (std::string line; std::getline(lines, line);) {
        const std::string name = line.substr(0, line.find_first_of(" @"));
        if (name != "PALPATE_0") shown.insert(name);
    }
    std::ifstream header(std::string(PALPATE_SOURCE_DIR) + "/scenes/api/palpate.h");
    for (std::string line; std::getline(header, line);) {
        const auto at = line.find(" palpate_"), end = line.find('(', at);
        if (line.starts_with("PALPATE_API") && at != std::string::npos && end != std::string::npos)
            declared.insert(line.substr(at + 1, end - at - 1));
        else if (line.starts_with("PALPATE_API") && line.find("*palpate_") != std::string::npos)
            declared.insert(line.substr(line.find("palpate_"), line.find('(') - line.find("palpate_")));
    }
    EXPECT_EQ(declared, shown);
    EXPECT_GT(shown.size(), 30u);
}

}  // namespace
