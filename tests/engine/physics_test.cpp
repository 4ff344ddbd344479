// Laws that the skin solver must keep.

#include "engine/skin/chunks/level_of_detail.h"
#include "engine/skin/solve/evaluate.h"
#include "engine/skin/solve/kernels.h"
#include "engine/step.h"
#include "meshes/patches.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::block_mesh;
using testing::ChunkOptions;
using testing::make_chunk;

constexpr double pi = 3.14159265358979323846;

/// Elastic forces alone at the chunk's current positions.
LaneArray<double> elastic_forces(SkinChunk<double>& c) {
    Evaluation<double> out;
    std::fill(c.scratch.gradient.begin(), c.scratch.gradient.end(), 0.0);
    std::fill(c.scratch.blocks.begin(), c.scratch.blocks.end(), 0.0);
    detail::add_tissue<detail::Want::forces_and_matrix>(c, 0.0, out);
    return c.scratch.gradient;
}

double largest(const LaneArray<double>& a) {
    double m = 0;
    for (double x : a) m = std::max(m, std::abs(x));
    return m;
}

TEST(Physics, RigidMotionGivesNoForce) {
    const TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    const double elastic_scale = 30e3 * 0.004 * 0.004;
    for (double angle : {60.0, 180.0}) {
        const double half = angle / 360 * pi;
        const Pose<double> pose{{0.1, -0.2, 0.3}, {std::cos(half), std::sin(half) * 0.6, std::sin(half) * 0.8, 0}};
        auto chunk = make_chunk<double>(mesh, pose, {});
        EXPECT_LT(largest(elastic_forces(chunk)), 1e-10 * elastic_scale) << angle << " degrees";
    }
}

TEST(Physics, InternalForcesSumToZeroInForceAndTorque) {
    auto chunk = make_chunk<double>(block_mesh(2, 2, 2, 0.004), Pose<double>::identity(), {.low = 0.9, .high = 1.1});
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(-1e-3, 1e-3);
    for (double& x : chunk.state.position) x += u(random);
    const auto f = elastic_forces(chunk);
    Vec3<double> force{0, 0, 0}, torque{0, 0, 0};
    for (int i = 0; i < chunk.topology->node_count; ++i) {
        const Vec3<double> fi = load_vec3<double>(&f[3 * i]);
        force += fi;
        torque += cross(load_vec3<double>(&chunk.state.position[3 * i]), fi);
    }
    EXPECT_LT(norm(force), 1e-12 * largest(f) * f.size());
    EXPECT_LT(norm(torque), 1e-12 * largest(f) * f.size() * 0.01);
}

TEST(Physics, SingleTetrahedronFollowsTheClosedForm) {
    // Free lateral contraction at stretch s: P = E (s - 1), lateral stretch 1 - nu (s - 1).
    const double E = 1, nu = 0.3, s = 1.2, lateral = 1 - nu * (s - 1);
    const double mu = E / (2 * (1 + nu)), lambda = E * nu / ((1 + nu) * (1 - 2 * nu));
    const auto t = corotational<Curvature::exact>(Vec3<double>{s, lateral, lateral}, mu, lambda);
    EXPECT_NEAR(t.stress.x, E * (s - 1), 1e-10);
    EXPECT_NEAR(t.stress.y, 0, 1e-10);
    EXPECT_NEAR(t.stress.z, 0, 1e-10);
    EXPECT_NEAR(t.stress.x / 6, 0.0333333333333, 1e-10);  // nodal force of the unit tetrahedron, P / 6
    // St. Venant-Kirchhoff: P = s E (s^2 - 1) / 2, lateral strain -nu times the axial one.
    const double thin = std::sqrt(1 - nu * (s * s - 1));
    const auto v = saint_venant_kirchhoff<Curvature::exact>(Vec3<double>{s, thin, thin}, mu, lambda);
    EXPECT_NEAR(v.stress.x, s * E * (s * s - 1) / 2, 1e-10);
    EXPECT_NEAR(v.stress.x / 6, 0.044, 1e-10);
    EXPECT_NEAR(v.stress.y, 0, 1e-10);
    // Neo-Hookean: swelling feels the bulk modulus alone, P = kappa (J - 1) s^2; sliding at constant volume the shear
    // modulus alone, P_i - P_j s_j / s_i = mu (s_i - s_j^2 / s_i).
    const auto n = neo_hookean<Curvature::exact>(Vec3<double>{s, s, s}, mu, lambda);
    EXPECT_NEAR(n.stress.x, (lambda + 2 * mu / 3) * (s * s * s - 1) * s * s, 1e-10);
    const auto h = neo_hookean<Curvature::exact>(Vec3<double>{s, 1, 1 / s}, mu, lambda);
    EXPECT_NEAR(s * h.stress.x - h.stress.z / s, mu * (s * s - 1 / (s * s)), 1e-10);
}

