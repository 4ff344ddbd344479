// Tissue that is linear about an earlier place: right to first order, never near a limit, and as far off as it says.

#include <gtest/gtest.h>

#include <random>

#include "engine/build.h"
#include "engine/skin/solve/evaluate.h"
#include "engine/step.h"
#include "meshes/patches.h"
#include "scenes/run/simulation.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::block_mesh;
using testing::make_chunk;

void move_free_nodes(SkinChunk<double>& c, const std::vector<double>& way, double share) {
    for (std::size_t u = 0; u + 2 < c.topology->unknowns.size(); ++u)
        for (int d = 0; d < 3; ++d) {
            const std::size_t i = std::size_t(3 * c.topology->unknowns[u] + d);
            c.state.position[i] += share * way[i];
        }
}
std::vector<double> random_way(const SkinChunk<double>& c, unsigned seed, double size) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> u(-size, size);
    std::vector<double> way(c.state.position.size());
    for (double& x : way) x = u(random);
    return way;
}

/// A deformed pad, linearised where it is.
SkinChunk<double> linearised_pad() {
    auto c = make_chunk<double>(block_mesh(3, 2, 2, 0.004), Pose<double>::identity(), {.low = 0.3, .high = 2});
    allocate_linear_tissue(c);
    testing::ChunkOptions o{.low = 0.3, .high = 2};
    const TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    SkinParameters p;
    p.mesh = &mesh;
    p.young_modulus = {o.young};
    p.has_limits = true;
    p.limit_low = {o.low}, p.limit_high = {o.high};
    set_lane(c, 0, 0, p, Pose<double>::identity());
    move_free_nodes(c, random_way(c, 1, 3e-4), 1);
    c.linear.bound[0] = 1e9;
    c.linear.due_lanes = 1;
    evaluate<double>(c, SolverSettings{}, 0.0);
    EXPECT_EQ(c.linear.kept_lanes, 1u);
    return c;
}

struct Tissue {
    double energy;
    LaneArray<double> gradient, blocks;
};
/// Tissue alone, as it is or linear; the rest of a step's terms are the same for both.
Tissue tissue_of(SkinChunk<double>& c, bool linear) {
    c.linear_lanes = linear ? 1 : 0;
    c.linear.kept_lanes = 1;
    std::fill(c.scratch.gradient.begin(), c.scratch.gradient.end(), 0.0);
    std::fill(c.scratch.blocks.begin(), c.scratch.blocks.end(), 0.0);
    Evaluation<double> out;
    detail::add_tissue<detail::Want::forces_and_matrix>(c, 1.0, out);
    EXPECT_EQ(c.linear_lanes, linear ? 1u : 0u);
    return {out.energy, c.scratch.gradient, c.scratch.blocks};
}
double largest_difference(const LaneArray<double>& a, const LaneArray<double>& b) {
    double most = 0;
    for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
    return most;
}
double largest(const LaneArray<double>& a) { return largest_difference(a, LaneArray<double>(a.size(), 0.0)); }

TEST(LinearTissue, IsTheTissueItselfWhereItWasLinearisedAndTurnsWithTheBone) {
    auto c = linearised_pad();
    const auto start = c.state.position;
    for (double angle : {0.0, 1.2}) {
        const Pose<double> turn{{0.004, -0.002, 0.007},
                                {std::cos(angle / 2), 0.6 * std::sin(angle / 2), 0.8 * std::sin(angle / 2), 0}};
        for (int i = 0; i < c.topology->node_count; ++i)
            store_vec3<double>(&c.state.position[std::size_t(3 * i)],
                               transform(turn, load_vec3<double>(&start[std::size_t(3 * i)])));
        detail::store_pose<double>(c.state.bone.data(), turn);
        const Tissue full = tissue_of(c, false), linear = tissue_of(c, true);
        EXPECT_NEAR(linear.energy, full.energy, 1e-12 * full.energy);
        EXPECT_LT(largest_difference(linear.gradient, full.gradient), 1e-11 * largest(full.gradient));
        EXPECT_LT(largest_difference(linear.blocks, full.blocks), 1e-11 * largest(full.blocks));
    }
}

