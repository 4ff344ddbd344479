// Newton matrices that are kept from step to step: they change what a step costs, and nothing else.

#include "engine/skin/solve/skin_step.h"

#include "engine/skin/chunks/level_of_detail.h"
#include "engine/step.h"
#include "scenes/trackers/trajectory.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::block_mesh;

/// A block with limits above a table.
SceneSpec pressed_block(int stiffness_steps, double tolerance) {
    SceneSpec spec;
    spec.solver.dt = 1e-3;
    spec.solver.tolerance = tolerance;
    spec.solver.multiplier_tolerance = 10 * tolerance;
    spec.solver.stiffness_steps = stiffness_steps;
    FingerSpec f;
    f.name = "block";
    f.mesh = block_mesh(4, 3, 3, 0.004);
    f.has_limits = true;
    f.limit_low = {0.75};
    f.limit_high = {1.25};
    f.start.position.z = 0.0061;
    spec.fingers.push_back(f);
    spec.objects.push_back({"table", {}, Pose<double>::identity(), 0.5});
    return spec;
}

/// Aims the bone: lower than at the start, aside, turned.
void aim(World& w, double lower, double aside, double pitch, double yaw) {
    TrackerPose& tracker = w.tracker_poses[0];
    Pose<double>& target = tracker.incoming.pose;
    target = w.skins[0].start;
    target.position.z -= lower;
    target.position.x += aside;
    target.rotation = from_roll_pitch_yaw(0, pitch, yaw);
    tracker.incoming.time = w.time;
    tracker.incoming.valid = true;
}

/// Pressed by 2.5 mm, rubbed, turned, and lifted again.
struct Rubbed {
    std::vector<Vec3<double>> force;
    double iterations = 0, unconverged = 0;
};
Rubbed rub(int stiffness_steps, double tolerance) {
    World w = build_world(pressed_block(stiffness_steps, tolerance));
    Threads threads(1);
    Rubbed out;
    for (int i = 0; i < 300; ++i) {
        const double t = i / 300.0, down = std::min(1.0, 4 * t) - std::max(0.0, 10 * t - 9);
        aim(w, 0.0025 * down, 0.002 * std::sin(9 * t), 0.1 * t, 0.2 * std::sin(5 * t));
        step(w, threads);
        const SkinStatus s = skin_status(w, w.skins.owner(0));
        out.force.push_back(w.contact_surfaces[0].total);
        out.iterations += s.newton_iterations;
        out.unconverged += !s.converged;
    }
    return out;
}

TEST(KeptMatrix, LeadsToTheSameForces) {
    const Rubbed own = rub(1, 1e-6), kept = rub(16, 1e-6);
    double largest = 0, off = 0;
    for (std::size_t i = 0; i < own.force.size(); ++i) {
        largest = std::max(largest, norm(own.force[i]));
        off = std::max(off, norm(kept.force[i] - own.force[i]));
    }
    EXPECT_GT(largest, 1.0);
    EXPECT_LT(own.unconverged, 5);  // multipliers that are still on their way after 200 iterations
    EXPECT_EQ(kept.unconverged, own.unconverged);
    EXPECT_LT(off, 1e-4 * largest);
    // And hardly more iterations: what is kept for two of them only, and not where limits begin to act.
    EXPECT_LT(kept.iterations, 1.5 * own.iterations);
}

/// Slowly moved, skin hardly needs a matrix of its own in any step.
TEST(KeptMatrix, IsKept) {
    auto assembled = [](int stiffness_steps) {
        SceneSpec spec = pressed_block(stiffness_steps, 1e-4);
        spec.solver.newton_iterations = 2;
        World w = build_world(spec);
        Threads threads(1);
        int own = 0;
        for (int i = 0; i < 160; ++i) {
            aim(w, 0.0025 * std::min(1.0, i / 80.0), 0, 0, 0);
            step(w, threads);
            if (i >= 96) own += w.chunks.doubles[0].state.matrix_kept[0] < 2;
        }
        return own;
    };
    EXPECT_EQ(assembled(1), 64);
    EXPECT_LT(assembled(16), 10);  // in every sixteenth; what converges at once may not be counted
    EXPECT_LT(assembled(64), 6);
}

/// What contact adds to a kept matrix is what it adds to a new one: on free nodes, and on nodes of the bone.
TEST(KeptMatrix, HasContactAsANewOneHas) {
    TetMesh mesh = block_mesh(3, 2, 2, 0.004);
    mesh.pad_nodes.insert(mesh.pad_nodes.end(), {mesh.bone_nodes[0], mesh.bone_nodes[3]});
    std::sort(mesh.pad_nodes.begin(), mesh.pad_nodes.end());
    auto c = testing::make_chunk<double>(mesh, Pose<double>::identity(), {.friction = true});
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0, 2e-4);
    for (int u : c.topology->unknowns)
        if (u < c.topology->node_count)
            for (int d = 0; d < 3; ++d) c.state.position[std::size_t(3 * u + d)] += noise(random);
    const SolverSettings s;
    choose_matrices(c, SolverSettings{.stiffness_steps = 16}, 1);
    ASSERT_TRUE(c.keeps_matrix);
    auto table_at = [&](double height) {
        const Pose<double> pose{{0, 0, height}, from_roll_pitch_yaw(0.2, 0.1, 0)};
        testing::touch_all(c, {0, {}, pose, pose, 0.5});
        begin_slots(c, s);
    };
    auto matrix = [&](bool renew) {
        detail::evaluate_keeping<double>(c, s, 0.0, {true, renew, true, 0.0});
        EXPECT_EQ(c.state.matrix_kept[0], renew ? 1 : 2);
        return c.scratch.blocks;
    };
    table_at(-1);
    const auto without = matrix(true);
    table_at(0.03);  // above all of it
    const auto kept = matrix(false), own = matrix(true);
    double largest = 0, added = 0, off = 0;
    for (int b = 0; b < c.topology->pattern.block_count; ++b)
        for (std::size_t i = 9 * std::size_t(b); i < 9 * std::size_t(b) + 9; ++i) {
            if (!c.topology->pattern.in_matrix(b)) continue;
            largest = std::max(largest, std::abs(own[i]));
            added = std::max(added, std::abs(own[i] - without[i]));
            off = std::max(off, std::abs(own[i] - kept[i]));
        }
    EXPECT_GT(added, 0.1 * largest);
    EXPECT_LT(off, 1e-12 * largest);
}

}  // namespace
}  // namespace palpate
