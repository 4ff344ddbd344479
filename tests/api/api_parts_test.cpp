// What comes and goes while a world lives, as users of libpalpate.so see it.

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <sstream>
#include <thread>

#include "api_support.h"

namespace {

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

/// In static equilibrium a body is held by who holds it: that is not forgotten where something else comes.
TEST(ApiParts, WhatFingersHoldWithoutInertiaIsHeldWhileOthersCome) {
    const char* const scene =
        "dt_ms = 4\n[solver]\npreset = \"balanced\"\nstatic = true\n"
        "[[object]]\nname = \"floor\"\nkind = \"box\"\nsize_mm = [60, 60, 10]\nposition_mm = [0, 0, -5]\nfriction = "
        "0.5\n"
        "[[object]]\nname = \"ball\"\nkind = \"sphere\"\nradius_mm = 10\nmass_g = 10\nposition_mm = [0, 0, 10]\n"
        "friction = 0.5\n[[finger]]\nname = \"index\"\nfinger = \"index-median\"\nelements = 300\n"
        "track = [ { t_s = 0, position_mm = [0, 0, 32] }, { t_s = 0.05, position_mm = [0, 0, 27] }, "
        "{ t_s = 0.15, position_mm = [6, 0, 27] } ]\n";
    Held world, alone;
    ASSERT_EQ(PALPATE_OK, palpate_load_text(scene, nullptr, &world.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 22));
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &alone.id));
    PalpateObjectDef block;
    palpate_default_object_def(&block, sizeof block);
    block.shape = PALPATE_BOX;
    block.dimensions[0] = block.dimensions[1] = block.dimensions[2] = 0.02;
    block.pose[1] = 2, block.mass = 0.01;
    std::int32_t added = -1;
    ASSERT_EQ(PALPATE_OK, palpate_add_object(world, &block, &added)) << palpate_last_error();
    for (int k = 0; k < 10; ++k) {
        ASSERT_EQ(PALPATE_OK, palpate_step(world, 1));
        ASSERT_EQ(PALPATE_OK, palpate_step(alone, 1));
        for (int field : {PALPATE_NODES, PALPATE_FORCES})
            EXPECT_EQ(bytes_of(alone, field, 0), bytes_of(world, field, 0)) << k << ", field " << field;
    }
    EXPECT_LT(0.05, force_on(world, 0));
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

}  // namespace
