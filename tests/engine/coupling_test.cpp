// The virtual coupling: a bone that nothing holds goes where it is drawn, and nothing is drawn harder than it may be.

#include <gtest/gtest.h>

#include "tests/engine/lab.h"

namespace palpate {
namespace {

using namespace testing;

/// A finger above a table, or far from everything.
SceneSpec finger_above_table(double stiffness, double max_force, double dt, bool table) {
    SceneSpec spec;
    spec.solver.dt = dt;
    spec.gravity = {0, 0, 0};
    spec.fingers.push_back(finger({{0, 0, 0.02}, upright}));
    Coupling& c = spec.fingers[0].coupling;
    c.stiffness = stiffness, c.angular_stiffness = stiffness / 1000, c.max_force = max_force;
    if (table) spec.objects.push_back({"table", {ShapeKind::plane, {}}, Pose<double>::identity(), 0.5});
    return spec;
}

TEST(Coupling, ABoneThatNothingHoldsArrivesAtAnyStiffnessAndStep) {
    for (double stiffness : {2e3, 1e5, 1e6, 1e7})
        for (double dt : {1e-3, 5e-3, 20e-3})
            for (bool near : {false, true})
                for (bool single : {false, true}) {
                    SceneSpec spec = finger_above_table(stiffness, 50, dt, near);
                    spec.fingers[0].single_precision = single;
                    if (near) spec.fingers[0].start.position.z = 0.003;  // its skin is solved there
                    Lab lab(spec);
                    const Pose<double> start = spec.fingers[0].start;
                    double farthest = 0, most = 0;
                    for (int k = 0; k * dt < 0.2; ++k) {
                        lab.run(dt, [&](double t, World&) {
                            lab.target(0).position.x = start.position.x + 0.5 * t;
                            const double half = 2 * t;  // 4 rad/s
                            lab.target(0).rotation = {std::cos(half), 0, 0, std::sin(half)};
                        });
                        const Pose<double> bone = bone_pose(lab.world, lab.world.skins.owner(0));
                        const Pose<double>& target = lab.world.couplings[0].target;
                        farthest = std::max(farthest, norm(bone.position - target.position));
                        most = std::max(most, norm((bone.rotation * conjugate(target.rotation)).vector()));
                    }
                    EXPECT_LT(farthest, 1e-3) << stiffness << " N/m, " << 1e3 * dt << " ms, near " << near << single;
                    EXPECT_LT(most, 0.02) << stiffness << " N/m, " << 1e3 * dt << " ms, near " << near << single;
                }
}

TEST(Coupling, NothingIsDrawnHarderThanItMayBe) {
    for (double stiffness : {2e3, 1e5, 1e6})
        for (double dt : {1e-3, 5e-3, 20e-3}) {
            const double max_force = 4;
            Lab lab(finger_above_table(stiffness, max_force, dt, true));
            double most = 0, drawn = 0, final_force = 0;
            int unconverged = 0, steps = 0;
            for (int k = 0; k * dt < 0.4; ++k, ++steps) {
                lab.run(dt, [&](double t, World&) { lab.target(0).position.z = std::max(-0.03, 0.02 - 0.4 * t); });
                drawn = std::max(drawn, lab.world.couplings[0].force_N);
                unconverged += !skin_status(lab.world, lab.world.skins.owner(0)).converged;
                final_force = lab.world.contact_surfaces[0].total.z;
                most = std::max(most, final_force);
            }
            EXPECT_LE(drawn, max_force * (1 + 1e-9)) << stiffness << " N/m, " << 1e3 * dt << " ms";
            EXPECT_NEAR(final_force, max_force, 0.01 * max_force) << stiffness << " N/m, " << 1e3 * dt << " ms";
            EXPECT_LE(unconverged, 2 + steps / 20) << stiffness << " N/m, " << 1e3 * dt << " ms";
            std::printf("%7.0f N/mm, %2.0f ms: drawn %.3f N at most, contact %.3f, then %.4f; %d of %d not converged\n",
                        stiffness / 1e3, 1e3 * dt, drawn, most, final_force, unconverged, steps);
        }
}

TEST(Coupling, AStiffOnePressesAsDeepAsItIsTold) {
    double first = 0;
    for (double stiffness : {1e6, 1e7})
        for (double dt : {1e-3, 5e-3, 20e-3}) {
            Lab lab(finger_above_table(stiffness, 50, dt, true));
            lab.run(0.4, [&](double t, World&) { lab.target(0).position.z = std::max(0.002, 0.02 - 0.2 * t); });
            const double force = lab.world.contact_surfaces[0].total.z;
            if (first == 0) first = force;
            EXPECT_GT(force, 0.1);
            EXPECT_NEAR(force, first, 0.01 * first) << stiffness << " N/m, " << 1e3 * dt << " ms";
        }
}

/// A hand that was 20 mm deep in a table, and comes back, has its bone with it at once, however stiff and weak the
/// coupling is that left the bone behind.
TEST(Coupling, ABoneThatWasHeldBackArrivesOnceNothingHoldsIt) {
    for (double stiffness : {2e3, 1e5, 1e6, 1e7})
        for (double dt : {1e-3, 5e-3, 20e-3}) {
            Lab lab(finger_above_table(stiffness, 0.7, dt, true));
            lab.run(0.7, [&](double t, World&) {
                lab.target(0).position.z = 0.02 - (t < 0.2 ? std::min(0.04, 0.4 * t) : std::max(0.0, 0.12 - 0.4 * t));
            });
            const Pose<double> bone = bone_pose(lab.world, lab.world.skins.owner(0));
            EXPECT_LT(norm(bone.position - lab.world.couplings[0].target.position), 1e-5)
                << stiffness << " N/m, " << 1e3 * dt << " ms";
        }
}

}  // namespace
}  // namespace palpate
