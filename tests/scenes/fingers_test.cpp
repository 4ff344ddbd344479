// Finger files, indentation, calibration.

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "meshes/finger_shape.h"
#include "meshes/input_error.h"
#include "meshes/layers.h"
#include "meshes/mesh_quality.h"
#include "scenes/load/scene.h"
#include "scenes/load/section.h"
#include "scenes/studies/calibration.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::palpate_program;
constexpr double pi = 3.14159265358979, degree = pi / 180;

FingerModel named(const std::string& name) {
    FingerModel m;
    Problems problems;
    read_named_finger(name, "", m, problems);
    EXPECT_TRUE(problems.messages.empty()) << problems.messages.front();
    return m;
}

FingerSpec built(const FingerModel& m) {
    static FingerTemplates templates;
    std::string note;
    return build_finger(m, templates, note);
}

std::vector<IndentationCurve> pressed(const std::vector<Indentation>& fingers, IndentationSettings s = {.steps = 12}) {
    Threads threads(2);
    return indent(fingers, s, threads);
}

TEST(HullArea, OfADiscWithinWhichPointsLie) {
    std::vector<std::array<double, 2>> points;
    for (int k = 0; k < 400; ++k)
        for (const double r : {0.3, 0.5, 0.7})
            points.push_back({r * std::cos(2 * pi * k / 400), r * std::sin(2 * pi * k / 400)});
    EXPECT_NEAR(hull_area(points), pi * 0.49, 1e-4);
    EXPECT_EQ(hull_area({}), 0);
    EXPECT_EQ(hull_area({{0, 0}, {1, 1}}), 0);
}

TEST(Indentation, ForceGrowsWithDisplacementAndScalesWithStiffness) {
    FingerModel m = named("index-median");
    Indentation soft{built(m), 20 * degree}, stiff = soft;
    stiff.finger.name = "stiff";
    for (double& e : stiff.finger.element_young) e *= 2;
    for (double& e : stiff.finger.element_membrane) e *= 2;
    stiff.finger.skin_modulus *= 2;
    stiff.finger.young_modulus *= 2;
    const auto curves = pressed({soft, stiff});
    ASSERT_EQ(curves[0].points.size(), 13u);
    for (std::size_t k = 1; k < 13; ++k) {
        const IndentationPoint &a = curves[0].points[k], &b = curves[1].points[k];
        EXPECT_TRUE(a.converged && b.converged);
        EXPECT_GT(a.force, curves[0].points[k - 1].force);
        EXPECT_GT(a.displacement, curves[0].points[k - 1].displacement);
        EXPECT_GE(a.hull, 0.99 * a.area);  // the area is that of the skin, which rises towards its edge
        if (a.force > 2) break;            // then the clamp's own give, the same in both, counts
        const double force = field_at_displacement(curves[1], a.displacement, &IndentationPoint::force);
        // Its skin was as round as in the step before, which was not quite as deep.
        EXPECT_NEAR(force, 2 * a.force, 5e-3 * force);
        EXPECT_NEAR(b.area, a.area, 5e-3 * a.area);
    }
}

/// Statics know no length: twice the finger, pressed twice as deep, carries four times the force on four times the
/// area.
TEST(Indentation, AFingerTwiceAsLargeCarriesFourTimesTheForce) {
    FingerModel m = named("little-small");
    m.layers.clear();
    Indentation small{built(m), 20 * degree, 0, 1e-3};  // not as far as to its limits: the clamp has a length
    Indentation large = small;
    large.depth *= 2;
    for (Point& p : large.finger.mesh.nodes)
        for (double& x : p) x *= 2;
    const IndentationCurve a = pressed({small})[0], b = pressed({large})[0];
    for (std::size_t k = 4; k < a.points.size(); ++k) {
        EXPECT_NEAR(b.points[k].force, 4 * a.points[k].force, 0.01 * b.points[k].force);
        EXPECT_NEAR(b.points[k].area, 4 * a.points[k].area, 0.01 * b.points[k].area);
    }
}