TEST(LinearTissue, IsOffByTheSquareOfTheMotionAndSaysHowMuch) {
    auto c = linearised_pad();
    const auto start = c.state.position;
    for (unsigned seed : {2u, 3u, 4u}) {
        const auto way = random_way(c, seed, 2e-4);
        double off[2], estimate = 0;
        for (int k = 0; k < 2; ++k) {
            c.state.position = start;
            move_free_nodes(c, way, k ? 0.5 : 1);
            const Tissue full = tissue_of(c, false), linear = tissue_of(c, true);
            off[k] = largest_difference(linear.gradient, full.gradient);
            if (k == 0) {
                double all = 0;
                for (int i = 0; i < c.topology->node_count; ++i)
                    all += norm(load_vec3<double>(&linear.gradient[std::size_t(3 * i)]) -
                                load_vec3<double>(&full.gradient[std::size_t(3 * i)]));
                estimate = c.linear.error[0];
                // All nodes' error, before skin gives way to it; contact forces are off by less.
                EXPECT_LT(all, 10 * estimate);
                EXPECT_GT(all, estimate);
            }
        }
        EXPECT_GT(off[0], 0);
        EXPECT_NEAR(off[0] / off[1], 4, 0.6);
    }
}

TEST(LinearTissue, HasTheGradientOfItsEnergyAndTheHessianOfItsGradient) {
    auto c = linearised_pad();
    move_free_nodes(c, random_way(c, 5, 3e-4), 1);
    const Tissue here = tissue_of(c, true);
    const double h = 1e-6;
    for (int node : {c.topology->unknowns[0], c.topology->unknowns[7]}) {
        const int block = c.topology->diagonal_block[std::size_t(node)];
        for (int d = 0; d < 3; ++d) {
            double& x = c.state.position[std::size_t(3 * node + d)];
            const double middle = x;
            x = middle + h;
            const Tissue after = tissue_of(c, true);
            x = middle - h;
            const Tissue before = tissue_of(c, true);
            x = middle;
            EXPECT_NEAR((after.energy - before.energy) / (2 * h), here.gradient[std::size_t(3 * node + d)],
                        1e-6 * largest(here.gradient));
            for (int k = 0; k < 3; ++k)
                EXPECT_NEAR(
                    (after.gradient[std::size_t(3 * node + k)] - before.gradient[std::size_t(3 * node + k)]) / (2 * h),
                    here.blocks[std::size_t(9 * block + 3 * k + d)], 1e-7 * largest(here.blocks));
        }
    }
}

struct Pressed {
    std::vector<Vec3<double>> forces;
    std::vector<int> limited;
    std::vector<bool> linear;
    double violation = 0;
};
/// A finger pressed on a table, rolled and led over it, and lifted, again and again; `depth` beyond the first touch.
Pressed press(double detail_error, double depth, bool single, bool limits_of_patches = false) {
    SceneSpec spec;
    spec.solver.dt = 0.002;
    spec.solver.newton_iterations = 30;
    spec.solver.detail_error = detail_error;
    FingerSpec f;
    f.name = "finger";
    f.mesh = block_mesh(4, 3, 2, 0.004);
    if (limits_of_patches) make_patches(f.mesh, 5), make_limit_patches(f.mesh, 1000, 5);
    f.has_limits = true;
    f.limit_low = 0.7, f.limit_high = 1.3;
    f.single_precision = single;
    f.start.position = {0, 0, 0.0045};
    spec.fingers.push_back(std::move(f));
    spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
    World world = build_world(spec);
    Pressed p;
    Threads threads(1);
    for (int k = 0; k < 1500; ++k) {
        const double t = 0.002 * k;
        Pose<double> pose = world.skins[0].start;
        pose.position.z -= (0.0005 + depth) * std::clamp(2 * std::sin(3 * t), 0.0, 1.0);
        pose.position.x += 0.002 * std::sin(2 * t);
        const double angle = 0.1 * std::sin(4 * t);
        pose.rotation = {std::cos(angle / 2), std::sin(angle / 2), 0, 0};
        world.tracker_poses[0].incoming = {pose, world.time, true};
        step(world, threads);
        const SkinStatus& status = skin_status(world, world.skins.owner(0));
        EXPECT_FALSE(status.reset);
        p.forces.push_back(world.contact_surfaces[0].total);
        p.limited.push_back(status.limited_elements);
        p.violation = std::max(p.violation, status.limit_violation);
        p.linear.push_back(single ? world.chunks.floats[0].linear_lanes : world.chunks.doubles[0].linear_lanes);
    }
    return p;
}