TEST(Physics, AnInvertedNeoHookeanElementIsPushedBack) {
    for (double s : {0.3, 0.1, 1e-3, 0.0, -1e-3, -0.5, -3.0}) {
        const auto t = neo_hookean<Curvature::exact>(Vec3<double>{1.1, 0.9, s}, 1e3, 9e3);
        EXPECT_TRUE(std::isfinite(t.energy));
        EXPECT_LT(t.stress.z, -1e2) << s;
    }
}

TEST(Physics, PatchTestIsExact) {
    auto chunk = make_chunk<double>(block_mesh(3, 3, 3, 0.004), Pose<double>::identity(), {});
    const Mat3<double> A{{{1.04, 0.03, -0.02}, {0.01, 0.97, 0.04}, {-0.03, 0.02, 1.02}}};
    for (int i = 0; i < chunk.topology->node_count; ++i) {
        double* x = &chunk.state.position[3 * i];
        store_vec3<double>(x, A * load_vec3<double>(x));
    }
    const auto f = elastic_forces(chunk);
    const double scale = largest(f);
    int inner = 0;
    for (int i = 1; i < 3; ++i)
        for (int j = 1; j < 3; ++j)
            for (int k = 1; k < 3; ++k, ++inner)
                EXPECT_LT(norm(load_vec3<double>(&f[3 * ((i * 4 + j) * 4 + k)])), 1e-12 * scale);
    EXPECT_EQ(inner, 8);
    EXPECT_GT(scale, 1e-3);
}

TEST(Physics, NothingMovesAtRest) {
    const Pose<double> pose{{0.02, 0.01, 0.05}, normalised(Quaternion<double>{1, 0.3, -0.2, 0.5})};
    auto chunk = make_chunk<double>(block_mesh(3, 2, 2, 0.004), pose, {});
    const auto before = chunk.state.position;
    for (int i = 0; i < 50; ++i) solve_skin(chunk, SolverSettings{});
    for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(chunk.state.position[i], before[i], 1e-14);
    EXPECT_TRUE(chunk.status[0].converged);
    EXPECT_EQ(chunk.status[0].contact_force_N, 0);
}

double mechanical_energy(SkinChunk<double>& c, const SolverSettings& s) {
    c.scratch.inertia_target = c.state.position;  // no inertia term: elastic, limit and coupling energy
    double energy = evaluate<double>(c, s, 0.0).energy;
    for (int i = 0; i < c.topology->node_count; ++i) {
        const Vec3<double> v = load_vec3<double>(&c.state.velocity[3 * i]);
        energy += 0.5 * c.rest.mass[i] * dot(v, v);
    }
    return energy;
}

