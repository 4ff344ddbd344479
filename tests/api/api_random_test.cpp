// Hostile calls of libpalpate.so: an error code each time, never a crash.

#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>
#include <sstream>
#include <thread>

#include "api_support.h"

namespace {

/// Worlds that are freed and made anew, of all threads.
struct Copies {
    std::array<std::atomic<PalpateWorld>, 4> worlds{};
    ~Copies() {
        for (PalpateWorld w : worlds) palpate_destroy(w);
    }
};
/// Even while another thread is in a call of it.
void free_copy(PalpateWorld w) {
    while (palpate_destroy(w) == PALPATE_ERROR_BUSY) std::this_thread::yield();
}

/// Numbers that nobody should pass.
struct Chance {
    std::mt19937 random{7};
    std::vector<PalpateWorld> worlds;

    std::shared_ptr<Copies> copies = std::make_shared<Copies>();
    std::array<std::pair<PalpateWorld, std::int32_t>, 2> fingers{}, objects{};  ///< that were added, of some world
    PalpateWorld copy() { return copies->worlds[std::size_t(below(4))]; }
    void keep(PalpateWorld made) { free_copy(copies->worlds[std::size_t(below(4))].exchange(made)); }

    /// Worlds do not grow for ever: who comes takes the place of another one.
    template <class Parts, class Remove>
    void instead_of(Parts& parts, const typename Parts::value_type& added, Remove remove) {
        auto& place = parts[std::size_t(below(int(parts.size())))];
        if (place.first != 0) remove(place.first, place.second);
        place = added;
    }

