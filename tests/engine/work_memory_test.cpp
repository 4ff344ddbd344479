// Work memory that chunks take turns with: nothing that a step finds may depend on whose it was before.

#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <limits>

#include "engine/skin/chunks/fields.h"
#include "engine/step.h"
#include "tests/support.h"

namespace palpate {
namespace {

struct WorkCase {
    const char* name;
    bool single_precision;
    int stiffness_steps;
    Material material;
    bool touching = false;  ///< two of them meet: chunks then have what bodies need, and memory of their own
};

/// Many fingers on a table, of whom every third stays away from it.
SceneSpec many_fingers(const WorkCase& test) {
    SceneSpec spec;
    spec.solver.newton_iterations = 2;
    spec.solver.stiffness_steps = test.stiffness_steps;
    spec.solver.tolerance = 1e-4, spec.solver.multiplier_tolerance = 1e-3;
    FingerSpec f;
    f.mesh = testing::block_mesh(5, 4, 4, 0.003);
    f.has_limits = true;
    f.limit_low = {0.8}, f.limit_high = {1.2};
    f.single_precision = test.single_precision;
    f.material = test.material;
    for (int i = 0; i < 88; ++i) {
        f.name = "finger" + std::to_string(i);
        f.start.position = {0.03 * i, 0, i % 3 == 2 ? 0.05 : 0.0065};
        spec.fingers.push_back(f);
    }
    if (test.touching) {
        spec.fingers_touch = true;
        spec.fingers[5].start = {spec.fingers[2].start.position - Vec3<double>{0, 0, 0.0125}, {0, 1, 0, 0}};
    }
    spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.4});
    return spec;
}

template <class T>
void fill_work(SkinChunk<T>& memory, T value) {
    for_each_field(memory, [&](auto& array, const Field& f) {
        if (f.role == Role::work) std::fill(array.begin(), array.end(), value);
    });
    std::fill(memory.scratch.changed_columns.begin(), memory.scratch.changed_columns.end(), 0);
    std::fill(memory.scratch.candidate_limits.begin(), memory.scratch.candidate_limits.end(), all_lanes);
}

/// Presses, slides, lifts and presses again; what others may have left in the memory is filled with `left_over`.
void press(World& world, int threads, double left_over) {
    Threads pool(threads);
    for (int k = 0; k < 40; ++k) {
        for (WorkMemory& m : world.chunks.work) {
            for (auto& c : m.doubles) fill_work(c, left_over);
            for (auto& c : m.floats) fill_work(c, float(left_over));
        }
        for (std::size_t i = 0; i < world.skins.size(); ++i) {
            TrackerPose& t = *world.tracker_poses.find(world.couplings[i].tracker);
            t.incoming.pose = world.skins[i].start;
            const double deep = k < 15 ? k / 12.0 : k < 25 ? 0 : (k - 25) / 10.0;
            if (i % 3 != 2) t.incoming.pose.position.z -= (1.5e-3 + 1e-5 * double(i)) * deep;
            if (i == 5) t.incoming.pose.position.z += 1e-4 * k;
            t.incoming.pose.position.x += i % 3 != 2 ? 2e-5 * k : 0;
            t.incoming.time = world.time;
            t.incoming.valid = true;
        }
        step(world, pool);
    }
}

class WorkMemoryOf : public ::testing::TestWithParam<WorkCase> {};
INSTANTIATE_TEST_SUITE_P(WorkMemory, WorkMemoryOf,
                         ::testing::Values(WorkCase{"Float", true, 1, Material::corotational},
                                           WorkCase{"FloatKept", true, 16, Material::corotational},
                                           WorkCase{"Double", false, 1, Material::corotational},
                                           WorkCase{"DoubleKept", false, 16, Material::corotational},
                                           WorkCase{"NeoHookean", false, 16, Material::neo_hookean},
                                           WorkCase{"Touching", true, 16, Material::corotational, true}),
                         [](const auto& i) { return i.param.name; });

