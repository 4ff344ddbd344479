// Elements that share one change of volume: what they must keep, and what they are for.

#include <functional>

#include "engine/skin/solve/kernels.h"
#include "engine/step.h"
#include "meshes/patches.h"
#include "tests/engine/tissue.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::block_mesh;
using testing::ChunkOptions;
using testing::evaluate_tissue;
using testing::make_chunk;
using testing::scramble;

/// Whose stretches strain limits hold.
enum class Limits { of_elements, of_patches, of_patches_that_cut_elements };

TetMesh patched_block(int nx, int ny, int nz, int size = 5, Limits limits = Limits::of_elements) {
    TetMesh mesh = block_mesh(nx, ny, nz, 0.004);
    make_patches(mesh, size);
    if (limits == Limits::of_patches) make_limit_patches(mesh, 1000, size);
    if (limits != Limits::of_patches_that_cut_elements) return mesh;
    // Those of a coarser mesh of the same cube.
    TetMesh coarse = block_mesh(nx - 1, ny - 1, nz - 1, 0.004 * nx / (nx - 1));
    make_limit_patches(coarse, 1000, size);
    cut_limit_patches(mesh, coarse);
    EXPECT_GT(mesh.limit_shares.size(), mesh.tets.size() / 2);
    return mesh;
}

TEST(Patches, AreConnectedAndOfAboutTheSizeAskedFor) {
    for (int size : {1, 3, 5, 9}) {
        const TetMesh mesh = patched_block(4, 3, 3, size);
        std::vector<int> count;
        for (int p : mesh.patches)
            if (p >= 0) {
                count.resize(std::max(count.size(), std::size_t(p) + 1));
                ++count[std::size_t(p)];
            }
        int used = 0, elements = 0;
        for (int n : count) used += n > 0, elements += n;
        EXPECT_NEAR(double(elements) / used, size, 0.35 * size);
        EXPECT_LE(*std::max_element(count.begin(), count.end()), 2 * size);
    }
    TetMesh mesh = block_mesh(2, 2, 2, 0.004);
    EXPECT_ANY_THROW(make_patches(mesh, 17));
}

/// With and without multipliers.
class PatchDerivatives : public ::testing::TestWithParam<std::pair<Limits, double>> {};

TEST_P(PatchDerivatives, ForceIsTheEnergysGradientAndStiffnessTheForces) {
    const auto [limits, multipliers] = GetParam();
    const int cells = limits == Limits::of_patches_that_cut_elements ? 3 : 2;  // of two, none is cut
    auto chunk = make_chunk<double>(patched_block(cells, cells, cells, 5, limits), Pose<double>::identity(),
                                    {.low = 0.95, .high = 1.05, .poisson = 0.48});
    ASSERT_FALSE(chunk.topology->patches.empty());
    scramble(chunk, 3, 6e-4);
    if (limits != Limits::of_elements) {
        std::mt19937 random(5);
        std::uniform_real_distribution<double> u(-multipliers, multipliers);
        for (double& m : chunk.state.limit_multiplier) m = u(random);
        chunk.limits.unloaded = false;
        const int beyond = int(evaluate_tissue(chunk, 1.0).limited);
        EXPECT_GT(beyond, int(chunk.topology->limit_patches.size()) / 2);
    }
    const SkinTopology& t = *chunk.topology;
    const std::size_t n = std::size_t(3 * t.node_count);
    evaluate_tissue(chunk, 1.0);
    const std::vector<double> gradient(chunk.scratch.gradient.begin(), chunk.scratch.gradient.begin() + long(n));
    std::vector<double> matrix(n * n, 0.0);
    for (const TissuePair& p : tissue_pairs(t))
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j) {
                const std::size_t row = 3 * std::size_t(p.a) + i, column = 3 * std::size_t(p.b) + j;
                matrix[row * n + column] = matrix[column * n + row] =
                    chunk.scratch.blocks[9 * std::size_t(p.block) + 3 * i + j];
            }
    double largest = 0, stiffest = 0;
    for (double g : gradient) largest = std::max(largest, std::abs(g));
    for (double k : matrix) stiffest = std::max(stiffest, std::abs(k));
    const double h = 1e-8;
    for (std::size_t i = 0; i < n; ++i) {
        double& x = chunk.state.position[i];
        const double at = x;
        x = at + h;
        const double above = evaluate_tissue(chunk, 1.0).energy;
        const std::vector<double> f_above(chunk.scratch.gradient.begin(), chunk.scratch.gradient.begin() + long(n));
        x = at - h;
        const double below = evaluate_tissue(chunk, 1.0).energy;
        const std::vector<double> f_below(chunk.scratch.gradient.begin(), chunk.scratch.gradient.begin() + long(n));
        x = at;
        EXPECT_NEAR((above - below) / (2 * h), gradient[i], 1e-6 * largest) << i;
        for (std::size_t j = 0; j < n; ++j)
            EXPECT_NEAR((f_above[j] - f_below[j]) / (2 * h), matrix[j * n + i], 1e-5 * stiffest) << i << " " << j;
        if (HasFailure()) break;
    }
}
INSTANTIATE_TEST_SUITE_P(Limits, PatchDerivatives,
                         ::testing::Values(std::pair{Limits::of_elements, 0.0}, std::pair{Limits::of_patches, 0.0},
                                           std::pair{Limits::of_patches, 1e3},
                                           std::pair{Limits::of_patches_that_cut_elements, 0.0},
                                           std::pair{Limits::of_patches_that_cut_elements, 1e3}));

