// No solve gives energy away: a ball that falls on a finger never comes back with more than it brought, whatever the
// preset, the step, its mass and how stiffly the bone is held.

#include "meshes/finger_regions.h"
#include "meshes/finger_shape.h"
#include "meshes/tetrahedralise.h"
#include "scenes/load/presets.h"
#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

TetMesh finger_of(int elements) {
    TetMesh mesh = tetrahedralise(finger_surface(finger_shape("index")), {.elements = elements});
    mark_regions(mesh, {});
    return mesh;
}

struct Drop {
    int preset = 0;
    double dt = 1e-3;        ///< [s]
    double stiffness = 1e5;  ///< of the coupling [N/m]
    double mass = 0.05;      ///< of the ball [kg]
    double speed = 2;        ///< at which it meets the finger [m/s]
    bool single_precision = false;
    bool curved = false;  ///< the finger's skin is round between nodes
};

/// Share of its energy with which the ball comes back, at most.
double energy_back(const Drop& d) {
    static const TetMesh mesh = finger_of(347);
    SceneSpec spec;
    spec.gravity = {0, 0, 0};
    spec.solver.dt = d.dt;
    apply_preset(d.preset, spec.solver);
    FingerSpec f;
    f.name = "index";
    f.mesh = mesh;
    f.mesh.curved_skin = d.curved;
    f.has_limits = true;
    f.single_precision = d.single_precision;
    f.coupling.stiffness = d.stiffness;
    f.coupling.max_force = 1e5;
    f.start = {{0, 0, 0}, about_x(3.14159265358979)};
    spec.fingers.push_back(f);
    ObjectSpec o = body(ball, d.mass, {0, 0, 0.0205});
    o.body->velocity = {0, 0, -d.speed};
    spec.objects.push_back(o);
    Lab lab(spec);
    const double first = 0.5 * d.mass * d.speed * d.speed;
    double most = 0;
    const auto steps = std::min(60000.0, 0.06 / d.dt);
    for (int k = 0; k < steps; ++k) {
        lab.run(d.dt);
        const RigidBody& b = lab.world.bodies[0];
        const double now = 0.5 * b.mass * dot(b.velocity, b.velocity) +
                           0.5 * dot(angular_velocity(b, lab.world.shapes[0].pose.rotation), b.angular_momentum);
        if (k > 0) most = std::max(most, now / first);
        if (dot(b.velocity, lab.world.shapes[0].pose.position) > 0 && norm(lab.world.shapes[0].pose.position) > 0.024)
            return now / first;
    }
    return most;
}

TEST(Energy, NoPresetGainsAny) {
    bool curved = false;
    int number = 0;
    for (int preset = 0; preset < 3; ++preset)
        for (double dt : {0.05e-3, 0.2e-3, 1e-3, 5e-3, 20e-3})
            for (double stiffness : {2e3, 1e5, 1e6})
                for (double mass : {1e-3, 0.05, 0.5}) {
                    if (dt < 0.1e-3 && stiffness < 1e5) continue;  // long and soft: gained none before either
                    curved = !curved;                              // by turns
                    if (!testing::is_tried(number++, 17)) continue;
                    EXPECT_LT(energy_back({preset, dt, stiffness, mass, 2, false, curved}), 1.005)
                        << preset << " " << dt << " " << stiffness << " " << mass << " " << curved;
                }
}

/// A ball falls beside the middle of a finger, so far in a step that it passes the skin's curve: contact at the end of
/// its way pushes along it.
TEST(Energy, LongStepsPastWhatIsRoundGiveABodyNone) {
    int number = 0;
    for (double dt : {5e-3, 10e-3, 20e-3})
        for (double aside : {1e-3, 3e-3, 5e-3})
            for (double mass : {1e-3, 3e-3, 30e-3}) {
                if (!testing::is_tried(number++, 3)) continue;
                SceneSpec spec;
                spec.solver.dt = dt;
                apply_preset(2, spec.solver);
                FingerSpec f;
                f.name = "index";
                f.mesh = finger_of(120);
                f.mesh.curved_skin = aside > 2e-3;
                f.has_limits = true;
                f.start = {{0, 0, 0}, about_x(3.14159265358979)};
                spec.fingers.push_back(f);
                spec.objects.push_back(body(ball, mass, {0, aside, 0.04}, 0.8));
                Lab lab(spec);
                auto energy = [&] {
                    const RigidBody& b = lab.world.bodies[0];
                    return kinetic_energy(b, lab.world.shapes[0].pose.rotation) +
                           mass * g * lab.world.shapes[0].pose.position.z;
                };
                const double first = energy();
                for (int k = 0; k < 20; ++k) {
                    lab.run(dt);
                    ASSERT_LT(energy(), first + 1e-4 * mass * g)
                        << 1e3 * dt << " ms, " << 1e3 * aside << " mm aside, " << mass << " kg, step " << k;
                }
            }
}

}  // namespace
}  // namespace palpate