TEST(Indentation, AFingerAloneAndBesideOthersGivesTheSameBits) {
    Indentation one{built(named("index-median")), 20 * degree}, other = one;
    other.finger.name = "other";
    other.finger.poisson_ratio = 0.4;
    const auto alone = pressed({one}), beside = pressed({other, one, other});
    for (std::size_t k = 0; k < alone[0].points.size(); ++k) {
        EXPECT_EQ(alone[0].points[k].force, beside[1].points[k].force);
        EXPECT_EQ(alone[0].points[k].area, beside[1].points[k].area);
    }
}

/// Soft tissue between limits runs far along a Newton step, into limits that the step knows nothing of. Without
/// directions that are corrected for them, 15 of these steps end off balance, the first at 8 N.
TEST(Indentation, APresetConvergesWhereItsLimitsCarryAHundredNewton) {
    for (const int angle : {0, 15, 30}) {
        const Indentation press{built(named("index-median")), angle * degree, 0, 3.2e-3};
        const IndentationCurve curve = pressed({press}, {.steps = 107, .force_limit = 100})[0];
        EXPECT_GT(curve.points.back().force, 100);
        for (const IndentationPoint& p : curve.points)
            EXPECT_TRUE(p.converged || p.force > 100) << p.force << " N at " << angle << " degrees";
    }
}

/// What meshes/README.md says of the default index finger, at the paper's mesh size and at a fine one.
/// Elements; degrees between finger and plate.
class IndexFinger : public ::testing::TestWithParam<std::tuple<int, int>> {};
INSTANTIATE_TEST_SUITE_P(Indentation, IndexFinger,
                         ::testing::Combine(::testing::Values(347, 4000), ::testing::Values(0, 30)));

TEST_P(IndexFinger, LiesInsideTheBands) {
    FingerModel model = named("index-median");
    model.mesh.elements = std::get<0>(GetParam());
    const Indentation press{built(model), std::get<1>(GetParam()) * degree, 0, 4e-3};
    Threads threads(2);
    const IndentationCurve curve = pressed({press}, {.steps = 120, .force_limit = 6})[0];
    const FingertipFigures f = fingertip_figures(press, curve, 0.8, threads);
    auto between = [](double v, double low, double high) { return v >= low && v <= high; };
    EXPECT_PRED3(between, 1e3 * f.displacement_1N, 1.2, 2.2);
    EXPECT_PRED3(between, 1e3 * f.displacement_4N, 1.8, 3.0);
    EXPECT_GE(f.stiffening, 2.5);
    EXPECT_PRED3(between, 1e6 * f.area_1N, 60, 157);  // 154 on the finest mesh, flat; else less than 140
    EXPECT_PRED3(between, 1e6 * f.area_5N, 120, 240);
    EXPECT_GE(f.area_1N, 0.6 * f.area_5N);
    EXPECT_LT(f.area_exponent, 0.6);
    EXPECT_PRED3(between, f.sheared_strain_5N, 0.25, 0.72);  // of a few faces; 0.3 to 0.6 but for two of eight
    EXPECT_PRED3(between, 1e-3 * f.tangential_stiffness_1N, 0.5, 2.5);
    EXPECT_GT(f.displacement_1N / f.displacement_4N, 0.62);  // soft first, stiff later; 0.70 in five of eight
}

/// Coarse and fine pads bear the same from the first touch on where skin is round between nodes and the coarse one is
/// softened; a flat coarse one bears less at first, for its nodes come late, and more later.
TEST(Indentation, ACurvedSkinBearsTheSameWithEveryMesh) {
    FingerModel model = named("index-median");
    const double softening = model.mesh.softening;
    ASSERT_GT(softening, 0.1);
    for (const double angle : {0.0, 30.0})
        for (const bool curved : {false, true}) {
            model.mesh.curved_skin = curved;
            model.mesh.softening = curved ? softening : 0;
            std::vector<Indentation> presses;
            for (const int elements : {347, 1000}) {
                model.mesh.elements = elements;
                presses.push_back({built(model), angle * degree, 0, 1.6e-3});
            }
            const auto curves = pressed(presses, {.steps = 24});
            const auto ratio = [&](double displacement) {
                return field_at_displacement(curves[0], displacement, &IndentationPoint::force) /
                       field_at_displacement(curves[1], displacement, &IndentationPoint::force);
            };
            for (const double displacement : {0.5e-3, 1e-3, 1.5e-3}) {
                if (curved) { EXPECT_NEAR(ratio(displacement), 1, 0.08) << angle << " " << displacement; }
            }
            if (!curved) { EXPECT_LT(ratio(0.5e-3), 0.92) << angle; }
            if (!curved) { EXPECT_GT(ratio(1.5e-3), 1.03) << angle; }
        }
}

