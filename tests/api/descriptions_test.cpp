// What a description says reaches the world as it is: poses in every direction, and numbers in every country. What
// is recorded and put back is nobody else's.

#include <unistd.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <random>

#include "../comma_locale.h"
#include "api_support.h"

namespace {

/// Distance of two rotations as quaternions, of which either sign is the same.
double apart(const double* a, const double* b) {
    double same = 0, opposite = 0;
    for (int k = 3; k < 7; ++k) same += std::pow(a[k] - b[k], 2), opposite += std::pow(a[k] + b[k], 2);
    return std::sqrt(std::min(same, opposite));
}

TEST(ApiDescriptions, PosesKeepTheirRotation) {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::vector<std::array<double, 4>> rotations;
    for (int k = 0; k < 60; ++k) rotations.push_back({normal(random), normal(random), normal(random), normal(random)});
    // Pitched by 90 degrees up and down, where roll and yaw are about one axis; and nearly so.
    for (const double pitch : {0.25 * M_PI, -0.25 * M_PI, 0.25 * M_PI - 1e-9, -0.25 * M_PI + 1e-7, 0.25 * M_PI - 1e-4})
        for (const double turn : {0.0, 0.3, 1.0, 2.5, -1.2}) {
            const double cy = std::cos(turn), sy = std::sin(turn), cp = std::cos(pitch), sp = std::sin(pitch);
            rotations.push_back({cy * cp, -sy * sp, cy * sp, sy * cp});
        }
    rotations.push_back({0.5, -0.5, 0.5, 0.5});
    rotations.push_back({0.5, 0.5, -0.5, 0.5});
    std::vector<PalpateObjectDef> objects(rotations.size());
    for (std::size_t k = 0; k < objects.size(); ++k) {
        palpate_default_object_def(&objects[k], sizeof objects[k]);
        objects[k].shape = PALPATE_BOX;
        for (double& d : objects[k].dimensions) d = 0.01;
        objects[k].pose[0] = 0.05 * double(k + 1);
        double length = 0;
        for (double v : rotations[k]) length += v * v;
        for (int i = 0; i < 4; ++i) objects[k].pose[3 + i] = rotations[k][std::size_t(i)] / std::sqrt(length);
    }
    PalpateFingerDef finger;
    palpate_default_finger_def(&finger, sizeof finger);
    finger.name = "index", finger.elements = 120;
    finger.pose[2] = 0.05, finger.pose[3] = finger.pose[6] = finger.pose[5] = 0.5, finger.pose[4] = -0.5;
    PalpateSceneDef scene;
    palpate_default_scene_def(&scene, sizeof scene);
    scene.object_count = std::int32_t(objects.size()), scene.objects = objects.data();
    scene.finger_count = 1, scene.fingers = &finger;
    Held world;
    ASSERT_EQ(PALPATE_OK, palpate_build(&scene, nullptr, &world.id)) << palpate_last_error();
    for (std::size_t k = 0; k < objects.size(); ++k) {
        PalpateObjectState state{};
        state.size = sizeof state;
        ASSERT_EQ(PALPATE_OK, palpate_get_object(world, std::int32_t(k), &state)) << palpate_last_error();
        EXPECT_LT(apart(state.pose, objects[k].pose), 1e-12) << "object " << k;
    }
    PalpateFingerState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 1));
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, 0, &state)) << palpate_last_error();
    EXPECT_LT(apart(state.tracked_pose, finger.pose), 1e-12);
}

/// A described scene with a soft object, a mesh and a setting that is no whole number, some steps on, with meshes that
/// nothing was kept of.
std::vector<std::vector<char>> described_world(const std::filesystem::path& cache) {
    std::filesystem::create_directories(cache);
    setenv("XDG_CACHE_HOME", cache.c_str(), 1);
    PalpateFingerDef finger;
    palpate_default_finger_def(&finger, sizeof finger);
    finger.name = "index", finger.elements = 120, finger.young_modulus = 12345.678;
    finger.device = "chinello-3rrs";
    finger.pose[0] = 0.0012345, finger.pose[2] = 0.0079;
    PalpateObjectDef objects[2];
    for (auto& o : objects) palpate_default_object_def(&o, sizeof o);
    objects[0].name = "slab", objects[0].shape = PALPATE_BOX, objects[0].friction = 0.55;
    objects[0].dimensions[0] = 0.0505, objects[0].dimensions[1] = 0.0565, objects[0].dimensions[2] = 0.0185;
    objects[0].pose[2] = -0.00925, objects[0].young_modulus = 6500, objects[0].elements = 300;
    const std::string mug = scene_file("mug.obj");
    objects[1].name = "mug", objects[1].shape = PALPATE_MESH, objects[1].file = mug.c_str();
    objects[1].pose[0] = 0.2, objects[1].pose[2] = 0.06, objects[1].mass = 0.25;
    PalpateSceneDef scene;
    palpate_default_scene_def(&scene, sizeof scene);
    scene.dt = 0.0025;
    scene.more = "[limits]\nlow = 0.6\nhigh = 1.4\n";
    scene.object_count = 2, scene.objects = objects;
    scene.finger_count = 1, scene.fingers = &finger;
    const char* settings[] = {"finger.index.material.young_kPa=15.5"};
    PalpateWorldDef def;
    palpate_default_world_def(&def, sizeof def);
    def.settings = settings, def.setting_count = 1;
    Held world;
    EXPECT_EQ(PALPATE_OK, palpate_build(&scene, &def, &world.id)) << palpate_last_error();
    if (world.id == 0) return {};
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 20)) << palpate_last_error();
    std::vector<std::vector<char>> all = all_of(world);
    all.push_back(bytes_of(world, PALPATE_STRETCHES, 0));
    std::int64_t size = 0;
    EXPECT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_SCENE, 0, nullptr, 0, &size));
    std::vector<char> text(std::size_t(size) + 1);
    EXPECT_EQ(PALPATE_OK, palpate_get_text(world, PALPATE_TEXT_SCENE, 0, text.data(), size, &size));
    all.push_back(text);
    return all;
}

