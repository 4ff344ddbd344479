// Objects through libpalpate.so: what presses on each, and what a soft one is like where it is touched.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "api_support.h"

namespace {

const char* const cushion_scene = R"(
dt_ms = 2
[solver]
preset = "balanced"
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[object]]
name = "cushion"
kind = "box"
size_mm = [24, 24, 12]
position_mm = [60, 0, 6]
friction = 0.5
soft = { young_kPa = 10, elements = 300, fixed = "bottom" }
[[finger]]
name = "index"
elements = 120
track = [ { t_s = 0, position_mm = [0, 0, 10] }, { t_s = 0.05, position_mm = [0, 0, 6] } ]
[[finger]]
name = "thumb"
elements = 120
track = [ { t_s = 0, position_mm = [60, 0, 22] }, { t_s = 0.05, position_mm = [60, 0, 17] } ]
)";

template <class Number>
std::vector<Number> numbers_of(PalpateWorld world, std::int32_t field, std::int32_t index) {
    const std::vector<char> bytes = bytes_of(world, field, index);
    std::vector<Number> out(bytes.size() / sizeof(Number));
    std::memcpy(out.data(), bytes.data(), bytes.size());
    return out;
}

double distance(const double* a, const double* b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

class SoftObjects : public ::testing::Test {
  protected:
    void SetUp() override {
        ASSERT_EQ(PALPATE_OK, palpate_load_text(cushion_scene, nullptr, &world.id)) << palpate_last_error();
        ASSERT_EQ(PALPATE_OK, palpate_find_object(world, "cushion", &cushion));
        ASSERT_EQ(PALPATE_OK, palpate_find_object(world, "table", &table));
        ASSERT_EQ(PALPATE_OK, palpate_find_finger(world, "index", &index));
        ASSERT_EQ(PALPATE_OK, palpate_find_finger(world, "thumb", &thumb));
    }
    std::vector<double> of(std::int32_t field, std::int32_t id) const { return numbers_of<double>(world, field, id); }

    Held world;
    std::int32_t cushion = -1, table = -1, index = -1, thumb = -1;
};

TEST_F(SoftObjects, AreAtRestAndThenGiveWay) {
    const std::vector<double> rest = of(PALPATE_SOFT_REST_NODES, cushion), begin = of(PALPATE_SOFT_NODES, cushion);
    const auto nodes = numbers_of<std::int32_t>(world, PALPATE_SOFT_SAMPLE_NODES, cushion);
    ASSERT_EQ(rest.size(), begin.size());
    for (std::size_t i = 0; i < rest.size(); i += 3) {
        const double expected[3] = {rest[i] + 0.060, rest[i + 1], rest[i + 2] + 0.006};
        ASSERT_LT(distance(&begin[i], expected), 1e-12);
    }
    const auto samples_are_nodes = [&] {
        const std::vector<double> places = of(PALPATE_SOFT_POSITIONS, cushion), all = of(PALPATE_SOFT_NODES, cushion);
        ASSERT_EQ(3 * nodes.size(), places.size());
        for (std::size_t s = 0; s < nodes.size(); ++s)
            ASSERT_LT(distance(&places[3 * s], &all[3 * std::size_t(nodes[s])]), 1e-9) << "sample " << s;
    };
    samples_are_nodes();  // before the first step, too
    PalpateView live{};
    live.size = sizeof live;
    ASSERT_EQ(PALPATE_OK, palpate_view(world, PALPATE_SOFT_POSITIONS, cushion, &live));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 50)) << palpate_last_error();
    samples_are_nodes();
    const std::vector<double> now = of(PALPATE_SOFT_POSITIONS, cushion);
    EXPECT_EQ(0, std::memcmp(live.data, now.data(), sizeof(double) * now.size()));  // in its place, the newest
    const std::vector<double> all = of(PALPATE_SOFT_NODES, cushion);
    double dent = 0;
    for (std::size_t i = 0; i < all.size(); i += 3) dent = std::max(dent, distance(&all[i], &begin[i]));
    EXPECT_GT(dent, 2e-4);
    const std::vector<double> stretches = of(PALPATE_SOFT_STRETCHES, cushion);
    EXPECT_LT(*std::min_element(stretches.begin(), stretches.end()), 0.99);
}

