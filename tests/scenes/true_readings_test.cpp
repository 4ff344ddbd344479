// What summaries, plots and comparisons say is what happened.

#include <algorithm>
#include <nlohmann/json.hpp>

#include "meshes/mesh_files.h"
#include "scenes/run/finger_output.h"
#include "scenes/run/summary.h"
#include "scenes/studies/compare.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::scenes;
const std::atomic<bool> stop{false};

std::size_t column_of(const Series& s, const std::string& name) {
    return std::size_t(std::find(s.columns.begin(), s.columns.end(), name) - s.columns.begin());
}

TEST(TrueReadings, AStepThatIsNotSettledIsCountedAndIsNoPeak) {
    Simulation s = make_simulation(load_scene(scenes + "press.toml"), 1);
    run(s, stop, {});
    const FingerSummary before = summarise(s).fingers[0];
    EXPECT_EQ(before.unsettled_steps, 0);
    // One spike, as a solve that was cut short gives: much of the force is not balanced.
    Series& series = s.finger_series[0];
    double* row = &series.values[60 * series.columns.size()];
    row[column_of(series, "contact_force_N")] = 437;
    row[column_of(series, "residual_N")] = 420;
    row[column_of(series, "converged")] = 0;
    const Summary after = summarise(s);
    EXPECT_EQ(after.fingers[0].peak_force_N, before.peak_force_N);
    EXPECT_NEAR(after.fingers[0].mean_force_N, before.mean_force_N, 0.05 * before.mean_force_N);
    EXPECT_EQ(after.fingers[0].unsettled_steps, 1);
    EXPECT_EQ(after.fingers[0].unsettled_peak_N, 437);
    EXPECT_NE(to_text(after).find("they reported up to 437.000 N"), std::string::npos);
    // Not converged, but nearly balanced: true to that much.
    row[column_of(series, "residual_N")] = 1e-4;
    EXPECT_EQ(summarise(s).fingers[0].peak_force_N, 437);
}

/// A summary's text without its line breaks, of which none is beyond 80 columns.
std::string in_words(const Summary& summary) {
    std::istringstream lines(to_text(summary));
    std::string all, line;
    while (std::getline(lines, line)) {
        EXPECT_LT(line.size(), 80u) << line;
        all += line.substr(std::min(line.size(), line.find_first_not_of(' '))) + " ";
    }
    return all;
}

TEST(TrueReadings, WhatTheSolverHadToDoIsSaid) {
    Simulation s = make_simulation(load_scene(scenes + "hand.toml", {"solver.newton_iterations=1", "dt_ms=20"}), 2);
    run(s, stop, {});
    std::int64_t extended = 0, rough = 0, uphill = 0;
    for (const FingerSummary& f : summarise(s).fingers) {
        extended += f.extended_steps, rough += f.rough_steps, uphill += f.uphill_steps;
        EXPECT_EQ(f.wrong_side_steps, 0);
        EXPECT_EQ(f.resets, 0);
    }
    EXPECT_GT(extended, 0);
    EXPECT_GT(rough, extended);
    EXPECT_EQ(uphill, 0);  // since a step that a waking penalty leads uphill ends at its parabola's lowest point
    s.finger_counts[0].uphill_steps = 7;
    EXPECT_NE(in_words(summarise(s)).find("a Newton step led uphill"), std::string::npos);
    EXPECT_NE(in_words(summarise(s)).find("more iterations than their preset has"), std::string::npos);
    s.finger_counts[0].wrong_side_steps = 3;
    s.world.contact_surfaces.find(s.fingers[0])->rough_steps = 1000002;
    const std::string text = in_words(summarise(s));
    EXPECT_NE(text.find("in 3 steps an object pressed on it from inside its skin"), std::string::npos);
    EXPECT_NE(text.find("up to 1000002 steps ended too far from balance to be sent"), std::string::npos);
    EXPECT_EQ(to_json(summarise(s))["fingers"][0]["wrong_side_steps"], 3);
}