TEST(ApiDescriptions, AreTheSameWhereTheDecimalPointIsAComma) {
    const Folder scratch;
    const char* before = std::getenv("XDG_CACHE_HOME");
    const std::string kept = before ? before : "";
    const auto plain = described_world(scratch.path / "plain");
    {
        const palpate::testing::CommaLocale comma;
        EXPECT_EQ(plain, described_world(scratch.path / "comma"));
        if (!comma.c_too)
            std::printf("no locale with a comma is installed, nor can one be compiled: C++'s alone was tried\n");
    }
    before ? setenv("XDG_CACHE_HOME", kept.c_str(), 1) : unsetenv("XDG_CACHE_HOME");
}

std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

TEST(ApiRecords, ReplaceNothingOfAnotherKindAndNothingThatIsBeingRecorded) {
    const Folder scratch;
    const std::string scene = (scratch.path / "mine.toml").string(), file = (scratch.path / "r.palpate").string();
    std::ofstream(scene) << small_scene;
    Held world, other;
    ASSERT_EQ(PALPATE_OK, palpate_load(scene.c_str(), nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_load(scene.c_str(), nullptr, &other.id)) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_FILE, palpate_record(world, scene.c_str()));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "it would be lost")) << palpate_last_error();
    EXPECT_EQ(small_scene, text_of(scene));
    ASSERT_EQ(PALPATE_OK, palpate_record(world, file.c_str())) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 5));
    EXPECT_EQ(PALPATE_ERROR_FILE, palpate_record(other, file.c_str()));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "another run")) << palpate_last_error();
    // A forked process has the file, and leaves it alone.
    const pid_t child = fork();
    if (child == 0) {
        palpate_end_recording(world);
        _exit(0);
    }
    int status = 0;
    ASSERT_EQ(child, waitpid(child, &status, 0));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 5));
    ASSERT_EQ(PALPATE_OK, palpate_end_recording(world)) << palpate_last_error();
    EXPECT_EQ(0, shell(std::string(PALPATE_PROGRAM) + " replay " + file).code);
    EXPECT_EQ(PALPATE_OK, palpate_record(other, file.c_str())) << "it is a recording that has ended";
}

TEST(ApiRecords, StatesOfOtherStepsAreRefused) {
    Held world, slower, coarser;
    const char *slow[] = {"dt_ms=2"}, *coarse[] = {"solver.preset=fast"};
    PalpateWorldDef def;
    palpate_default_world_def(&def, sizeof def);
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, nullptr, &world.id)) << palpate_last_error();
    def.setting_count = 1, def.settings = slow;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, &def, &slower.id)) << palpate_last_error();
    def.settings = coarse;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(small_scene, &def, &coarser.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 10));
    const std::vector<char> state = saved(world);
    for (const PalpateWorld into : {slower.id, coarser.id}) {
        EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_restore(into, state.data(), std::int64_t(state.size())));
        EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "other settings")) << palpate_last_error();
    }
    EXPECT_EQ(PALPATE_OK, palpate_restore(world, state.data(), std::int64_t(state.size()))) << palpate_last_error();
}

/// A cube of 20 mm as an OBJ file, larger by a factor.
void write_cube(const std::filesystem::path& file, double factor) {
    std::ofstream out(file);
    for (int k = 0; k < 8; ++k)
        out << "v " << factor * (k & 1 ? 10 : -10) << " " << factor * (k & 2 ? 10 : -10) << " "
            << factor * (k & 4 ? 10 : -10) << "\n";
    out << "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
}

TEST(ApiRecords, FilesThatChangeDoNotChangeALivingWorld) {
    const Folder scratch;
    const std::string file = (scratch.path / "cube.obj").string();
    write_cube(file, 1);
    PalpateFingerDef finger;
    palpate_default_finger_def(&finger, sizeof finger);
    finger.name = "index", finger.elements = 120, finger.pose[2] = 0.03;
    PalpateObjectDef cube, box;
    palpate_default_object_def(&cube, sizeof cube);
    palpate_default_object_def(&box, sizeof box);
    cube.name = "cube", cube.shape = PALPATE_MESH, cube.file = file.c_str();
    box.name = "box", box.shape = PALPATE_BOX, box.pose[0] = 0.3;
    for (double& d : box.dimensions) d = 0.01;
    PalpateSceneDef scene;
    palpate_default_scene_def(&scene, sizeof scene);
    scene.object_count = 1, scene.objects = &cube, scene.finger_count = 1, scene.fingers = &finger;
    Held world, larger;
    ASSERT_EQ(PALPATE_OK, palpate_build(&scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 3));
    const std::vector<char> state = saved(world);
    const char* softer[] = {"finger.index.material.young_kPa=16"};
    write_cube(file, 1.1);
    std::int32_t id = -1;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_set(world, softer, 1));
    EXPECT_NE(nullptr, std::strstr(palpate_last_error(), "has changed since the world was made"))
        << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_add_object(world, &box, &id));
    EXPECT_EQ(PALPATE_OK, palpate_step(world, 1)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_build(&scene, nullptr, &larger.id)) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_restore(larger, state.data(), std::int64_t(state.size())));
    write_cube(file, 1);
    EXPECT_EQ(PALPATE_OK, palpate_set(world, softer, 1)) << palpate_last_error();
    EXPECT_EQ(PALPATE_OK, palpate_add_object(world, &box, &id)) << palpate_last_error();
}

}  // namespace