TEST_F(SoftObjects, ForcesOnThemAreThoseOnFingersTurnedRound) {
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 50)) << palpate_last_error();
    const std::vector<double> net = of(PALPATE_NET_FORCES, -1), on_objects = of(PALPATE_OBJECT_FORCES, -1);
    const std::vector<double> by_index = of(PALPATE_FORCES_BY_OBJECT, index),
                              by_thumb = of(PALPATE_FORCES_BY_OBJECT, thumb),
                              samples = of(PALPATE_SOFT_FORCES, cushion);
    ASSERT_EQ(6u, on_objects.size());
    ASSERT_EQ(6u, by_index.size());
    PalpateObjectState state;
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_object(world, cushion, &state));
    EXPECT_EQ(1, state.soft);
    EXPECT_EQ(0, state.moves);
    EXPECT_GT(state.touching, 0);
    EXPECT_GT(state.contact_area, 1e-6);
    EXPECT_LT(state.force[2], -0.02);
    for (std::size_t d = 0; d < 3; ++d) {
        // Rows: table, cushion; index, thumb.
        EXPECT_EQ(0, by_index[3 + d]);
        EXPECT_EQ(0, by_thumb[d]);
        EXPECT_NEAR(net[d], by_index[d], 1e-12);
        EXPECT_NEAR(net[3 + d], by_thumb[3 + d], 1e-12);
        EXPECT_NEAR(-by_index[d], on_objects[d], 1e-12);
        EXPECT_NEAR(-by_thumb[3 + d], on_objects[3 + d], 1e-12);
        EXPECT_EQ(on_objects[3 + d], state.force[d]);
        double sum = 0;
        for (std::size_t i = d; i < samples.size(); i += 3) sum += samples[i];
        EXPECT_NEAR(state.force[d], sum, 1e-12);
    }
    ASSERT_EQ(PALPATE_OK, palpate_get_object(world, table, &state));
    EXPECT_EQ(0, state.soft);
    EXPECT_LT(state.force[2], -0.05);
}

TEST_F(SoftObjects, RigidOnesHaveNoPlacesOfTheirOwn) {
    PalpateView view{};
    view.size = sizeof view;
    EXPECT_EQ(PALPATE_ERROR_STATE, palpate_view(world, PALPATE_SOFT_POSITIONS, table, &view));
    EXPECT_NE(std::string(palpate_last_error()).find("rigid"), std::string::npos) << palpate_last_error();
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_view(world, PALPATE_SOFT_POSITIONS, 77, &view));
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_view(world, PALPATE_OBJECT_FORCES, 0, &view));
}

TEST_F(SoftObjects, ComeAndGo) {
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 50)) << palpate_last_error();
    const std::size_t rows = of(PALPATE_FORCES_BY_OBJECT, thumb).size();
    PalpateObjectDef def;
    palpate_default_object_def(&def, sizeof def);
    def.shape = PALPATE_BOX;
    def.name = "pad";
    def.dimensions[0] = def.dimensions[1] = def.dimensions[2] = 0.02;
    def.pose[0] = -0.06, def.pose[2] = 0.01;
    def.young_modulus = 2e4;
    def.elements = 200;
    std::int32_t pad = -1;
    ASSERT_EQ(PALPATE_OK, palpate_add_object(world, &def, &pad)) << palpate_last_error();
    EXPECT_EQ(rows + 3, of(PALPATE_FORCES_BY_OBJECT, thumb).size());
    const double above[7] = {-0.06, 0, 0.0245, 1, 0, 0, 0};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, index, above));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 150));
    EXPECT_LT(of(PALPATE_OBJECT_FORCES, -1)[8], -0.02);
    // A branch point, and a copy.
    const std::vector<char> state = saved(world);
    Held copy;
    ASSERT_EQ(PALPATE_OK, palpate_clone(world, &copy.id)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    const auto once = bytes_of(world, PALPATE_SOFT_NODES, pad);
    ASSERT_EQ(PALPATE_OK, palpate_step(copy, 20));
    EXPECT_EQ(once, bytes_of(copy, PALPATE_SOFT_NODES, pad));
    ASSERT_EQ(PALPATE_OK, palpate_restore(world, state.data(), std::int64_t(state.size()))) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 20));
    EXPECT_EQ(once, bytes_of(world, PALPATE_SOFT_NODES, pad));
    ASSERT_EQ(PALPATE_OK, palpate_remove_object(world, pad)) << palpate_last_error();
    EXPECT_EQ(rows, of(PALPATE_FORCES_BY_OBJECT, thumb).size());
    PalpateView view{};
    view.size = sizeof view;
    EXPECT_EQ(PALPATE_ERROR_ARGUMENT, palpate_view(world, PALPATE_SOFT_NODES, pad, &view));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 5));
    def.mass = 0.01;
    EXPECT_EQ(PALPATE_ERROR_SCENE, palpate_add_object(world, &def, &pad));
    EXPECT_NE(std::string(palpate_last_error()).find("soft"), std::string::npos) << palpate_last_error();
}

}  // namespace