/// One finger file is one finger, whatever its mesh.
TEST(Indentation, OfAPresetChangesLittleWithItsMesh) {
    FingerModel model = named("index-median");
    std::vector<Indentation> presses;
    for (const int elements : {347, 1000, 2800})
        for (const double angle : {0.0, 30.0}) {
            model.mesh.elements = elements;
            presses.push_back({built(model), angle * degree, 0, 3e-3});
            presses.back().finger.name = std::to_string(presses.size());
        }
    const auto curves = pressed(presses, {.steps = 60, .force_limit = 4.5});
    for (std::size_t angle = 0; angle < 2; ++angle)
        for (const std::size_t mesh : {angle, 2 + angle}) {
            const IndentationCurve &coarse = curves[mesh], &fine = curves[4 + angle];
            constexpr double off = 0.12;
            for (const double force : {0.3, 1.0, 2.0, 4.0}) {
                const double displacement = displacement_at_force(fine, force);
                EXPECT_NEAR(displacement_at_force(coarse, force), displacement, off * displacement) << force;
            }
            const double displacements[] = {0.5e-3, 1e-3, 1.5e-3};
            for (const double displacement : {0.5e-3, 1e-3}) {
                const double force = field_at_displacement(fine, displacement, &IndentationPoint::force);
                EXPECT_NEAR(field_at_displacement(coarse, displacement, &IndentationPoint::force), force, 0.10 * force)
                    << displacement;
            }
            for (const double displacement : displacements) {
                const double force = field_at_displacement(curves[angle], displacement, &IndentationPoint::force);
                EXPECT_NEAR(field_at_displacement(curves[2 + angle], displacement, &IndentationPoint::force), force,
                            0.08 * force)
                    << displacement;
            }
            for (const double displacement : displacements) {
                const double area = field_at_displacement(fine, displacement, &IndentationPoint::area);
                EXPECT_NEAR(field_at_displacement(coarse, displacement, &IndentationPoint::area), area, 0.17 * area)
                    << displacement;
            }
        }
}

TEST(Layers, SharesAreThoseOfTheDepth) {
    const TetMesh block = testing::block_mesh(12, 12, 4, 1e-3);  // pad below, 4 mm high
    const auto shares = layer_shares(block, {1e-3, 2e-3}).shares;
    double volume[3]{0, 0, 0}, all = 0;
    for (std::size_t e = 0; e < shares.size(); ++e) {
        const auto& s = shares[e];
        EXPECT_NEAR(s[0] + s[1] + s[2], 1, 1e-12);
        bool inner = true;  // away from the block's sides, which begin at pad nodes and so are skin
        for (int i : block.tets[e])
            inner = inner && std::hypot(block.nodes[std::size_t(i)][0], block.nodes[std::size_t(i)][1]) < 2.1e-3;
        for (int k = 0; inner && k < 3; ++k) volume[k] += s[std::size_t(k)], all += s[std::size_t(k)];
    }
    for (double& v : volume) v /= all;
    // The first millimetre, the next two, the last one.
    EXPECT_NEAR(volume[0], 0.25, 0.02);
    EXPECT_NEAR(volume[1], 0.50, 0.02);
    EXPECT_NEAR(volume[2], 0.25, 0.02);
}

TEST(Layers, OfTheSameMaterialChangeNothing) {
    FingerModel m = named("index-median");
    m.layers.clear();
    const Indentation plain{built(m), 20 * degree};
    m.layers = {{1e-3, m.spec.young_modulus, m.spec.limit_low, m.spec.limit_high}};
    const Indentation layered{built(m), 20 * degree};
    const auto a = pressed({plain}), b = pressed({layered});
    for (std::size_t k = 0; k < a[0].points.size(); ++k)
        EXPECT_NEAR(a[0].points[k].force, b[0].points[k].force, 1e-4 * (1e-3 + a[0].points[k].force));
}

