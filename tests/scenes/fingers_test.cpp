// Finger files, layers, calibration.

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
#include "tests/comma_locale.h"
#include "tests/scenes/named_finger.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::built, testing::degree, testing::named, testing::palpate_program, testing::pressed;

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

/// Spreadsheets mark "CSV UTF-8" so, and programs that read it may run where numbers have a comma.
TEST(MeasuredCurves, AreReadBehindAMarkAndWhereTheDecimalPointIsAComma) {
    testing::ScratchFolder scratch;
    const std::string table =
        "angle_deg,displacement_mm,force_N\n30,0.25,0.05\n30,0.5,0.125\n30,0.75,0.25\n30,1.0,0.5\n30,1.25,0.875\n";
    std::ofstream(scratch.path / "d.csv") << table;
    std::ofstream(scratch.path / "marked.csv") << "\xef\xbb\xbf" << table;
    const auto plain = read_measured_curves(scratch.path / "d.csv");
    const testing::CommaLocale comma;
    const auto marked = read_measured_curves(scratch.path / "marked.csv");
    ASSERT_EQ(plain[0].points.size(), marked[0].points.size());
    EXPECT_EQ(plain[0].points[2].displacement, 0.75e-3);
    for (std::size_t k = 0; k < plain[0].points.size(); ++k) {
        EXPECT_EQ(plain[0].points[k].displacement, marked[0].points[k].displacement);
        EXPECT_EQ(plain[0].points[k].force, marked[0].points[k].force);
    }
    EXPECT_EQ("0.5", number_text(0.5));
    EXPECT_EQ("12345", number_text(12345));
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
            m.points.push_back({c.points[k].displacement, c.points[k].force, c.points[k].area});
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

/// Young's modulus and lower limit of a finger, fitted to presses of it without any noise.
void expect_the_truth(const Indentation& how, const IndentationSettings& as, double young, double low) {
    std::vector<MeasuredCurve> data;
    FingerModel truth = named("index-median"), start = truth;
    const auto set = [](FingerModel& m, double young_kPa, double limit) {
        for (const FitParameter& p : fit_parameters(m)) {
            if (p.name == "young_kPa") p.set(m, young_kPa);
            if (p.name == "low") p.set(m, limit);
        }
    };
    set(truth, young, low), set(start, 1.4 * young, low - 0.08);
    for (const double angle : {0.0, 30.0}) {
        Indentation press = how;
        press.finger = built(truth), press.angle = angle * degree;
        MeasuredCurve& m = data.emplace_back(MeasuredCurve{press.angle, {}});
        const IndentationCurve curve = pressed({press}, as)[0];
        for (const IndentationPoint& p : curve.points)
            if (p.displacement > 0) m.points.push_back({p.displacement, p.force, p.area});
        EXPECT_GT(m.points.back().force, 4);
    }
    Threads threads(2);
    const std::atomic<bool> stop{false};
    CalibrationSettings s;
    s.parameters = {"young_kPa", "low"}, s.starts = 1;
    const Calibration c = calibrate(start, data, s, threads, stop, {});
    EXPECT_LT(c.cost, 0.01);
    const double values[] = {young, low};
    for (std::size_t k = 0; k < 2; ++k) {
        const FittedParameter& p = c.parameters[k];
        EXPECT_TRUE(p.low95 <= values[k] && values[k] <= p.high95)
            << p.name << " " << values[k] << ": " << p.low95 << " to " << p.high95;
        EXPECT_NEAR(p.value, values[k], 2e-3 * values[k]) << p.name;
        EXPECT_GT(p.high95 - p.low95, 1e-5 * values[k]) << p.name;
    }
}

TEST(Calibration, FindsTheTruthInManyRowsAcrossTheKneeAtTheLimits) {
    expect_the_truth({.finger = {}, .depth = 4e-3}, {.steps = 120, .force_limit = 6}, 15.5, 0.69);
}

TEST(Calibration, FindsTheTruthInFewRowsThatEndOnAWall) {
    expect_the_truth({.finger = {}, .depth = 2.7e-3}, {.steps = 13}, 17, 0.78);
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
    for (const int n : inside) EXPECT_GE(n, trials >= 20 ? 0.85 * trials : 0.5 * trials);
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

/// What is said of a scene whose finger has a preset and these tables.
std::string refusal_of_preset(const std::string& tables, const std::string& before = "") {
    try {
        load_scene_text(
            "duration_s = 0.1\n" + before + "\n[[finger]]\nname = \"f\"\nfinger = \"index-median\"\n" + tables,
            "scene.toml");
        return "";
    } catch (const InputError& error) { return error.what(); }
}

TEST(FingerPresets, TissueThatTheirMeshesCannotHaveIsRefusedWithARemedy) {
    const std::string other = "material = { kind = \"neo-hookean\", young_kPa = 30 }\n";
    EXPECT_EQ(refusal_of_preset(other),
              "scene.toml:6:21: finger \"f\".material.kind: the mesh has patches (of 8 elements each), which need "
              "corotational tissue; for neo-hookean, also say mesh = { patch = 0 }");
    EXPECT_EQ(refusal_of_preset(other + "mesh = { patch = 0 }\n"), "");
    EXPECT_EQ(refusal_of_preset("material = { kind = \"corotational\" }\n"), "");
    // A finger without a preset has patches only where that goes, unless it is said.
    const std::string shape = "[[finger]]\nname = \"g\"\nshape = { finger = \"index\" }\n" + other;
    EXPECT_EQ(refusal_of_preset(shape), "");
    EXPECT_NE(refusal_of_preset(shape, "[mesh]\nkind = \"conforming\"").find("finger \"g\".material.kind: the mesh"),
              std::string::npos);
}

TEST(FingerPresets, ModuliThatAreTooSmallOnceSoftenedAreRefusedWithTheirRange) {
    const std::string low = refusal_of_preset("material = { young_kPa = 0.001 }\n");
    EXPECT_TRUE(low.starts_with("scene.toml:6:26: finger \"f\".material.young_kPa: expected 0.00125")) << low;
    EXPECT_NE(low.find(" kPa or more, "), std::string::npos) << low;
    EXPECT_NE(low.find("mesh.softening), found 0.001"), std::string::npos) << low;
    EXPECT_EQ(refusal_of_preset("material = { young_kPa = 0.001 }\nmesh = { softening = 0 }\n"), "");
    const std::string bound = low.substr(low.find("expected ") + 9, 10);
    EXPECT_EQ(refusal_of_preset("material = { young_kPa = " + bound.substr(0, bound.find(' ')) + " }\n"), "");
    const std::string layer = refusal_of_preset("[[finger.layer]]\nthickness_mm = 1\nyoung_kPa = 0.001\n");
    EXPECT_TRUE(layer.starts_with("scene.toml:6:")) << layer;
    EXPECT_NE(layer.find("finger \"f\".layer: young_kPa: expected 0.00125"), std::string::npos) << layer;
}

TEST(FingerPresets, LayersThatAreTooStiffOnceLiftedAreRefusedWithTheirRange) {
    const std::string layer =
        "material = { young_kPa = 15500 }\n[[finger.layer]]\nthickness_mm = 1\nacross_kPa = 107000\nyoung_kPa = ";
    const std::string stiff = refusal_of_preset(layer + "950000\n");
    EXPECT_TRUE(stiff.starts_with("scene.toml:")) << stiff;
    EXPECT_NE(stiff.find("finger \"f\".layer: young_kPa: expected "), std::string::npos) << stiff;
    EXPECT_NE(stiff.find("found 950000"), std::string::npos) << stiff;
    const std::string bound = stiff.substr(stiff.find("expected ") + 9);
    EXPECT_EQ(refusal_of_preset(layer + bound.substr(0, bound.find(' ')) + "\n"), "");
}

TEST(FingerPresets, ASurfaceInInchesIsDoubted) {
    testing::ScratchFolder scratch;
    Surface finger = finger_surface(finger_shape("index"));
    const auto warnings = [&](double per_metre) {
        std::ofstream file(scratch.path / "scan.obj");
        for (const Point& p : finger.vertices)
            file << "v " << per_metre * p[0] << " " << per_metre * p[1] << " " << per_metre * p[2] << "\n";
        for (const auto& t : finger.triangles) file << "f " << t[0] + 1 << " " << t[1] + 1 << " " << t[2] + 1 << "\n";
        file.close();
        return load_scene_text("duration_s = 0.1\n[[finger]]\nname = \"f\"\nmesh = { surface = \"" +
                                   (scratch.path / "scan.obj").string() + "\", keep_frame = true }\n",
                               "scene.toml")
            .warnings;
    };
    EXPECT_TRUE(warnings(1e3).empty());
    ASSERT_EQ(warnings(1 / 0.0254).size(), 1u);
    EXPECT_NE(warnings(1 / 0.0254)[0].find("it looks like inches"), std::string::npos) << warnings(1 / 0.0254)[0];
}

TEST(FingerPresets, ABoneThatLeavesNoPadIsDoubted) {
    const std::string head = "duration_s = 0.1\n[[finger]]\nname = \"f\"\nshape = { finger = \"index\" }\n";
    EXPECT_TRUE(load_scene_text(head, "scene.toml").warnings.empty());
    const auto warnings =
        load_scene_text(head + "mesh = { kind = \"uniform\" }\nbone = { cut = 1 }\n", "scene.toml").warnings;
    ASSERT_EQ(warnings.size(), 1u);
    EXPECT_NE(warnings[0].find("finger \"f\".bone: so much"), std::string::npos) << warnings[0];
}

TEST(FingerCommands, FiguresOfIndentDoNotDependOnItsRows) {
    const auto figures = [](const std::string& steps) {
        const auto out = palpate_program("indent index-median --angle 0 --depth-mm 3 --json --out '' --steps " + steps);
        EXPECT_EQ(out.code, 0) << out.out;
        return nlohmann::json::parse(out.out)[0];
    };
    const auto fine = figures("30");
    int number = 0;
    for (const char* steps : {"2", "5"}) {
        if (!testing::is_tried(number++, 2)) continue;
        const auto few = figures(steps);
        for (const char* name : {"displacement at 1 N [mm]", "displacement at 4 N [mm]", "stiffness at 4 N over 0.5 N"})
            EXPECT_NEAR(double(few[name]), double(fine[name]), 0.01 * double(fine[name])) << name << " " << steps;
    }
}

TEST(FingerCommands, MeshRefusesWhatItWouldNotUse) {
    const auto refused = [](const std::string& arguments, const std::string& says) {
        const auto out = palpate_program("mesh " + arguments);
        EXPECT_EQ(out.code, 2) << arguments;
        EXPECT_NE(out.out.find(says), std::string::npos) << arguments << ": " << out.out;
    };
    for (const char* size : {"--length=-5", "--length=0", "--width=-3", "--thickness=-1", "--pad-bulge=-1"})
        refused(std::string("index ") + size, "not in range");
    const std::string egg = testing::source_dir() + "/scenes/egg.obj";
    refused(egg + " --keep-frame --length 30", "--length: is of the built-in finger");
    refused(egg + " --keep-frame --tip 0,1,0 --dorsal 0,0,1", "--keep-frame: ");
    refused("index --unit mm", "--unit: is of surface files");
}

TEST(FingerCommands, WhatIndentWritesCalibrateReadsAndASceneUses) {
    testing::ScratchFolder scratch;
    const std::string at = scratch.path.string();
    const auto indented =
        palpate_program("indent index --angle 10,30 --steps 10 --force-N 2 --json --out " + at + " --elements 200");
    ASSERT_EQ(indented.code, 0) << indented.out;
    EXPECT_NEAR(nlohmann::json::parse(indented.out)[1]["angle_deg"], 30.0, 1e-12);
    EXPECT_TRUE(std::filesystem::exists(scratch.path / "indent.svg"));
    const auto fitted = palpate_program("fit " + at + "/indent.csv --fit young_kPa --starts 1 --quiet --out " + at +
                                        "/mine.toml --elements 200");
    ASSERT_EQ(fitted.code, 0) << fitted.out;
    EXPECT_NE(fitted.out.find("young_kPa"), std::string::npos);
    std::ofstream(scratch.path / "scene.toml")
        << "duration_s = 0.02\n[[object]]\nname = \"table\"\nposition_mm = [0, 0, -20]\n[[finger]]\nname = \"a\"\n"
           "finger = \"mine.toml\"\n";
    const auto run = palpate_program("run " + at + "/scene.toml --quiet --no-picture --out " + at + "/out");
    EXPECT_EQ(run.code, 0) << run.out;
    EXPECT_EQ(palpate_program("indent toe").code, 2);
    EXPECT_EQ(palpate_program("indent index --finger-of-scene thumb").code, 2);
    EXPECT_EQ(palpate_program("fit " + at + "/none.csv").code, 2);
    EXPECT_EQ(palpate_program("fit " + at + "/indent.csv --fit toes --quiet").code, 2);
}

}  // namespace
}  // namespace palpate