TEST_P(WorkMemoryOf, SharedOrNotAStepIsTheSameBits) {
    const oneapi::tbb::global_control four_threads(oneapi::tbb::global_control::max_allowed_parallelism, 4);
    const SceneSpec spec = many_fingers(GetParam());
    World own = build_world(spec);
    const std::size_t shared_bytes = skin_memory_bytes(own);
    ASSERT_FALSE(own.chunks.work.empty());
    own.chunks.work.clear();
    own.chunks.for_each([](auto& c) {
        c.shared_work = -1;
        resize_fields(c);
    });
    EXPECT_LT(double(shared_bytes), 0.9 * double(skin_memory_bytes(own)));
    press(own, 2, 0);
    double force = 0;
    for (const ContactSurface& c : own.contact_surfaces) force += c.normal_force;
    EXPECT_GT(force, 5);
    EXPECT_EQ(own.contact_surfaces[5].normal_force > 0, GetParam().touching);
    for (const int threads : {1, 3}) {
        World shared = build_world(spec);
        press(shared, threads, threads == 1 ? 0.5 : std::numeric_limits<double>::quiet_NaN());
        for (std::size_t i = 0; i < own.contact_surfaces.size(); ++i) {
            const ContactSurface &a = own.contact_surfaces[i], &b = shared.contact_surfaces[i];
            ASSERT_EQ(a.normal_force, b.normal_force) << i << ", " << threads << " threads";
            for (std::size_t s = 0; s < a.force.size(); ++s)
                for (int d = 0; d < 3; ++d) ASSERT_EQ(a.force[s][d], b.force[s][d]) << i;
            EXPECT_EQ(skin_status(own, own.skins.owner(i)).newton_iterations,
                      skin_status(shared, own.skins.owner(i)).newton_iterations);
        }
    }
}

/// Where few fingers are, each chunk has its own, and no more.
TEST(WorkMemory, FewFingersShareNone) {
    SceneSpec spec = many_fingers({"", true, 1, Material::corotational});
    spec.fingers.resize(8);
    EXPECT_TRUE(build_world(spec).chunks.work.empty());
}

/// What is of tissue is solved together with the fingers on it, which then need memory of their own.
TEST(WorkMemory, ManyFingersBesideTissueShareNone) {
    SceneSpec spec = many_fingers({"", true, 16, Material::corotational});
    ObjectSpec slab;
    slab.name = "slab";
    slab.shape = {ShapeKind::box, {0.0075, 0.006, 0.006}};
    slab.pose = {spec.fingers[4].start.position - Vec3<double>{0, 0, 0.0125}, {0, 1, 0, 0}};
    slab.tissue = spec.fingers[0];
    slab.tissue->single_precision = false;
    spec.objects = {slab};
    World world = build_world(spec);
    press(world, 2, 0);
    EXPECT_TRUE(world.chunks.work.empty());
    EXPECT_GT(world.soft.all[0].surface.normal_force, 0.01);
}

/// How many chunks have the rest data of the first one.
long sharers(const World& world) { return world.chunks.floats[0].rest.shape_gradients.sharers(); }

TEST(RestMemory, FingersThatAreAlikeShareItAndAStepIsTheSameBits) {
    const WorkCase test{"Float", true, 16, Material::corotational};
    SceneSpec spec = many_fingers(test);
    World shared = build_world(spec), own = build_world(spec);
    EXPECT_GT(sharers(shared), 4);
    for (auto& c : own.chunks.floats) own_rest(c);
    EXPECT_EQ(sharers(own), 1);
    EXPECT_LT(double(skin_memory_bytes(shared)), 0.9 * double(skin_memory_bytes(own)));
    press(shared, 2, 0);
    press(own, 2, 0);
    for (std::size_t i = 0; i < own.contact_surfaces.size(); ++i)
        ASSERT_EQ(own.contact_surfaces[i].normal_force, shared.contact_surfaces[i].normal_force) << i;
    // What writes into one of them leaves the others as they were.
    const float before = shared.chunks.floats[1].rest.mu[0];
    own_rest(shared.chunks.floats[0]);
    shared.chunks.floats[0].rest.mu[0] = 2 * before;
    EXPECT_EQ(shared.chunks.floats[1].rest.mu[0], before);
    spec.fingers[40].young_modulus = {31e3};
    EXPECT_EQ(sharers(build_world(spec)), 1);
}

}  // namespace
}  // namespace palpate
