// libpalpate.so as its users see it: palpate.h and nothing else of palpate.

#include <gtest/gtest.h>
#include <palpate/palpate.h>

#include <atomic>
#include <chrono>
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

#include "api_support.h"

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

/// Where an object stands that nothing moves is a setting as others are; where a body lies is none.
TEST(Api, SettingsMoveWhatNothingElseMoves) {
    const char* const higher[] = {"object.table.position_mm=[0,0,0.4]", "object.table.friction=0",
                                  "object.cube.position_mm=[80,0,5.4]"};
    Held changed, fresh;
    for (Held* world : {&changed, &fresh})
        ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world->id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(changed, 80));
    ASSERT_EQ(PALPATE_OK, palpate_set(changed, higher, 3)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_set(fresh, higher, 1)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_set(fresh, higher + 1, 1)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(changed, 300));
    ASSERT_EQ(PALPATE_OK, palpate_step(fresh, 380));
    PalpateFingerState a{}, b{};
    a.size = b.size = sizeof a;
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(changed, 0, &a));
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(fresh, 0, &b));
    EXPECT_GT(b.force[2], 0.1);
    EXPECT_NEAR(a.force[2], b.force[2], 2e-3 * b.force[2]);
    PalpateObjectState cube{};
    cube.size = sizeof cube;
    ASSERT_EQ(PALPATE_OK, palpate_get_object(changed, 1, &cube));
    EXPECT_NEAR(cube.pose[0], 0.060, 1e-4);
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
    // Others that read as owners are in the way at times, and for long where they lose the processor meanwhile.
    std::int64_t steps = 0;
    const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while ((steps < 200 || reads < 20) && std::chrono::steady_clock::now() < late) {
        const int code = palpate_step(world, 1);
        steps += code == PALPATE_OK;
        if (code == PALPATE_ERROR_BUSY) std::this_thread::yield();
    }
    done = true;
    a.join(), b.join();
    EXPECT_EQ(0, wrong);
    EXPECT_GT(reads, 10);
    EXPECT_GE(steps, 200);
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
    EXPECT_EQ(168u, sizeof(PalpateObjectDef));
    EXPECT_EQ(80u, sizeof(PalpateSceneDef));
    EXPECT_EQ(56u, sizeof(PalpateWorldInfo));
    EXPECT_EQ(40u, sizeof(PalpateView));
    EXPECT_EQ(256u, sizeof(PalpateFingerState));
    EXPECT_EQ(176u, sizeof(PalpateObjectState));
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