/// A skin may be as soft across as what is below it: its elements then are, and are stiff along it alone.
TEST(Layers, MayBeAnotherAcrossTheSkin) {
    FingerModel m = named("index-median");
    m.layers = {{1e-3, 330e3, m.spec.limit_low, m.spec.limit_high, m.spec.young_modulus}};
    m.mesh.softening = 0;
    const FingerSpec soft = built(m);
    EXPECT_EQ(soft.skin_modulus, m.spec.young_modulus);
    EXPECT_FALSE(soft.mesh.membrane_patches.empty());
    double most = 0;
    for (std::size_t e = 0; e < soft.element_young.size(); ++e) {
        EXPECT_NEAR(soft.element_young[e], m.spec.young_modulus, 1e-9 * m.spec.young_modulus);
        most = std::max(most, soft.element_membrane[e]);
    }
    EXPECT_GT(most, 100e3);
    m.layers[0].across = 0;
    const FingerSpec stiff = built(m);
    EXPECT_EQ(stiff.skin_modulus, 330e3);
    const auto curves = pressed({Indentation{soft, 0}, Indentation{stiff, 0}});
    for (std::size_t k = 1; k < curves[0].points.size(); ++k) {
        if (curves[1].points[k].force < 0.01 || curves[1].points[k].force > 5) continue;
        EXPECT_LT(curves[0].points[k].force, curves[1].points[k].force);
        EXPECT_GT(curves[0].points[k].area, curves[1].points[k].area);
    }
    const auto parameters = fit_parameters(named("index-median"));
    EXPECT_TRUE(std::any_of(parameters.begin(), parameters.end(),
                            [](const FitParameter& p) { return p.name == "layer_1_across_kPa"; }));
}

TEST(FingerFiles, EveryPresetBuildsAndMedianOnesAreNearTheBuiltInShapes) {
    const auto names = finger_preset_names();
    EXPECT_EQ(names.size(), 15u);
    for (const std::string& name : names) {
        const FingerModel m = named(name);
        EXPECT_FALSE(m.source.empty()) << name;
        const FingerSpec f = built(m);
        EXPECT_TRUE(check_tets(f.mesh).empty()) << name;
        EXPECT_EQ(f.element_young.size(), f.mesh.tets.size());
        if (!name.ends_with("-median")) continue;
        const FingerShape shape = finger_shape(name.substr(0, name.size() - 7));
        EXPECT_NEAR(m.mesh.shape.length, shape.length, 0.1 * shape.length);
        EXPECT_NEAR(m.mesh.shape.width, shape.width, 0.13 * shape.width);
        EXPECT_NEAR(m.mesh.shape.thickness, shape.thickness, 0.1 * shape.thickness);
    }
}

TEST(FingerFiles, AreReadAsTheyWereWritten) {
    testing::ScratchFolder scratch;
    FingerModel m = named("thumb-large");
    m.title = "a \"thumb\"";
    m.mesh.regions.nail = 0.7;
    m.mesh.shape.pad_bulge = 0.2;
    write_finger_file(scratch.path / "thumb.toml", m, {"fitted", "by a test"});
    FingerModel read;
    Problems problems;
    read_named_finger("thumb.toml", scratch.path, read, problems);
    ASSERT_TRUE(problems.messages.empty()) << problems.messages.front();
    EXPECT_EQ(read.title, m.title);
    EXPECT_DOUBLE_EQ(read.mesh.regions.nail, 0.7);
    ASSERT_EQ(read.layers.size(), 1u);
    EXPECT_NEAR(read.layers[0].across, m.layers[0].across, 1);
    const FingerSpec a = built(m), b = built(read);
    EXPECT_EQ(a.element_young, b.element_young);
    for (std::size_t i = 0; i < a.mesh.nodes.size(); ++i)
        for (int d = 0; d < 3; ++d) EXPECT_NEAR(a.mesh.nodes[i][d], b.mesh.nodes[i][d], 1e-9);
}