class LinearTissueIn : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(BothPrecisions, LinearTissueIn, ::testing::Bool(),
                         [](const auto& i) { return std::string(i.param ? "Float" : "Double"); });

TEST_P(LinearTissueIn, KeepsForcesWithinTheErrorAllowedWithoutAJump) {
    const Pressed full = press(0, 0.0012, GetParam());
    for (double allowed : {0.01, 0.1}) {
        const Pressed some = press(allowed, 0.0012, GetParam());
        double most = 0, off = 0, jump = 0;
        Vec3<double> last{0, 0, 0};
        int linear = 0;
        for (std::size_t k = 0; k < full.forces.size(); ++k) {
            const Vec3<double> difference = some.forces[k] - full.forces[k];
            most = std::max(most, norm(full.forces[k]));
            off = std::max(off, norm(difference));
            jump = std::max(jump, norm(difference - last));
            last = difference;
            linear += some.linear[k];
        }
        EXPECT_GT(most, 0.5);
        EXPECT_GT(linear, 600) << "of 1,500 steps, with " << allowed;
        EXPECT_GT(off, 0);
        EXPECT_LT(off, allowed * most);
        EXPECT_LT(jump, allowed * most);
    }
}

void expect_strain_limits(bool single, bool of_patches) {
    const Pressed full = press(0, 0.0035, single, of_patches), some = press(0.01, 0.0035, single, of_patches);
    int limited = 0, both = 0;
    double most = 0, off = 0;
    for (std::size_t k = 0; k < some.forces.size(); ++k) {
        limited += some.limited[k] > 0;
        both += some.linear[k] && some.limited[k] > 0;
        most = std::max(most, norm(full.forces[k]));
        off = std::max(off, norm(some.forces[k] - full.forces[k]));
    }
    EXPECT_GT(limited, 200);
    EXPECT_GT(both, 100) << "steps of linear tissue with elements at limits";
    EXPECT_LT(some.violation, full.violation + 1e-3);
    EXPECT_LT(off, 0.01 * most);
}

TEST_P(LinearTissueIn, KeepsStrainLimits) { expect_strain_limits(GetParam(), false); }

TEST_P(LinearTissueIn, KeepsStrainLimitsOfPatches) { expect_strain_limits(GetParam(), true); }

TEST(LinearTissue, CostsNoMemoryWhereItIsNotAllowedOrNotPossible) {
    auto bytes = [](double error, Material material) {
        SceneSpec spec;
        spec.solver.detail_error = error;
        FingerSpec f;
        f.mesh = block_mesh(4, 3, 2, 0.004);
        f.material = material;
        spec.fingers.push_back(std::move(f));
        return skin_memory_bytes(build_world(spec));
    };
    EXPECT_EQ(bytes(0.01, Material::neo_hookean), bytes(0, Material::neo_hookean));
    EXPECT_GT(bytes(0.01, Material::corotational), bytes(0, Material::corotational));
}

TEST(LinearTissue, LiftsAHeldCubeAsTheTissueItselfDoes) {
    auto start = [](const char* detail) {
        return make_simulation(
            load_scene(testing::source_dir() + "/scenes/pinch.toml",
                       {"solver.preset=reference", "duration_s=1", std::string("solver.detail=") + detail}),
            1);
    };
    Simulation full = start("full"), automatic = start("auto");
    double most = 0, off = 0, apart = 0;
    DetailCount count;
    while (full.world.time < full.scene.duration - 1e-9) {
        advance(full), advance(automatic);
        count_detail(automatic.world, count);
        for (std::size_t i = 0; i < full.fingers.size(); ++i) {
            const Vec3<double> a = full.world.contact_surfaces[i].total, b = automatic.world.contact_surfaces[i].total;
            most = std::max(most, norm(a));
            off = std::max(off, norm(b - a));
        }
        for (std::size_t k = 0; k < full.world.shapes.size(); ++k)
            apart = std::max(apart, norm(full.world.shapes[k].pose.position - automatic.world.shapes[k].pose.position));
    }
    EXPECT_GT(double(count.linear), 0.3 * double(count.all));
    EXPECT_GT(most, 1);
    EXPECT_LT(off, 0.005 * most);
    EXPECT_LT(apart, 2e-5);
}

}  // namespace
}  // namespace palpate