TEST(Physics, UnforcedEnergyNeverRises) {
    std::mt19937 random(3);
    std::normal_distribution<double> n;
    for (double dt : {1e-3, 5e-3, 20e-3})
        for (int trial = 0; trial < 5; ++trial) {
            auto chunk = make_chunk<double>(block_mesh(3, 2, 2, 0.004), Pose<double>::identity(), {.limits = false});
            for (double& x : chunk.state.position) x += 4e-4 * n(random);
            for (double& v : chunk.state.velocity) v = 0.05 * n(random);
            SolverSettings s;
            s.dt = dt;
            double last = mechanical_energy(chunk, s);
            const double first = last;
            for (int i = 0; i < 30; ++i) {
                solve_skin(chunk, s);
                const double now = mechanical_energy(chunk, s);
                EXPECT_LE(now, last + 1e-9 * first) << "dt " << dt << " step " << i;
                last = now;
            }
            EXPECT_LT(last, 0.9 * first);
        }
}

/// Presses the block on a plane with the coupling's target `depth` below the touch.
SkinChunk<double> pressed(double depth, double dt, const ChunkOptions& options, int steps, double friction = 0,
                          double slide = 0) {
    Pose<double> bone = Pose<double>::identity();
    bone.position.z = 0.0061;
    auto chunk = make_chunk<double>(block_mesh(4, 3, 3, 0.004), bone, options);
    testing::touch_all(chunk, {0, {}, Pose<double>::identity(), Pose<double>::identity(), friction});
    SolverSettings s;
    s.dt = dt;
    s.newton_iterations = 400;
    for (int i = 1; i <= steps; ++i) {
        Pose<double> target = bone;
        target.position.z -= depth * std::min(1.0, 2.0 * i / steps);
        target.position.x += slide * std::max(0.0, 2.0 * i / steps - 1);
        testing::aim_all(chunk, 2000, 20, target);
        solve_skin(chunk, s);
    }
    return chunk;
}

TEST(Physics, StrainLimitsHoldUnderAnyCouplingForce) {
    for (double force : {1.0, 10.0, 1000.0}) {
        auto chunk = pressed(force / 2000 + 0.006, 5e-3, {.low = 0.6, .high = 1.4}, 60);
        const SkinStatus& s = chunk.status[0];
        EXPECT_LE(s.limit_violation, 1e-3) << force << " N";
        EXPECT_LE(s.penetration_m, 2e-6) << force << " N";
        EXPECT_GT(s.contact_force_N, 0.8 * force);
        EXPECT_FALSE(s.reset);
        EXPECT_TRUE(s.converged) << force << " N, residual " << s.residual_N;
    }
}

TEST(Physics, TheToleranceOfTheLimitsIsAPrice) {
    int last = 0;
    for (double tolerance : {1e-1, 1e-3, 1e-6}) {
        SolverSettings s;
        s.limit_tolerance = tolerance;
        auto chunk = pressed(0.0025, 5e-3, {.low = 0.9, .high = 1.1}, 1, 0, 0);
        const Pose<double> target{{0, 0, 0.0036}, Quaternion<double>::identity()};
        testing::aim_all(chunk, 2000, 20, target);
        int iterations = 0;
        for (int i = 0; i < 20; ++i) {
            solve_skin(chunk, s);
            EXPECT_TRUE(chunk.status[0].converged);
            EXPECT_LE(chunk.status[0].limit_violation, tolerance);
            iterations += chunk.status[0].newton_iterations;
        }
        EXPECT_GE(iterations, last);
        last = iterations;
    }
}

TEST(Physics, TightLimitsAreActiveAndHold) {
    auto chunk = pressed(0.0025, 5e-3, {.low = 0.9, .high = 1.1}, 60);
    EXPECT_GT(chunk.status[0].limited_elements, 20);
    EXPECT_LE(chunk.status[0].limit_violation, 1e-3);
}

TEST(Physics, ContactForceEqualsTheCouplingsAtRest) {
    auto chunk = pressed(0.0025, 5e-3, {}, 120);
    const double coupling = 2000 * (chunk.state.bone[2] - (0.0061 - 0.0025));
    EXPECT_NEAR(chunk.status[0].contact_force_N, coupling, 1e-6 * coupling);
    // Complementarity: force only where the gap is closed.
    for (std::size_t s = 0; s < chunk.topology->samples.size(); ++s) {
        const double gap = chunk.state.position[3 * chunk.topology->samples[s] + 2],
                     force = chunk.state.normal_multiplier[s];
        EXPECT_GE(force, 0);
        EXPECT_LE(force * std::abs(gap), 1e-8);
    }
}