TEST(FingerFiles, ASceneUsesThemAndItsOwnTablesComeFirst) {
    testing::ScratchFolder scratch;
    write_finger_file(scratch.path / "mine.toml", named("index-small"), {});
    std::ofstream(scratch.path / "scene.toml")
        << "[[object]]\nname = \"table\"\nposition_mm = [0, 0, -20]\n[[finger]]\nname = \"a\"\nfinger = \"mine.toml\"\n"
           "[[finger]]\nname = \"b\"\nfinger = \"index-large\"\nmaterial = { poisson = 0.3 }\n";
    const Scene scene = load_scene(scratch.path / "scene.toml");
    EXPECT_TRUE(scene.spec.fingers[0].has_limits);
    const FingerSpec& mine = scene.spec.fingers[0];
    const FingerModel small = named("index-small");
    EXPECT_TRUE(mine.mesh.curved_skin);
    EXPECT_NEAR(mine.young_modulus * softened_by(small.mesh.softening, mine.mesh.tets.size()), small.spec.young_modulus,
                1e-9 * small.spec.young_modulus);
    EXPECT_EQ(scene.spec.fingers[1].poisson_ratio, 0.3);
    EXPECT_GT(scene.finger_models[1].mesh.shape.length, scene.finger_models[0].mesh.shape.length);
    std::ofstream(scratch.path / "bad.toml") << "[[finger]]\nfinger = \"toe\"\n[[finger]]\nfinger = \"none.toml\"\n";
    try {
        load_scene(scratch.path / "bad.toml");
        FAIL();
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("index-median"), std::string::npos);
        EXPECT_NE(std::string(error.what()).find("none.toml: no such file"), std::string::npos);
    }
}

TEST(PadBulge, SwellsAndComesBack) {
    FingerShape shape = finger_shape("index");
    std::vector<Point> nodes = finger_surface(shape).vertices;
    const std::vector<Point> before = nodes;
    change_pad_bulge(nodes, shape, 0.3);
    EXPECT_LT(bounds(nodes)[0][2], 1.05 * bounds(before)[0][2]);
    shape.pad_bulge = 0.3;
    const std::vector<Point> wanted = finger_surface(shape).vertices;
    for (std::size_t i = 0; i < nodes.size(); ++i) EXPECT_NEAR(nodes[i][2], wanted[i][2], 1e-12);
    change_pad_bulge(nodes, shape, 0.14);
    for (std::size_t i = 0; i < nodes.size(); ++i) EXPECT_NEAR(nodes[i][2], before[i][2], 1e-12);
}

/// What reading a table says, or nothing.
std::string said(const std::string& text) {
    testing::ScratchFolder scratch;
    std::ofstream(scratch.path / "d.csv") << text;
    try {
        read_measured_curves(scratch.path / "d.csv");
        return "";
    } catch (const InputError& error) { return error.what(); }
}

TEST(MeasuredCurves, UnitsAreThoseOfTheHeader) {
    testing::ScratchFolder scratch;
    std::ofstream(scratch.path / "d.csv") << "# a comment\nangle_deg,displacement_um,force_mN,area_cm2,temperature\n"
                                             "30,200,50,0.2,21\n30,400,100,0.3,21\n30,600,200,0.4,21\n"
                                             "30,800,300,,21\n30,1000,500,0.6,21\n";
    const auto curves = read_measured_curves(scratch.path / "d.csv");
    ASSERT_EQ(curves.size(), 1u);
    EXPECT_NEAR(curves[0].angle, 30 * degree, 1e-12);
    EXPECT_NEAR(curves[0].points[1].displacement, 4e-4, 1e-12);
    EXPECT_NEAR(curves[0].points[1].force, 0.1, 1e-12);
    EXPECT_NEAR(curves[0].points[1].area, 3e-5, 1e-12);
    EXPECT_TRUE(std::isnan(curves[0].points[3].area));
}