TEST(Patches, ThatCutElementsHaveTheVolumeOfTheCoarseOnes) {
    const TetMesh fine = patched_block(4, 4, 4, 5, Limits::of_patches_that_cut_elements);
    TetMesh coarse = block_mesh(3, 3, 3, 0.016 / 3);
    make_limit_patches(coarse, 1000, 5);
    const auto volumes = [](const TetMesh& mesh) {
        const auto chunk = make_chunk<double>(mesh, Pose<double>::identity(), {});
        std::vector<double> of_patch;
        double all = 0;
        for (double v : chunk.rest.limit_volume) of_patch.push_back(v), all += v;
        double elements = 0;
        for (double v : chunk.rest.volume) elements += v;
        EXPECT_NEAR(all, elements, 1e-12 * elements);
        return of_patch;
    };
    const std::vector<double> of_fine = volumes(fine), of_coarse = volumes(coarse);
    ASSERT_EQ(of_fine.size(), of_coarse.size());
    for (std::size_t k = 0; k < of_fine.size(); ++k) EXPECT_NEAR(of_fine[k] / of_coarse[k], 1, 0.1) << k;
    // The mean of what deforms alike everywhere is that.
    auto chunk = make_chunk<double>(fine, Pose<double>::identity(), {});
    const Mat3<double> A{{{1.04, 0.03, -0.02}, {0.01, 0.97, 0.04}, {-0.03, 0.02, 1.02}}};
    for (int i = 0; i < chunk.topology->node_count; ++i) {
        double* x = &chunk.state.position[3 * i];
        store_vec3<double>(x, A * load_vec3<double>(x));
    }
    for (std::size_t k = 0; k < of_fine.size(); ++k) {
        const Mat3<double> F = detail::patch_deformation<double>(chunk, k);
        for (int i = 0; i < 9; ++i) EXPECT_NEAR(F.m[i / 3][i % 3], A.m[i / 3][i % 3], 1e-10);
    }
}