    int below(int n) { return int(random() % unsigned(n)); }
    PalpateWorld world() {
        switch (below(6)) {
            case 0:
                return std::int64_t(random()) << 32 | random();
            case 1:
                return below(2) ? std::int64_t(below(5)) - 2 : copy();
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

/// Steps that take no time to speak of.
std::int32_t few(std::int32_t n) { return n == 100 ? 3 : n; }

/// Poses and steps.
std::int32_t steer(Chance& c, int which, PalpateWorld w, std::int32_t i) {
    double numbers[7];
    for (double& x : numbers) x = c.number();
    const double* pose = c.below(5) ? numbers : nullptr;
    std::int32_t result = PALPATE_OK;
    switch (which) {
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
            result = palpate_step(w, c.below(40) ? (c.below(2) ? few(i) : INT32_MAX) : 1);
            break;
        default:
            result = palpate_step_to(w, c.below(10) ? NAN : 1e300);
            break;
    }
    return result;
}

/// Views, states, texts.
std::int32_t look(Chance& c, int which, PalpateWorld w, std::int32_t i) {
    thread_local std::vector<double> room(100000);
    std::int32_t result = PALPATE_OK, found = 0;
    std::int64_t needed = 0;
    char text[300];
    switch (which) {
        case 6: {
            PalpateView v{};
            v.size = c.below(4) ? int(sizeof v) : i;
            result = palpate_view(w, c.below(PALPATE_FIELD_COUNT + 6) - 3, i,
                                  c.below(9) && v.size <= int(sizeof v) ? &v : nullptr);
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
            result = palpate_step_many(&w, c.below(3) ? 1 : i == INT32_MAX || i <= 0 ? i : 1, c.below(9) ? few(i) : 1);
            break;
        default:
            result = palpate_get_replay(w, nullptr);
            break;
    }
    return result;
}

/// Settings, and what comes and goes.
std::int32_t change(Chance& c, int which, PalpateWorld w, std::int32_t i) {
    double numbers[7];
    for (double& x : numbers) x = c.number();
    std::int32_t result = PALPATE_OK, found = 0;
    switch (which) {
        case 18: {
            const char* const settings[] = {nullptr, "nonsense"};
            result = palpate_set(w, c.below(2) ? settings : nullptr, i);
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
            if (c.below(3) == 0) def.young_modulus = c.number(), def.fixed_depth = c.number(), def.elements = 30;
            std::copy(numbers, numbers + 3, def.dimensions);
            std::copy(numbers, numbers + 7, def.pose);
            if (c.below(3)) def.size = i;
            result = palpate_add_object(w, c.below(6) && c.below(300) ? nullptr : &def, c.below(3) ? &found : nullptr);
            if (result == PALPATE_OK) c.instead_of(c.objects, {w, found}, palpate_remove_object);
            break;
        }
        case 21: {
            PalpateFingerDef def;
            palpate_default_finger_def(&def, sizeof def);
            def.elements = 120;  // its mesh is there: another one would take most of the time
            def.device = c.below(2) ? "no such kind" : nullptr;
            std::copy(numbers, numbers + 7, def.pose);
            if (c.below(3)) def.size = i;
            result = palpate_add_finger(w, c.below(6) && c.below(300) ? nullptr : &def, c.below(3) ? &found : nullptr);
            if (result == PALPATE_OK) c.instead_of(c.fingers, {w, found}, palpate_remove_finger);
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
    return result;
}

/// Whole worlds: made from what is wrong, copied, saved, put back, recorded, freed while others hold their ids.
std::int32_t make(Chance& c, int which, PalpateWorld w, std::int32_t i) {
    thread_local std::vector<char> state(1000000);
    thread_local std::int64_t size = 0;
    PalpateWorld made = 0;
    std::int32_t result = PALPATE_OK;
    switch (which) {
        case 27:
            if (c.below(200) == 0 && (result = palpate_clone(w, &made)) == PALPATE_OK) c.keep(made);
            if (c.below(4) == 0) result = palpate_clone(w, nullptr);
            break;
        case 28:  // of a copy, so that one world goes on to the end; whoever has its id finds nothing from then on
            result = c.below(20) ? palpate_get_info(w, nullptr) : palpate_destroy(c.copy());
            break;
        case 29:
            if (c.below(20) == 0)
                size = (result = palpate_save(w, state.data(), std::int64_t(state.size()), &size)) ? 0 : size;
            else
                result = palpate_save(w, c.below(3) ? state.data() : nullptr, std::min(i, 1000000),
                                      c.below(2) ? &made : nullptr);
            break;
        case 30: {  // cut short, or with a bit turned round
            if (c.below(10)) return palpate_restore(w, c.below(9) ? state.data() : nullptr, std::min(i, 1000000));
            char& bit = state[std::size_t(c.below(int(std::max<std::int64_t>(1, size))))];
            const char was = bit;
            if (c.below(2)) bit = char(bit ^ (1 << c.below(8)));
            result = palpate_restore(w, state.data(), size);
            bit = was;
            break;
        }
        case 31: {
            // None has a finger: to mesh one takes most of the time.
            static const char* const texts[] = {"",
                                                "[[fingers]]",
                                                "dt_ms = nan",
                                                "[[object]]\nkind = \"box\"",
                                                "\xff\xfe",
                                                "duration_s = 7\nsolver = -1",
                                                "[[[["};
            PalpateWorldDef def;
            palpate_default_world_def(&def, sizeof def);
            if (c.below(3) == 0) def.threads = i;
            if (c.below(3) == 0) def.setting_count = i;
            result = palpate_load_text(c.below(8) ? texts[c.below(7)] : nullptr, c.below(2) ? &def : nullptr,
                                       c.below(9) ? &made : nullptr);
            break;
        }
        case 32: {
            PalpateSceneDef def;
            palpate_default_scene_def(&def, sizeof def);
            def.dt = c.number(), def.gravity[1] = c.number();
            def.finger_count = std::min(i, 0), def.object_count = c.below(2) ? i : 0;
            if (c.below(3) == 0) def.more = "[[finger";
            result = palpate_build(c.below(9) ? &def : nullptr, nullptr, c.below(9) ? &made : nullptr);
            break;
        }
        case 33:
            result = c.below(2) ? palpate_load_replay(c.below(2) ? "/dev/null" : nullptr, i, nullptr, &made)
                                : palpate_record(w, c.below(2) ? "/no such folder/run" : nullptr);
            break;
        default:
            result = palpate_get_info(w, nullptr);
            break;
    }
    return result;
}

/// One call at random; true where it said how it went in the way that all do.
bool random_call(Chance& c) {
    const PalpateWorld w = c.world();
    const std::int32_t i = c.index();
    const int which = c.below(34);
    const std::int32_t result = which < 6    ? steer(c, which, w, i)
                                : which < 18 ? look(c, which, w, i)
                                : which < 27 ? change(c, which, w, i)
                                             : make(c, which, w, i);
    return result == PALPATE_OK || (result < 0 && result > PALPATE_ERROR_INTERNAL && *palpate_last_error());
}

long calls_wanted() {
    const char* given = std::getenv("PALPATE_API_CALLS");
    return given ? std::atol(given) : 20000;
}

/// A small world of all kinds of things, and a freed one.
class RandomCalls : public ::testing::Test {
  protected:
    void SetUp() override {
        // A soft object and a thimble, so that every field is there.
        const std::string scene = std::string(small_scene) + R"(device = { kind = "chinello-3rrs" }
[[object]]
name = "pad"
kind = "box"
size_mm = [12, 12, 6]
position_mm = [-60, 0, 3]
soft = { young_kPa = 10, elements = 40, fixed = "bottom" }
)";
        ASSERT_EQ(PALPATE_OK, palpate_load_text(scene.c_str(), nullptr, &world.id)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_clone(world, &freed.id)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_destroy(freed));
        EXPECT_EQ(PALPATE_ERROR_WORLD, palpate_destroy(freed));
        chance.worlds = {world, world, world, freed, 0};
    }
    void TearDown() override { EXPECT_EQ(PALPATE_OK, palpate_step(world, 1)) << palpate_last_error(); }

    Chance chance;
    Held world, freed;
};

TEST_F(RandomCalls, GiveCodes) {
    const long calls = calls_wanted();
    for (long k = 0; k < calls; ++k) ASSERT_TRUE(random_call(chance)) << "call " << k << ": " << palpate_last_error();
}

TEST_F(RandomCalls, GiveCodesToSeveralThreadsOfTheSameWorlds) {
    const long calls = calls_wanted() / 4;
    std::atomic<int> wrong{0};
    std::vector<std::thread> threads;
    for (unsigned seed = 1; seed <= 4; ++seed)
        threads.emplace_back([&, seed] {
            Chance own = chance;  // the copies are shared
            own.random.seed(seed);
            for (long k = 0; k < calls; ++k) wrong += !random_call(own);
        });
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(0, wrong);
}

}  // namespace