TEST(TrueReadings, FrictionPressesNothing) {
    // Over an object that gives way, pressure is stiffness times depth, however much rubs.
    for (const char* friction : {"0", "1"}) {
        Simulation s = make_simulation(
            load_scene_text(
                "duration_s = 0.25\ndt_ms = 5\n[limits]\nlow = 0.6\nhigh = 1.4\n"
                "[[object]]\nname = \"table\"\nstiffness_kPa_per_mm = 15\nfriction = " +
                    std::string(friction) +
                    "\n[[finger]]\nname = \"f\"\nshape = { finger = \"index\" }\n"
                    "track = [ { t_s = 0, position_mm = [0, 0, 9] }, "
                    "{ t_s = 0.1, position_mm = [0, 0, 6.5] }, { t_s = 0.3, position_mm = [20, 0, 6.5] } ]\n",
                "winkler.toml"),
            1);
        run(s, stop, {});
        const ContactSurface& c = *s.world.contact_surfaces.find(s.fingers[0]);
        double deepest = 0, weight = 0, across = 0;
        for (std::size_t k = 0; k < c.force.size(); ++k) {
            const Vec3<double> place = sample_place(c, k);
            deepest = std::max(deepest, -place.z);
            weight += c.pressing[k].z, across += c.pressing[k].z * place.x;
        }
        const double pressure = 1e-3 * 15e6 * deepest;  // [kPa]
        EXPECT_NEAR(s.finger_series[0].column("pressure_peak_kPa").back(), pressure, 1e-3 * pressure) << friction;
        EXPECT_NEAR(s.finger_series[0].column("centre_x_mm").back(), 1e3 * across / weight, 1e-6) << friction;
        EXPECT_NEAR(std::abs(c.total.x), std::stod(friction) * c.normal_force, 0.2 * c.normal_force) << "it slides";
    }
}

TEST(TrueReadings, ABallThatConformingFingersHoldComesToRest) {
    std::vector<std::string> settings{"solver.preset=balanced"};
    for (const std::string finger : {"thumb", "index", "middle", "ring", "little"}) {
        settings.push_back("finger." + finger + ".mesh.kind=conforming");
        settings.push_back("finger." + finger + ".mesh.patch=5");
    }
    Simulation s = make_simulation(load_scene(scenes + "hold_ball.toml", settings), 2);
    run(s, stop, {});
    // It shook at 3 mm/s where penalties of strain limits were no larger than its inertia.
    const Series& series = s.body_series[0];
    double fastest = 0;
    for (std::size_t k = series.rows() * 3 / 4; k < series.rows(); ++k)
        for (const char* axis : {"v_x_mm_per_s", "v_y_mm_per_s", "v_z_mm_per_s"})
            fastest = std::max(fastest, std::abs(series.values[k * series.columns.size() + column_of(series, axis)]));
    EXPECT_LT(fastest, 0.1);
    EXPECT_GT(summarise(s).bodies.at(0).held_s, 2);
}

TEST(TrueReadings, ABodyThatShakesInTheFingersHasNotSlipped) {
    Simulation s = make_simulation(load_scene(scenes + "pinch.toml", {"solver.preset=fast"}), 2);
    run(s, stop, {});
    const BodySummary cube = summarise(s).bodies.at(0);
    EXPECT_GT(cube.held_s, 1);
    const Series& series = s.body_series[0];
    double way = 0, farthest = 0;
    for (std::size_t k = 0; k < series.rows(); ++k) {
        if (series.at(k, column_of(series, "held")) == 0) continue;
        way += 1e-3 * series.at(k, column_of(series, "index_slip_um"));
        farthest = std::max(farthest, series.at(k, column_of(series, "index_slid_mm")));
    }
    std::printf("to and fro %.3f mm, from where it was gripped %.3f mm\n", way, farthest);
    EXPECT_LT(cube.slip_mm, 0.2);
    EXPECT_LE(farthest, way + 1e-9);
    EXPECT_GE(cube.slip_mm, farthest - 1e-9);
}

TEST(TrueReadings, WhatSlipsThroughTheFingersHasSlipped) {
    Simulation s = make_simulation(load_scene(scenes + "egg.toml", {"object.egg.friction=0.32"}), 2);
    run(s, stop, {});
    EXPECT_GT(summarise(s).bodies.at(0).slip_mm, 1);
}