TEST(Patches, RigidMotionGivesNoForceAndAffineMotionBalances) {
    const Pose<double> pose{{0.1, -0.2, 0.3}, normalised(Quaternion<double>{0.2, 0.6, 0.8, -0.1})};
    auto moved = make_chunk<double>(patched_block(3, 2, 2), pose, {.poisson = 0.49});
    evaluate_tissue(moved, 0);
    for (double f : moved.scratch.gradient) EXPECT_LT(std::abs(f), 1e-9 * 30e3 * 0.004 * 0.004);

    auto chunk =
        make_chunk<double>(patched_block(3, 3, 3), Pose<double>::identity(), {.limits = false, .poisson = 0.49});
    const Mat3<double> A{{{1.04, 0.03, -0.02}, {0.01, 0.97, 0.04}, {-0.03, 0.02, 1.02}}};
    for (int i = 0; i < chunk.topology->node_count; ++i) {
        double* x = &chunk.state.position[3 * i];
        store_vec3<double>(x, A * load_vec3<double>(x));
    }
    evaluate_tissue(chunk, 0);
    double scale = 0;
    Vec3<double> force{0, 0, 0}, torque{0, 0, 0};
    for (int i = 0; i < chunk.topology->node_count; ++i) {
        const Vec3<double> f = load_vec3<double>(&chunk.scratch.gradient[3 * i]);
        scale = std::max(scale, norm(f));
        force += f;
        torque += cross(load_vec3<double>(&chunk.state.position[3 * i]), f);
    }
    EXPECT_GT(scale, 1e-3);
    EXPECT_LT(norm(force), 1e-11 * scale);
    EXPECT_LT(norm(torque), 1e-13 * scale);
    // One state of strain: patches' means are the elements' own, and inner nodes are in balance.
    for (int i = 1; i < 3; ++i)
        for (int j = 1; j < 3; ++j)
            for (int k = 1; k < 3; ++k) {
                const Vec3<double> f = load_vec3<double>(&chunk.scratch.gradient[3 * ((i * 4 + j) * 4 + k)]);
                EXPECT_LT(norm(f), 1e-11 * scale);
            }
}

/// Contact force of a block of 12 x 8 x 8 mm, n cubes high, that hangs from its top and is pressed on a plane by 1 mm.
double pressed_force(int n, int patch, double poisson) {
    SceneSpec scene;
    scene.solver.inertia = false;
    scene.solver.newton_iterations = 60;
    scene.solver.tolerance = 1e-8;
    FingerSpec& f = scene.fingers.emplace_back();
    f.name = "block";
    f.mesh = block_mesh(3 * n / 2, n, n, 0.008 / n);
    if (patch > 0) make_patches(f.mesh, patch);
    f.poisson_ratio = poisson;
    f.coupling.stiffness = 1e6, f.coupling.angular_stiffness = 1e3, f.coupling.max_force = 1e5;
    f.coupling.max_torque = 1e4, f.coupling.max_speed = 1e3;
    f.start.position = {0, 0, 0.005};
    ObjectSpec& plane = scene.objects.emplace_back();
    plane.name = "plane";
    plane.shape.kind = ShapeKind::plane;
    World world = build_world(scene);
    Threads threads(1);
    for (int k = 1; k <= 20; ++k) {
        Pose<double> pose = f.start;
        pose.position.z = 0.004 - 0.0001 * std::min(k, 10);
        world.tracker_poses[0].incoming = {pose, 0.005 * k, true};
        step(world, threads);
    }
    EXPECT_TRUE(world.contact_surfaces[0].total.z > 0);
    return world.contact_surfaces[0].total.z;
}

/// Blocks that the factor alone fills are neither cleared nor read, and nothing is added to them.
TEST(Patches, WhatTheFactorFillsIsNoPartOfTheMatrix) {
    auto pressed = [](int width, double in_fill) {
        Pose<double> bone = Pose<double>::identity();
        bone.position.z = 0.0061;
        TetMesh mesh = patched_block(4, 3, 3);
        mesh.curved_skin = true;
        auto chunk = make_chunk<double>(
            mesh, bone, {.width = width, .low = 0.9, .high = 1.1, .friction = true, .sample_refinement = 2});
        testing::touch_all(chunk, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0.5});
        const BlockPattern& p = chunk.topology->pattern;
        const auto numbers = 9 * std::size_t(width);
        int filled = 0;
        for (int b = 0; b < p.block_count; ++b)
            if (!p.in_matrix(b))
                std::fill_n(&chunk.scratch.blocks[std::size_t(b) * numbers], numbers, in_fill), ++filled;
        EXPECT_GT(filled, p.block_count / 10);
        for (int k = 1; k <= 12; ++k) {
            bone.position.z -= 2e-4, bone.position.x += 5e-5;
            testing::aim_all(chunk, 2000, 2, bone);
            solve_skin(chunk, SolverSettings{});
        }
        EXPECT_GT(chunk.status[0].contact_force_N, 0.05);
        for (int b = 0; b < p.block_count; ++b)
            for (std::size_t i = 0; i < numbers && !p.in_matrix(b); ++i)
                EXPECT_EQ(chunk.scratch.blocks[std::size_t(b) * numbers + i], in_fill);
        return chunk.state.position;
    };
    for (int width : {1, 4}) EXPECT_EQ(pressed(width, 0), pressed(width, 1e3));
}