TEST(MeasuredCurves, SayWhatIsWrongAndWhere) {
    const std::string head = "displacement_mm,force_N,area_mm2\n";
    auto has = [](const std::string& all, const std::string& part) { return all.find(part) != std::string::npos; };
    EXPECT_PRED2(has, said(""), "the file is empty");
    EXPECT_PRED2(has, said("displacement_mm,area_mm2\n"), "d.csv:1: no column of forces");
    EXPECT_PRED2(has, said("force_N\n1\n"), "neither displacements nor areas");
    EXPECT_PRED2(has, said(head + "1,0.5,20\n"), "has 1 rows; at least 5");
    EXPECT_PRED2(has, said(head + "1,x,20\n"), "d.csv:2: force_N: expected a number, found 'x'");
    EXPECT_PRED2(has, said(head + "1,nan,20\n"), "d.csv:2: force_N");
    EXPECT_PRED2(has, said(head + "1,0.5\n"), "d.csv:2: expected 3 cells");
    EXPECT_PRED2(has, said(head + "1,0.5,-20\n"), "d.csv:2: area_mm2: expected at least 0");
    EXPECT_PRED2(has, said(head + "1,0.5,20\n0.8,0.6,30\n"), "d.csv:3: the displacement is smaller than in line 2");
    EXPECT_PRED2(has, said(head + "1,0.5,20\n1,0.6,30\n"), "d.csv:3: the displacement of line 2 is repeated");
    EXPECT_PRED2(has, said(head + "1,250,20\n"), "grams-force");
    EXPECT_PRED2(has, said(head + "900,0.5,20\n"), "micrometres");
    const std::string metres = "0.0002,0.1,20\n0.0004,0.2,30\n0.0006,0.3,40\n0.0008,0.4,50\n0.001,0.5,60\n";
    EXPECT_PRED2(has, said(head + metres), "too small for a fingertip");
}

/// Presses of a finger up to 4 N, as somebody could have measured them.
std::vector<MeasuredCurve> measured(const FingerModel& truth, const std::vector<double>& angles, int rows) {
    std::vector<MeasuredCurve> data;
    for (const double angle : angles) {
        Indentation press{built(truth), angle * degree, 0, 4e-3};
        const double most = displacement_at_force(pressed({press}, {.steps = 40, .force_limit = 5})[0], 4);
        for (int k = 1; k <= rows; ++k) press.displacements.push_back(most * k / rows);
        MeasuredCurve& m = data.emplace_back();
        m.angle = angle * degree;
        const IndentationCurve c = pressed({press})[0];
        for (std::size_t k = 1; k < c.points.size(); ++k)
            m.points.push_back({press.displacements[k - 1], c.points[k].force, c.points[k].area});
    }
    return data;
}

TEST(Calibration, FindsWhatTheDataHold) {
    FingerModel start = named("index-median");
    start.spec.limit_high = 2;
    FingerModel truth = start;
    auto parameters = fit_parameters(truth);
    for (const FitParameter& p : parameters) {
        if (p.name == "young_kPa") p.set(truth, 17);
        if (p.name == "low") p.set(truth, 0.62);
        if (p.name == "width_mm") p.set(truth, 18.5);
    }
    Threads threads(2);
    const std::atomic<bool> stop{false};
    CalibrationSettings s;
    s.parameters = {"young_kPa", "low", "width_mm", "high"};
    const Calibration c = calibrate(start, measured(truth, {0, 30}, 10), s, threads, stop, {});
    EXPECT_NEAR(c.parameters[0].value, 17, 0.5);
    EXPECT_NEAR(c.parameters[1].value, 0.62, 0.01);
    EXPECT_NEAR(c.parameters[2].value, 18.5, 0.4);
    // No element comes near the upper limit: nothing can be said of it, and that is said.
    EXPECT_FALSE(c.parameters[3].determined);
    EXPECT_TRUE(c.parameters[0].determined && c.parameters[1].determined);
    for (const CurveFit& f : c.curves) EXPECT_LT(f.force_area, 0.02);
}