TEST(Physics, TheSameForceAtRestForAnyTimeStep) {
    const double reference = pressed(0.0025, 5e-3, {}, 200).status[0].contact_force_N;
    EXPECT_NEAR(pressed(0.0025, 1e-3, {}, 1000).status[0].contact_force_N, reference, 1e-4 * reference);
    EXPECT_NEAR(pressed(0.0025, 20e-3, {}, 60).status[0].contact_force_N, reference, 1e-4 * reference);
}

TEST(Physics, FrictionStaysInItsConeAndSlidesOnIt) {
    auto chunk = pressed(0.0025, 5e-3, {.friction = true}, 120, 0.3, 0.01);
    double normal = 0;
    Vec3<double> tangential{0, 0, 0};
    for (std::size_t s = 0; s < chunk.topology->samples.size(); ++s) {
        const double f = chunk.state.normal_multiplier[s];
        const Vec3<double> t = load_vec3<double>(&chunk.state.tangential_multiplier[3 * s]);
        EXPECT_LE(norm(t), 0.3 * f + 1e-6);
        normal += f;
        tangential += t;
    }
    EXPECT_NEAR(tangential.x, 0.3 * normal, 0.01 * normal);  // dragged towards +x
}

TEST(Physics, RecoversFromScrambledStates) {
    const TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    std::mt19937 random(9);
    std::normal_distribution<double> n;
    for (int trial = 0; trial < 8; ++trial) {
        if (!testing::is_tried(trial, 3)) continue;
        auto chunk = make_chunk<double>(mesh, Pose<double>::identity(), {});
        for (double& x : chunk.state.position) x = trial == 0 ? 0 : 0.01 * n(random);
        for (int i = 0; i < 200; ++i) solve_skin(chunk, SolverSettings{});
        for (int i = 0; i < chunk.topology->node_count; ++i)
            for (int d = 0; d < 3; ++d)
                EXPECT_NEAR(chunk.state.position[3 * i + d], mesh.nodes[i][d], 1e-6) << "trial " << trial;
    }
}

TEST(Physics, AFingerThatRunsAwayIsResetAndReported) {
    auto chunk = make_chunk<double>(block_mesh(3, 2, 2, 0.004), Pose<double>::identity(), {});
    for (int d = 0; d < 3; ++d) chunk.state.velocity[d] = 1e30;
    solve_skin(chunk, SolverSettings{});
    EXPECT_TRUE(chunk.status[0].reset);
    for (double x : chunk.state.position) EXPECT_LT(std::abs(x), 0.1);
    solve_skin(chunk, SolverSettings{});
    EXPECT_FALSE(chunk.status[0].reset);
    EXPECT_TRUE(chunk.status[0].converged);
}

TEST(Physics, ANaNLaneIsResetAndItsNeighboursDoNotChangeByABit) {
    const TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    const int width = chunk_width<double>(4), poisoned_lane = width - 1;
    auto run = [&](bool poison) {
        Pose<double> bone = Pose<double>::identity();
        bone.position.z = 0.0045;
        auto chunk = make_chunk<double>(mesh, bone, {.width = width});
        testing::touch_all(chunk, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0});
        Pose<double> target = bone;
        target.position.z -= 0.002;
        testing::aim_all(chunk, 2000, 2, target);
        bool reset = false;
        for (int i = 0; i < 30; ++i) {
            if (poison && i == 10)
                chunk.state.position[3 * 5 * width + poisoned_lane] = std::numeric_limits<double>::quiet_NaN();
            solve_skin(chunk, SolverSettings{});
            reset = reset || chunk.status[poisoned_lane].reset;
        }
        EXPECT_EQ(reset, poison);
        return chunk;
    };
    const auto clean = run(false), poisoned = run(true);
    for (std::size_t i = 0; i < clean.state.position.size(); ++i) {
        EXPECT_TRUE(std::isfinite(poisoned.state.position[i]));
        if (int(i) % width != poisoned_lane) {
            EXPECT_EQ(clean.state.position[i], poisoned.state.position[i]) << "position " << i;
        }
    }
}