TEST(Patches, KeepCoarseMeshesFromLockingNearIncompressibility) {
    const double fine = pressed_force(8, 5, 0.49);
    const double patches = pressed_force(4, 5, 0.49), alone = pressed_force(4, 0, 0.49);
    EXPECT_LT(std::abs(patches / fine - 1), 0.5 * std::abs(alone / fine - 1)) << patches << " " << alone << " " << fine;
    EXPECT_LT(std::abs(patches / fine - 1), 0.10);
    // Where nothing locks they change little.
    EXPECT_NEAR(pressed_force(4, 5, 0.1) / pressed_force(4, 0, 0.1), 1, 0.03);
}

/// Lowest and highest stretches of the mean deformation of each patch, and of each element.
struct Stretches {
    double patch_low = HUGE_VAL, patch_high = 0, element_low = HUGE_VAL, element_high = 0;
};
Stretches stretches_of(const SkinChunk<double>& c) {
    Stretches s;
    for (std::size_t k = 0; k < c.topology->limit_patches.size(); ++k) {
        const Vec3<double> mean = signed_svd(detail::patch_deformation<double>(c, k)).sigma;
        s.patch_low = std::min(s.patch_low, mean.z), s.patch_high = std::max(s.patch_high, mean.x);
    }
    for (std::size_t e = 0; e < c.topology->elements.size(); ++e) {
        const Vec3<double> own = signed_svd(detail::element_deformation<double>(c, e)).sigma;
        s.element_low = std::min(s.element_low, own.z), s.element_high = std::max(s.element_high, own.x);
    }
    return s;
}

/// A block that is pressed far beyond what its limits allow: by springs of the bone with up to a thousand newtons.
TEST(Patches, LimitsOfPatchesHoldUnderAnyLoad) {
    for (const auto& [limits, power, newtons] :
         {std::tuple{Limits::of_patches, 2, 1.0}, std::tuple{Limits::of_patches, 2, 10.0},
          std::tuple{Limits::of_patches, 2, 1000.0}, std::tuple{Limits::of_patches_that_cut_elements, 3, 10.0},
          std::tuple{Limits::of_patches_that_cut_elements, 3, 1000.0}}) {
        SceneSpec scene;
        scene.solver = {};
        FingerSpec& f = scene.fingers.emplace_back();
        f.name = "block";
        f.mesh = patched_block(3, 3, 3, 5, limits);
        f.element_low_power = power;
        f.poisson_ratio = 0.45, f.young_modulus = 10e3;
        f.has_limits = true, f.limit_low = 0.75, f.limit_high = 1.25;
        f.coupling.stiffness = newtons / 0.01, f.coupling.angular_stiffness = 1e3, f.coupling.max_force = 1e5;
        f.coupling.max_torque = 1e4;
        f.start.position = {0, 0, 0.013};
        ObjectSpec& plane = scene.objects.emplace_back();
        plane.name = "plane";
        plane.shape.kind = ShapeKind::plane;
        World world = build_world(scene);
        ASSERT_FALSE(world.chunks.doubles[0].topology->limit_patches.empty());
        Threads threads(1);
        for (int k = 1; k <= 400; ++k) {
            Pose<double> pose = f.start;
            pose.position.z -= 1e-4 * std::min(k, 140);  // to 1 cm beyond where nothing yields any more
            world.tracker_poses[0].incoming = {pose, 0.005 * k, true};
            step(world, threads);
        }
        const SkinChunk<double>& c = world.chunks.doubles[0];
        const Stretches s = stretches_of(c);
        const double force = world.contact_surfaces[0].total.z;
        EXPECT_GT(force, (power == 2 ? 0.35 : 0.15) * newtons);  // elements go further
        EXPECT_LT(s.patch_high, 1.25 * 1.001) << newtons;
        EXPECT_GT(s.patch_low, 0.75 * 0.999) << newtons;
        EXPECT_GT(s.element_low, 0.05) << newtons << ": an element is turned inside out, or nearly";
        EXPECT_TRUE(c.status[0].converged) << newtons;
    }
}

