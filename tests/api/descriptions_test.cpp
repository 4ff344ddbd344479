// What a description says reaches the world as it is, in every country.

#include "../comma_locale.h"
#include "api_support.h"

namespace {

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

}  // namespace