/// Fingers with 5 % of noise on force and area, fitted on three angles and judged on a fourth. More with
/// PALPATE_CALIBRATION_TRIALS=100, others with PALPATE_CALIBRATION_SEED.
TEST(Calibration, IntervalsHoldTheTruthAndAnotherAngleIsForeseen) {
    const char* asked = std::getenv("PALPATE_CALIBRATION_TRIALS");
    const int trials = asked ? std::atoi(asked) : 2;
    const char* seed = std::getenv("PALPATE_CALIBRATION_SEED");
    Threads threads(2);
    const std::atomic<bool> stop{false};
    std::mt19937 random(seed ? unsigned(std::atoi(seed)) : 7);
    std::normal_distribution<double> noise(0, 0.05);
    std::uniform_real_distribution<double> share;
    const FingerModel start = named("index-median");
    CalibrationSettings settings;
    int inside[3]{0, 0, 0};
    double worst = 0, mean = 0;
    for (int trial = 0; trial < trials; ++trial) {
        FingerModel truth = start;
        const double values[3] = {12 * std::pow(2, 2 * share(random) - 1), 0.55 + 0.2 * share(random),
                                  17 * (0.85 + 0.3 * share(random))};
        for (int k = 0; k < 3; ++k)
            for (const FitParameter& p : fit_parameters(truth))
                if (p.name == settings.parameters[std::size_t(k)]) p.set(truth, values[k]);
        std::vector<MeasuredCurve> data = measured(truth, {0, 20, 45, 30}, 15);
        const std::vector<MeasuredCurve> held_out{data.back()};
        data.pop_back();
        for (MeasuredCurve& c : data)
            for (MeasuredPoint& p : c.points) p.force *= std::exp(noise(random)), p.area *= std::exp(noise(random));
        const Calibration c = calibrate(start, data, settings, threads, stop, {});
        for (int k = 0; k < 3; ++k) {
            const FittedParameter& p = c.parameters[std::size_t(k)];
            inside[k] += values[k] >= p.low95 && values[k] <= p.high95;
        }
        const double error = compare_with_curves(c.model, held_out, settings, threads)[0].force_area;
        worst = std::max(worst, error);
        mean += error / trials;
    }
    std::printf(
        "%d trials: area over force at another angle %.2f %% off, at worst %.2f %%; inside their intervals: "
        "young_kPa %d, low %d, width_mm %d\n",
        trials, 100 * mean, 100 * worst, inside[0], inside[1], inside[2]);
    EXPECT_LT(worst, 0.05);
    for (const int n : inside) EXPECT_GE(n, trials >= 20 ? 0.9 * trials : 0.5 * trials);
}

TEST(Calibration, RefusesWhatItCannotFit) {
    Threads threads(1);
    const std::atomic<bool> stop{false};
    std::vector<MeasuredCurve> data{{0, {{1e-3, 0.2, std::nan("")}}}};
    CalibrationSettings s;
    s.parameters = {"youngs"};
    EXPECT_THROW(calibrate(named("index-median"), data, s, threads, stop, {}), InputError);
    s.parameters = {"young_kPa", "low"};
    EXPECT_THROW(calibrate(named("index-median"), data, s, threads, stop, {}), InputError);
}

TEST(FingerCommands, WhatIndentWritesCalibrateReadsAndASceneUses) {
    testing::ScratchFolder scratch;
    const std::string at = scratch.path.string();
    const auto indented =
        palpate_program("indent index --angle 10,30 --steps 20 --force-N 3 --json --out " + at + " --elements 200");
    ASSERT_EQ(indented.code, 0) << indented.out;
    EXPECT_NEAR(nlohmann::json::parse(indented.out)[1]["angle_deg"], 30.0, 1e-12);
    EXPECT_TRUE(std::filesystem::exists(scratch.path / "indent.svg"));
    const auto fitted = palpate_program("calibrate " + at + "/indent.csv --fit young_kPa --starts 1 --quiet --out " +
                                        at + "/mine.toml --elements 200");
    ASSERT_EQ(fitted.code, 0) << fitted.out;
    EXPECT_NE(fitted.out.find("young_kPa"), std::string::npos);
    std::ofstream(scratch.path / "scene.toml")
        << "duration_s = 0.02\n[[object]]\nname = \"table\"\nposition_mm = [0, 0, -20]\n[[finger]]\nname = \"a\"\n"
           "finger = \"mine.toml\"\n";
    const auto run = palpate_program("run " + at + "/scene.toml --quiet --no-picture --out " + at + "/out");
    EXPECT_EQ(run.code, 0) << run.out;
    EXPECT_EQ(palpate_program("indent toe").code, 2);
    EXPECT_EQ(palpate_program("indent index --finger-of-scene thumb").code, 2);
    EXPECT_EQ(palpate_program("calibrate " + at + "/none.csv").code, 2);
    EXPECT_EQ(palpate_program("calibrate " + at + "/indent.csv --fit toes --quiet").code, 2);
}

}  // namespace
}  // namespace palpate