TEST(Patches, SharesThatAreNoneAreRefused) {
    const TetMesh sound = patched_block(3, 3, 3, 5, Limits::of_patches_that_cut_elements);
    const auto refused = [&](const std::function<void(std::vector<LimitShare>&)>& spoil) {
        SceneSpec scene;
        FingerSpec& f = scene.fingers.emplace_back();
        f.name = "block";
        f.mesh = sound;
        f.has_limits = true;
        spoil(f.mesh.limit_shares);
        const auto wrong = scene.validate();
        return std::any_of(wrong.begin(), wrong.end(),
                           [](const std::string& s) { return s.find("shares of limit patches") != std::string::npos; });
    };
    EXPECT_FALSE(refused([](auto&) {}));
    EXPECT_TRUE(refused([&](auto& shares) { shares.back().tet = int(sound.tets.size()); }));
    EXPECT_TRUE(refused([](auto& shares) { shares.front().patch = -1; }));
    EXPECT_TRUE(refused([](auto& shares) { shares.front().share = NAN; }));
    EXPECT_TRUE(refused([](auto& shares) { std::swap(shares.front(), shares.back()); }));
}

TEST(Patches, GiveTheSameBitsAloneAndInLanesAndAgreeInFloat) {
    for (const Limits limits : {Limits::of_elements, Limits::of_patches, Limits::of_patches_that_cut_elements}) {
        auto forces = [limits](int fingers, bool single) {
            SceneSpec scene;
            for (int k = 0; k < fingers; ++k) {
                FingerSpec& f = scene.fingers.emplace_back();
                f.name = "block" + std::to_string(k);
                if (limits == Limits::of_patches_that_cut_elements) {
                    f.mesh = patched_block(3, 3, 3, 4, limits);
                } else {
                    f.mesh = block_mesh(3, 2, 2, 0.004);
                    make_patches(f.mesh, 4);
                    if (limits == Limits::of_patches) make_limit_patches(f.mesh, 1000, 4);
                }
                f.poisson_ratio = 0.48;
                f.has_limits = true, f.limit_low = 0.85, f.limit_high = 1.15;
                f.single_precision = single;
                f.start.position = {0.05 * k, 0, 0.005};
            }
            ObjectSpec& plane = scene.objects.emplace_back();
            plane.name = "plane";
            plane.shape.kind = ShapeKind::plane;
            plane.friction = 0.5;
            World world = build_world(scene);
            Threads threads(1);
            for (int k = 1; k <= 40; ++k) {
                for (int i = 0; i < fingers; ++i) {
                    Pose<double> pose = scene.fingers[std::size_t(i)].start;
                    pose.position.z = 0.004 - 0.00004 * k * (1 + 0.2 * i), pose.position.x += 0.00002 * k;
                    world.tracker_poses[std::size_t(i)].incoming = {pose, 0.005 * k, true};
                }
                step(world, threads);
            }
            return world.contact_surfaces[0].total;
        };
        const Vec3<double> alone = forces(1, false), beside = forces(3, false), single = forces(1, true);
        EXPECT_GT(alone.z, 0.1);
        for (int d = 0; d < 3; ++d) EXPECT_EQ(alone[d], beside[d]);
        EXPECT_LT(norm(single - alone), 0.01 * norm(alone));
    }
}

}  // namespace
}  // namespace palpate