/// Sets are ordered: a processor runs those up to its best.
bool runs_here(const KernelSet& set) {
    return &set == &plain_kernels || &set == &best_kernels() ||
           (&set == &avx2_kernels && &best_kernels() == &avx512_kernels);
}

template <class T>
const std::array<Kernel<T>, 3>& kernels_in(const KernelSet& set) {
    if constexpr (sizeof(T) == 8)
        return set.for_double;
    else
        return set.for_float;
}

template <class T>
void expect_the_same_at_any_width(const TetMesh& mesh, const SolverSettings& settings = {}) {
    using Solve = void (*)(SkinChunk<T>&, const SolverSettings&);
    const auto topology = std::make_shared<SkinTopology>(build_topology(mesh));
    auto run = [&](int fingers, int width, Solve solve) {
        Pose<double> bone = Pose<double>::identity();
        bone.position.z = 0.0045;
        SkinChunk<T> chunk;
        const bool layered = !mesh.membrane_patches.empty();
        allocate_chunk(chunk, topology, width, true, true, 1, false, layered);
        SkinParameters p;
        p.mesh = &mesh;
        p.has_limits = true;
        p.limit_low = {0.8};
        p.limit_high = {1.2};
        for (int lane = 0; lane < fingers; ++lane) {
            p.young_modulus = {30e3 * (1 + lane)};
            p.membrane_young.clear();
            if (layered && lane != 1)  // in some elements, and in none of the second finger's
                for (std::size_t e = 0; e < mesh.tets.size(); ++e) p.membrane_young.push_back(e % 5 == 0 ? 0 : 40e3);
            set_lane(chunk, lane, lane, p, bone);
        }
        fill_empty_lanes(chunk);
        testing::touch_all(chunk, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0.5});
        Pose<double> target = bone;
        target.position.z -= 0.003;
        testing::aim_all(chunk, 2000, 2, target);
        for (int i = 0; i < 20; ++i) {
            choose_matrices(chunk, settings, i);
            solve(chunk, settings);
        }
        return chunk;
    };
    const auto plain = run(1, 1, kernels_in<T>(plain_kernels)[0].solve);
    EXPECT_GT(plain.status[0].contact_force_N, 0.1);
    for (const KernelSet* set : {&plain_kernels, &avx2_kernels, &avx512_kernels}) {
        if (!runs_here(*set)) continue;
        // Those with wide registers round products and sums at once, all of them in the same way.
        const bool fuses = set != &plain_kernels;
        const auto reference = fuses ? run(1, 1, kernels_in<T>(avx2_kernels)[0].solve) : plain;
        EXPECT_NEAR(reference.status[0].contact_force_N, plain.status[0].contact_force_N,
                    (sizeof(T) == 8 ? 1e-6 : 1e-3) * plain.status[0].contact_force_N);
        for (const Kernel<T>& kernel : kernels_in<T>(*set)) {
            const int width = kernel.width;
            if (width == 0) continue;
            const auto alone = run(1, width, kernel.solve), beside = run(std::min(3, width), width, kernel.solve);
            for (std::size_t i = 0; i < reference.state.position.size(); ++i) {
                ASSERT_EQ(reference.state.position[i], alone.state.position[i * width])
                    << set->instructions << ", " << width << " lanes";
                ASSERT_EQ(alone.state.position[i * width], beside.state.position[i * width])
                    << set->instructions << ", " << width << " lanes";
            }
            EXPECT_EQ(reference.status[0].newton_iterations, beside.status[0].newton_iterations);
        }
    }
}

