// What thimbles are told, and what is said of it: commanded forces, distances, limits, speeds, names.

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/run/simulation.h"
#include "scenes/run/summary.h"
#include "tests/support.h"

namespace palpate {
namespace {

const std::atomic<bool> to_the_end{false};
const std::string round_object = "[[object]]\nkind = \"sphere\"\nradius_mm = 25\nposition_mm = [0, -6, -25]\n",
                  flat_object = "[[object]]\nkind = \"plane\"\n";

/// A finger of such a device that goes along a track. Steps of 5 ms.
Simulation worn(const std::string& objects, const std::string& device, const std::string& track, double duration = 0.4,
                double dt_ms = 5) {
    return make_simulation(
        load_scene_text("duration_s = " + std::to_string(duration) + "\ndt_ms = " + std::to_string(dt_ms) + "\n" +
                            objects + "[[finger]]\nname = \"f\"\nshape = { finger = \"index\" }\ndevice = { " + device +
                            " }\ntrack = [ " + track + " ]\n",
                        "worn.toml"),
        1);
}
std::string key_at(double t, const std::string& position, const std::string& rotation = "[0, 0, 0]") {
    return "{ t_s = " + std::to_string(t) + ", position_mm = " + position + ", rotation_deg = " + rotation + " }, ";
}

/// Calls visit(matching, time since the match before) after each match.
template <class Visit>
void at_matches(Simulation& s, Visit visit) {
    double last = 0;
    while (s.world.time < s.scene.duration - 1e-9) {
        advance(s);
        if (!s.world.matchings[0].fresh) continue;
        visit(s.world.matchings[0], s.world.time - last);
        last = s.world.time;
    }
}

TEST(Thimbles, WhatIsSaidOfForceMatchingIsSaidOfWhatIsCommanded) {
    Simulation s = worn(round_object, R"(kind = "chinello-3rrs", method = "force", period_ms = 5)",
                        key_at(0, "[2, 0, 9.5]") + key_at(0.3, "[2, 0, 6.5]", "[25, 10, 60]"));
    double apart = 0;
    int touching = 0;
    at_matches(s, [&](const Matching& m, double) {
        if (m.result.status == MatchingStatus::no_contact) return;
        const Platform platform = m.model.kind->platform(m.model, m.result.w);
        double sum = 0, weights = 0;
        for (const MatchingPoint& p : m.points) {
            if (!p.touches) continue;
            const double d = disk_distance(p.position, platform, m.model.disk_radius).value;
            sum += p.weight * d * d, weights += p.weight;
        }
        EXPECT_NEAR(m.result.rms_m, std::sqrt(sum / weights), 1e-12) << s.world.time;
        EXPECT_NEAR(m.result.residual, matching_objective(m.model, m.points, m.settings, m.result.w, m.result.w).value,
                    1e-5 * (1 + m.result.residual));
        apart = std::max(apart, std::abs(m.result.rms_m - m.geometric.rms_m));
        ++touching;
    });
    EXPECT_GT(touching, 20);
    EXPECT_GT(apart, 2e-5) << "the geometric match is another";
}

TEST(Thimbles, ForceModeLeavesOutWhatPressesFromBesideThePad) {
    const std::string wall = "[[object]]\nkind = \"plane\"\nposition_mm = [0, 6.8, 0]\nrotation_deg = [74, 0, 0]\n";
    Simulation s = worn(flat_object + wall, R"(kind = "serial-3dof", mode = "force", period_ms = 5)",
                        key_at(0, "[0, -3, 9.2]") + key_at(0.2, "[0, 1.0, 7.9]"));
    run(s, to_the_end, {});
    const Matching& m = s.world.matchings[0];
    const ContactSurface& c = *s.world.contact_surfaces.find(m.finger);
    ASSERT_GT(m.beside_N, 0.05);
    const Eigen::Vector3d n = m.model.mount.linear() * m.model.kind->platform(m.model, m.result.w).normal;
    const Vec3<double> normal = rotation_matrix(c.bone.rotation) * Vec3<double>{n.x(), n.y(), n.z()};
    double wanted = 0;
    for (std::size_t k = 0; k < c.force.size(); ++k)
        if (m.points[k].touches) wanted += dot(c.force[k], normal);
    EXPECT_NEAR(m.force_N, wanted, 1e-6);
    EXPECT_LT(m.force_N, 0.7 * dot(c.total, normal));
}

TEST(Thimbles, ASpeedLimitIsNotTheEdgeOfTheWorkspace) {
    for (const std::string method : {"constrained", "force"}) {
        Simulation s =
            worn(flat_object,
                 "kind = \"chinello-3rrs\", joint_speed_deg_per_s = 60, period_ms = 20, method = \"" + method + "\"",
                 key_at(0, "[2, 0, 9.2]") + key_at(0.2, "[2, 0, 6.5]", "[20, 0, 0]"), 0.5);
        int touching = 0;
        at_matches(s, [&](const Matching& m, double) {
            touching += m.result.status != MatchingStatus::no_contact;
            EXPECT_EQ(m.result.constraint_active, joint_margins(m.model, m.result.q).minCoeff() < 1e-5);
        });
        EXPECT_GT(touching, 10);
        EXPECT_EQ(s.world.matchings[0].constrained_solves, 0) << method;
    }
}

TEST(Thimbles, LimitsWiderThanTheKindsAreThoseOfEveryMethod) {
    for (const std::string way : {R"(method = "constrained")", R"(method = "unconstrained")", R"(method = "plane")",
                                  R"(solver = "multistart")"})
        for (const double limit : {80, 45}) {
            const std::string degrees = std::to_string(limit);
            Simulation s = worn(
                flat_object,
                "kind = \"serial-3dof\", joint_min_deg = -" + degrees + ", joint_max_deg = " + degrees + ", " + way,
                key_at(0, "[2, 0, 9.2]") + key_at(0.2, "[2, 0, 6.8]", "[52, 0, 0]"));
            run(s, to_the_end, {});
            const MatchingResult& r = s.world.matchings[0].result;
            EXPECT_NEAR(r.q[2] / degree, limit > 52 ? -52 : -limit, 0.5) << way;
            EXPECT_EQ(r.constraint_active, limit < 52) << way;
        }
}

TEST(Thimbles, ASimulatedServoReachesAllThatItsJointMayDo) {
    for (const double roll : {25.0, -25.0}) {
        Simulation s =
            worn(flat_object, "kind = \"cable-3\"",
                 key_at(0, "[2, 0, 9]") + key_at(0.2, "[2, 0, 6.0]", "[" + std::to_string(roll) + ", 0, 0]"), 0.9);
        run(s, to_the_end, {});
        const Series& series = s.finger_series[0];
        const auto last = [&](const std::string& column) {
            const auto at = std::find(series.columns.begin(), series.columns.end(), column);
            return series.at(series.rows() - 1, std::size_t(at - series.columns.begin()));
        };
        double farthest = 0;
        for (const char* joint : {"1_deg", "2_deg", "3_deg"}) {
            const double wanted = last(std::string("q") + joint), reached = last(std::string("servo") + joint);
            EXPECT_NEAR(reached, wanted, 0.1) << roll;
            farthest = std::max(farthest, std::abs(wanted));
        }
        EXPECT_GT(farthest, 60) << "beyond 45 degrees, where a pulse of 1 to 2 ms ends";
    }
}

/// The farthest that a joint goes from one match to the next after a time [degrees].
double farthest_step(Simulation& s, double after) {
    Coordinates last;
    double farthest = 0;
    at_matches(s, [&](const Matching& m, double) {
        if (last.size() && s.world.time > after)
            farthest = std::max(farthest, (m.result.q - last).cwiseAbs().maxCoeff() / degree);
        last = m.result.q;
    });
    return farthest;
}

/// What no force tells, such as where along itself a platform lies, followed the rounding of solves, for ever.
TEST(Thimbles, NothingMovesWhileTheFingerRests) {
    struct {
        const char *scene, *kind;
        double from, until;  ///< [s]
    } const cases[] = {{"edge", "chinello-3rrs", 0.5, 0.9},
                       {"edge", "cable-3", 0.5, 0.9},
                       {"edge", "serial-6dof", 0.5, 0.9},
                       {"press", "serial-5dof", 0.5, 0.9},
                       {"edge", "serial-5dof", 1.6, 2.2}};  // finds better poses for a while
    int number = 0;
    for (const auto& c : cases) {
        if (!testing::is_tried(number++, 2)) continue;
        Simulation s =
            make_simulation(load_scene(testing::scenes + c.scene + ".toml",
                                       {"finger.index.device.kind=" + std::string(c.kind),
                                        "finger.index.device.method=force", "duration_s=" + std::to_string(c.until)}),
                            1);
        EXPECT_LT(farthest_step(s, c.from), 0.01) << c.scene << " " << c.kind;
    }
}

TEST(Thimbles, JointsKeepTheirSpeedWhateverStepsAndPeriods) {
    const double periods[][2] = {{5, 9}, {50, 20}, {5, 20}};
    for (const auto& [dt_ms, period_ms] : periods) {
        Simulation s = worn(
            flat_object, "kind = \"serial-3dof\", joint_speed_deg_per_s = 60, period_ms = " + std::to_string(period_ms),
            key_at(0, "[2, 0, 9.2]") + key_at(0.2, "[2, 0, 6.5]", "[20, 0, 0]"), 0.6, dt_ms);
        Coordinates last;
        double fastest = 0;
        at_matches(s, [&](const Matching& m, double since) {
            if (last.size()) fastest = std::max(fastest, (m.result.q - last).cwiseAbs().maxCoeff() / degree / since);
            last = m.result.q;
        });
        EXPECT_LT(fastest, 60.01) << dt_ms << " " << period_ms;
        EXPECT_GT(fastest, 59) << "and use it: " << dt_ms << " " << period_ms;
    }
}

TEST(Thimbles, NamesOfJointsAreNamesOfColumns) {
    const auto said = [](const std::string& first, const std::string& second) -> std::string {
        try {
            worn(flat_object,
                 "kind = \"chain\", joint = [ { name = \"" + first +
                     "\", slides = true, min_deg = -35, max_deg = 35 }, { name = \"" + second +
                     "\", axis = [1, 0, 0], min_deg = -40, max_deg = 40 } ]",
                 key_at(0, "[2, 0, 9]"));
        } catch (const InputError& error) { return error.what(); }
        return "";
    };
    EXPECT_EQ(said("lift", "roll"), "");
    EXPECT_EQ(said("q", "servo 2"), "");
    for (const char* name : {"", "lift\\nx", "a,b", "a\\\"b"}) {
        EXPECT_NE(said(name, "roll").find("worn.toml:"), std::string::npos) << name;
        EXPECT_NE(said(name, "roll").find("name"), std::string::npos) << name;
    }
    EXPECT_NE(said("lift", "lift").find("two joints are called 'lift'"), std::string::npos);
    for (const char* name : {"q2", "sent1", "servo1"})
        EXPECT_NE(said(name, "roll").find("choose another name"), std::string::npos) << name;
}

/// One frame of a mat of 4 x 4 cells that bear so many counts each.
std::string mat_frame(int count) {
    std::string text = "Frame 1\n";
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) text += std::to_string(count) + (column < 3 ? "," : "\n");
    return text;
}

TEST(PressureCommand, NothingIsSaidOfWhatWasNotCompared) {
    testing::ScratchFolder scratch;
    write_file(scratch.path / "light.csv", mat_frame(3));   // 0.2 N
    write_file(scratch.path / "heavy.csv", mat_frame(20));  // 1.5 N
    const auto pressure = [&](const std::string& arguments) {
        return testing::palpate_program("pressure " + (scratch.path / arguments).string() +
                                        " --angle 0 --elements 300 --out ''");
    };
    const auto light = nlohmann::json::parse(pressure("light.csv --json").out);
    EXPECT_EQ(light["maps_compared"], 0);
    EXPECT_TRUE(light["middle_error"].is_null() && light["peak_error"].is_null());
    const std::string words = pressure("light.csv").out;
    EXPECT_NE(words.find("nothing was compared"), std::string::npos) << words;
    EXPECT_EQ(words.find("0 %"), std::string::npos) << words;
    const auto heavy = nlohmann::json::parse(pressure("heavy.csv --json").out);
    EXPECT_EQ(heavy["maps_compared"], 1);
    EXPECT_TRUE(heavy["middle_error"].is_number() && heavy["peak_error"].is_number());
    const auto few = nlohmann::json::parse(pressure("heavy.csv --json --cells 2 --cell-mm 7.5").out);
    EXPECT_TRUE(few["middle_error"].is_null() && few["maps"][0]["middle_measured"].is_null());
    EXPECT_TRUE(few["peak_error"].is_number());
    const std::string cells = pressure("heavy.csv --cells 2 --cell-mm 7.5").out;
    EXPECT_EQ(cells.find("nan"), std::string::npos) << cells;
    EXPECT_NE(cells.find("middle cells nothing can be said"), std::string::npos) << cells;
}

}  // namespace
}  // namespace palpate
