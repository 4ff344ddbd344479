// What a grip can still resist, against closed forms and its own optimality.

#include <random>

#include "meshes/mesh_files.h"
#include "scenes/run/grasp.h"
#include "scenes/run/wrench_reserve.h"
#include "tests/support.h"

namespace palpate {
namespace {

Motion along(const Vec3<double>& force, const Vec3<double>& torque = {0, 0, 0}) {
    Motion w;
    w << force.x, force.y, force.z, torque.x, torque.y, torque.z;
    return w;
}

/// A ring of n samples, radius r [m], in the plane z = 0, each with a limit of 1/n.
std::vector<GripSample> ring(int n, double r) {
    std::vector<GripSample> samples;
    for (int k = 0; k < n; ++k) {
        const double a = 2 * M_PI * k / n;
        samples.push_back({{r * std::cos(a), r * std::sin(a), 0}, {0, 0, 1}, 1.0 / n, {0, 0, 0}});
    }
    return samples;
}

TEST(WrenchReserve, OfARingIsThatOfItsClosedForm) {
    const double r = 0.005;
    const auto samples = ring(16, r);
    EXPECT_NEAR(wrench_reserve(samples, along({1, 0, 0})), 1, 1e-5);
    EXPECT_NEAR(wrench_reserve(samples, along({0.6, -0.8, 0})), 1, 1e-5);
    EXPECT_NEAR(wrench_reserve(samples, along({0, 0, 0}, {0, 0, 1})), r, 1e-5 * r);
    EXPECT_NEAR(wrench_reserve(samples, along({0, 0, 1})), 0, 1e-6) << "friction pulls along the surface alone";
    // Friction that is in use already: what is left along it, and against it.
    auto used = samples;
    for (GripSample& s : used) s.friction = {0.25 / 16, 0, 0};
    EXPECT_NEAR(wrench_reserve(used, along({1, 0, 0})), 0.75, 1e-5);
    EXPECT_NEAR(wrench_reserve(used, along({-1, 0, 0})), 1.25, 1e-5);
    // Across it, the limit surface of forces is a circle.
    EXPECT_NEAR(wrench_reserve(used, along({0, 1, 0})), std::sqrt(1 - 0.25 * 0.25), 1e-5);
    const GripReserve g = grip_reserve(used, {-2, 0, 5});
    EXPECT_NEAR(g.weakest_N, 0.75, 1e-5);
    EXPECT_NEAR(g.load_N, 1.25, 1e-5);
    EXPECT_LT(g.twist_N_mm, 1e3 * r);
    EXPECT_GT(g.twist_N_mm, 0.9 * 1e3 * r);
}

TEST(WrenchReserve, OfOneSampleAndOfNoneIsFinite) {
    EXPECT_EQ(wrench_reserve({}, along({1, 0, 0})), 0);
    EXPECT_EQ(grip_reserve({}, {0, 0, 1}).weakest_N, 0);
    const std::vector<GripSample> one{{{0.01, 0, 0}, {0, 0, 1}, 2, {0, 0, 0}}};
    EXPECT_NEAR(grip_reserve(one, {0, 1, 0}).load_N, 2, 1e-4);
    EXPECT_NEAR(grip_reserve(one, {0, 1, 0}).twist_N_mm, 0, 1e-3);
}

/// Wrenches inside the limit surface, by random frictions: none may be beyond what the reserve says; and scaled up by
/// the reserve's own bound along their direction they stay inside every half-space that supports the surface.
TEST(WrenchReserve, BoundsWhatRandomFrictionsReach) {
    std::mt19937 random(11);
    std::normal_distribution<double> n;
    std::uniform_real_distribution<double> u(0, 1);
    for (int trial = 0; trial < 20; ++trial) {
        std::vector<GripSample> samples;
        for (int k = 0; k < 12; ++k) {
            GripSample s;
            s.point = {0.005 * n(random), 0.005 * n(random), 0.001 * n(random)};
            s.normal = Vec3<double>{0.3 * n(random), 0.3 * n(random), 1};
            s.normal = (1 / norm(s.normal)) * s.normal;
            s.friction_limit = u(random);
            samples.push_back(s);
        }
        double most = 0;
        for (int k = 0; k < 50; ++k) {
            Motion w = Motion::Zero();
            for (const GripSample& s : samples) {
                Vec3<double> t{n(random), n(random), n(random)};
                if (k % 2) t = cross(s.normal, s.point) + 0.1 * norm(s.point) * t;  // nearly all one way: far out
                t = t - dot(t, s.normal) * s.normal;
                const Vec3<double> f = (s.friction_limit / norm(t)) * t;
                w += along(f, cross(s.point, f));
            }
            const double reach = wrench_reserve(samples, w);
            EXPECT_GE(reach, 1 - 1e-4);
            most = std::max(most, 1 / reach);
        }
        EXPECT_GT(most, 0.9) << "frictions that all turn the same way nearly reach the surface";
    }
}

/// A pinch whose fingers are not straight opposite each other and open: it slips where the limit of its whole grasp is,
/// with the normal forces of the last step in which it held. What that is below 2 mu N is friction that torques take.
TEST(WrenchReserve, AnAsymmetricPinchSlipsAtTheLimitOfItsGrasp) {
    const testing::ScratchFolder scratch;
    write_file(scratch.path / "scene.toml", R"(
duration_s = 1.8
dt_ms = 5
[limits]
low = 0.6
high = 1.4
[[object]]
name = "cube"
kind = "box"
size_mm = [20, 20, 20]
position_mm = [0, 0, 10]
mass_g = 100
friction = 0.5
release_s = 0.6
[[finger]]
name = "thumb"
shape = { finger = "thumb" }
track = [
    { t_s = 0, position_mm = [0, -22, 10], rotation_deg = [90, 0, 0] },
    { t_s = 0.4, position_mm = [0, -14.5, 10], rotation_deg = [90, 0, 0] },
    { t_s = 0.8, position_mm = [0, -14.5, 10], rotation_deg = [90, 0, 0] },
    { t_s = 1.8, position_mm = [0, -20.5, 10], rotation_deg = [90, 0, 0] },
]
[[finger]]
name = "index"
shape = { finger = "index" }
track = [
    { t_s = 0, position_mm = [2.5, 22, 11], rotation_deg = [-90, 0, 0] },
    { t_s = 0.4, position_mm = [2.5, 13.5, 11], rotation_deg = [-90, 0, 0] },
]
)");
    int number = 0;
    for (const char* preset : {"reference", "fast", "balanced"}) {
        if (!testing::is_tried(number++, 3)) continue;
        Simulation s =
            make_simulation(load_scene(scratch.path / "scene.toml", {"solver.preset=" + std::string(preset)}), 1);
        double capacity = 0, share = 0;
        int sliding = 0;
        while (sliding < 4 && s.world.time < 1.8) {
            advance(s);
            if (s.world.time < 1) continue;
            const RigidBody& cube = s.world.bodies[0];
            double normal = 0;
            for (const EntityId f : s.fingers) normal += s.world.contact_surfaces.find(f)->normal_force;
            sliding = cube.velocity.z < -0.01 ? sliding + 1 : 0;
            if (sliding > 0) continue;
            std::vector<GripSample> all, of_finger;
            for (std::size_t f = 0; f < s.fingers.size(); ++f) {
                read_grip(s, f, 0, of_finger);
                all.insert(all.end(), of_finger.begin(), of_finger.end());
            }
            capacity = grasp_capacity(all, cube.mass, s.world.gravity);
            share = cube.mass * 9.81 / (0.5 * normal);
        }
        std::printf("%s: slips at %.3f of 2 mu N, at %.3f of the limit of the grasp\n", preset, share, 1 / capacity);
        EXPECT_EQ(sliding, 4) << preset;
        EXPECT_LT(share, 1) << preset;
        EXPECT_GT(1 / capacity, 0.95) << preset << ": slips early";
        EXPECT_LT(1 / capacity, 1 + 1e-3) << preset << ": holds more than friction does";
    }
}

}  // namespace
}  // namespace palpate