TEST(Physics, AFingerIsTheSameAloneInAChunkOrBesideOthers) {
    TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    if (testing::is_tried(1, 2)) {
        expect_the_same_at_any_width<double>(mesh);
        expect_the_same_at_any_width<float>(mesh);
    }
    make_patches(mesh, 5);
    if (testing::is_tried(1, 2)) {
        expect_the_same_at_any_width<double>(mesh);
        expect_the_same_at_any_width<float>(mesh);
    }
    // A skin that is round between nodes; layers, whose membranes share their stretch or resist it alone; matrices that
    // some of them keep, and others, of other stiffness, do not.
    mesh.curved_skin = true;
    make_membrane_patches(mesh, 4);
    const SolverSettings keeping{.newton_iterations = 2, .stiffness_steps = 7};
    expect_the_same_at_any_width<double>(mesh, keeping);
    expect_the_same_at_any_width<float>(mesh, keeping);
}

TEST(Physics, SinglePrecisionAgreesWithDouble) {
    const TetMesh mesh = block_mesh(4, 3, 3, 0.004);
    Pose<double> bone = Pose<double>::identity();
    bone.position.z = 0.0061;
    auto d = make_chunk<double>(mesh, bone, {});
    auto f = make_chunk<float>(mesh, bone, {});
    testing::touch_all(d, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0});
    testing::touch_all(f, {0, {}, Pose<double>::identity(), Pose<double>::identity(), 0});
    SolverSettings s, loose;
    loose.tolerance = 1e-3;
    loose.multiplier_tolerance = 1e-3;
    loose.newton_iterations = 6;
    Pose<double> target = bone;
    for (int i = 0; i < 60; ++i) {
        target.position.z = 0.0061 - 0.0025 * std::min(1.0, i / 40.0);
        testing::aim_all(d, 2000, 2, target);
        testing::aim_all(f, 2000, 2, target);
        solve_skin(d, s);
        solve_skin(f, loose);
    }
    EXPECT_NEAR(f.status[0].contact_force_N, d.status[0].contact_force_N, 2e-3 * d.status[0].contact_force_N);
}

/// An object that gives way presses back with its stiffness, each sample's area and the depth there; a very stiff one
/// does what a rigid one does.
TEST(SoftObjects, PressBackAsDeepAsTheyArePressed) {
    auto pressed = [](double stiffness) {
        SceneSpec spec;
        spec.solver.inertia = false;
        FingerSpec f;
        f.name = "block";
        f.mesh = testing::block_mesh(3, 3, 2, 0.004);
        f.has_limits = true;
        f.start.position = {0, 0, 0.0045};
        spec.fingers.push_back(f);
        spec.objects.push_back({"floor", {}, Pose<double>::identity()});
        spec.objects.back().stiffness = stiffness;
        World world = build_world(spec);
        Threads threads(1);
        world.tracker_poses[0].incoming.valid = true;
        world.tracker_poses[0].incoming.pose.position = {0, 0, 0.0034};
        for (int k = 0; k < 20; ++k) {
            world.tracker_poses[0].incoming.time = world.time;
            step(world, threads);
        }
        EXPECT_TRUE(skin_status(world, world.skins.owner(0)).converged);
        return world;
    };
    const double stiffness = 5e6;  // 5 kPa per mm
    const World soft = pressed(stiffness);
    const ContactSurface& c = soft.contact_surfaces[0];
    const Pose<double> bone = bone_pose(soft, soft.skins.owner(0));
    double deepest = 0;
    for (std::size_t s = 0; s < c.area.size(); ++s) {
        const double depth = std::max(0.0, -transform(bone, c.position[s]).z);
        EXPECT_NEAR(c.force[s].z, stiffness * c.area[s] * depth, 1e-9);
        deepest = std::max(deepest, depth);
    }
    EXPECT_GT(deepest, 2e-4);
    EXPECT_GT(c.touching, 9);
    const double rigid = pressed(0).contact_surfaces[0].normal_force;
    EXPECT_LT(c.normal_force, 0.8 * rigid);
    EXPECT_NEAR(pressed(1e12).contact_surfaces[0].normal_force, rigid, 2e-3 * rigid);
}

}  // namespace
}  // namespace palpate
