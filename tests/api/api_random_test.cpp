// Hostile calls of libpalpate.so: an error code each time, never a crash.

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <sstream>
#include <thread>

#include "api_support.h"

namespace {

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
            result = palpate_step(w, c.below(40) ? (c.below(2) ? i : INT32_MAX) : 1);
            break;
        default:
            result = palpate_step_to(w, c.below(10) ? NAN : 1e300);
            break;
    }
    return result;
}

/// Views, states, texts.
std::int32_t look(Chance& c, int which, PalpateWorld w, std::int32_t i) {
    static std::vector<double> room(100000);
    std::int32_t result = PALPATE_OK, found = 0;
    std::int64_t needed = 0;
    char text[300];
    switch (which) {
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
    return result;
}

/// One call at random; true where it said how it went in the way that all do.
bool random_call(Chance& c) {
    const PalpateWorld w = c.world();
    const std::int32_t i = c.index();
    const int which = c.below(27);
    const std::int32_t result = which < 6    ? steer(c, which, w, i)
                                : which < 18 ? look(c, which, w, i)
                                             : change(c, which, w, i);
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

}  // namespace