/// Of a uniform mesh: a conforming one has no bone at its surface.
TEST(TrueReadings, SkinOnTheBoneThatIsInsideATableIsSaid) {
    testing::ScratchFolder scratch;
    struct {
        double roll, height;
        bool inside;
    } const cases[] = {{0, 5.5, true}, {180, 5.5, true}, {0, 7.9, false}};  // the cut's rim, the nail, the pad alone
    for (const auto& [roll, height, inside] : cases) {
        write_file(scratch.path / "scene.toml", R"(
duration_s = 0.3
dt_ms = 5
[[object]]
name = "table"
kind = "plane"
[mesh]
kind = "uniform"
patch = 0
[[finger]]
name = "index"
shape = { finger = "index" }
track = [ { t_s = 0, position_mm = [0, 0, 9], rotation_deg = [)" +
                                                    std::to_string(roll) +
                                                    R"(, 0, 0] }, { t_s = 0.2, position_mm = [0, 0, )" +
                                                    std::to_string(height) + "] } ]\n");
        Simulation s = make_simulation(load_scene(scratch.path / "scene.toml"), 1);
        run(s, stop, {});
        const Summary summary = summarise(s);
        const FingerSummary& f = summary.fingers[0];
        const bool said = in_words(summary).find("mm inside an object") != std::string::npos;
        EXPECT_LT(f.worst_penetration_um, 10) << "the pad touches";
        EXPECT_EQ(said, inside) << roll << " " << height;
        if (inside)
            EXPECT_GT(f.fixed_penetration_um, 300) << roll;
        else
            EXPECT_LT(f.fixed_penetration_um, 10);
    }
}

TEST(TrueReadings, ShearThatNoPlatformRendersIsApartFromTheRest) {
    testing::ScratchFolder scratch;
    CompareOptions options;
    options.methods = {MatchingMethod::constrained};
    for (const double friction : {0.0, 0.8}) {
        // Pressed, then moved across: with friction the skin is sheared.
        write_file(scratch.path / "scene.toml", R"(
duration_s = 0.4
dt_ms = 5
[[object]]
name = "table"
kind = "plane"
friction = )" + std::to_string(friction) + R"(
[[finger]]
name = "index"
shape = { finger = "index" }
device = { kind = "chinello-3rrs" }
track = [
    { t_s = 0.0, position_mm = [0, 0, 9] },
    { t_s = 0.2, position_mm = [0, 0, 6.5] },
    { t_s = 0.4, position_mm = [0, 1, 6.5] },
]
)");
        Simulation s = make_simulation(load_scene(scratch.path / "scene.toml"), 2);
        const auto steps = compare(s, options, stop, {}).at(0);
        ASSERT_GT(steps.size(), 5u);
        for (const ComparedStep& row : steps) {
            const RenderingError& e = row.methods[0].error;
            EXPECT_LE(e.field_N, e.normal_N + e.shear_N + 1e-9);
            EXPECT_GE(e.field_N, std::max(e.normal_N, e.shear_N) - 1e-9);
            if (friction == 0) { EXPECT_LT(row.virtual_shear_N, 1e-6); }
        }
        if (friction == 0) continue;
        const ComparedStep& last = steps.back();
        EXPECT_GT(last.virtual_shear_N, 0.1 * last.virtual_force_N);
        EXPECT_NEAR(last.methods[0].error.shear_N, last.virtual_shear_N, 0.3 * last.virtual_shear_N);
        EXPECT_LT(last.methods[0].error.normal_N, last.methods[0].error.field_N);
    }
}

/// Fingers that close around something press on each other's sides, too. No platform can be there: one that tried
/// was drawn through the pad, and pressed with a thousand newtons.
TEST(TrueReadings, WhatPressesFromBesideThePadIsNotRenderedAndIsSaid) {
    CompareOptions options;
    options.methods = {MatchingMethod::constrained, MatchingMethod::force};
    for (const char* scene : {"hold_mug.toml", "hand.toml"}) {
        if (scene == std::string("hand.toml") && !testing::is_tried(1, 2)) continue;
        const std::string duration = scene == std::string("hand.toml") ? "duration_s=2" : "duration_s=0.6";
        Simulation s = make_simulation(load_scene(scenes + scene, {duration}), 2);
        const auto fingers = compare(s, options, stop, {});
        for (std::size_t i = 0; i < fingers.size(); ++i) {
            double geometric = 0, force = 0;
            for (const ComparedStep& row : fingers[i]) {
                // Shapes say nothing of forces: where the ring finger is touched lightly and far up its side, the
                // platform that matches best presses with 0.4 N of its own.
                for (const auto& [method, own] : {std::pair{0, 0.4}, {1, 0.15}})
                    EXPECT_LT(row.methods[std::size_t(method)].error.field_N, 1.3 * row.virtual_force_N + own)
                        << scene << " " << i << " " << row.time << " " << method;
                geometric += row.methods[0].error.field_N, force += row.methods[1].error.field_N;
            }
            EXPECT_LT(force, 1.05 * geometric) << scene << " finger " << i;
        }
        const Summary said = summarise(s);
        EXPECT_GT(said.fingers[2].beside_share, 0.1) << scene;
        EXPECT_NE(in_words(said).find("pressed on it from beside the pad"), std::string::npos);
    }
    Simulation alone = make_simulation(load_scene(scenes + "press.toml"), 1);
    run(alone, stop, {});
    EXPECT_EQ(summarise(alone).fingers[0].beside_share, 0);
}

}  // namespace
}  // namespace palpate
