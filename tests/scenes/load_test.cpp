// Scene files: every kind of mistake gives a message with place and remedy; its twin without it loads.

#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "tests/support.h"

namespace palpate {
namespace {

const std::string good = R"(
title = "test"
duration_s = 0.1
[[object]]
name = "table"
kind = "plane"
[[finger]]
name = "index"
elements = 100
shape = { finger = "index" }
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [0, 0, 9] }, { t_s = 0.1, position_mm = [0, 0, 7] } ]
)";

class SceneFiles : public ::testing::Test {
  protected:
    std::string refusal(const std::string& text, const std::vector<std::string>& overrides = {}) {
        const auto path = scratch_.path / "scene.toml";
        std::ofstream(path) << text;
        try {
            load_scene(path, overrides, &meshes_);
            return "";
        } catch (const InputError& error) { return error.what(); }
    }
    std::vector<std::string> warnings(const std::string& text, const std::vector<std::string>& overrides = {}) {
        const auto path = scratch_.path / "scene.toml";
        std::ofstream(path) << text;
        return load_scene(path, overrides, &meshes_).warnings;
    }
    static std::string replaced(std::string text, const std::string& from, const std::string& to) {
        text.replace(text.find(from), from.size(), to);
        return text;
    }
    testing::ScratchFolder scratch_;
    FingerTemplates meshes_;  // meshed once for all scenes of a test
};

#define EXPECT_SAYS(message, part) EXPECT_NE((message).find(part), std::string::npos) << "found: " << (message)

TEST_F(SceneFiles, TheGoodTwinLoads) { EXPECT_EQ(refusal(good), ""); }

TEST_F(SceneFiles, SyntaxTypesAndUnknownKeys) {
    EXPECT_SAYS(refusal("title = \n"), ":1:");
    EXPECT_SAYS(refusal(replaced(good, "duration_s", "duratoin_s")), "did you mean 'duration_s'?");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = \"many\"")),
                "finger \"index\".elements: expected a whole number");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = \"many\"")), "scene.toml:9:");
    EXPECT_SAYS(refusal(replaced(good, "elements = 100", "elements = 3")), "from 20");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, 9]")), "three numbers");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, nan, 9]")), "found nan as y");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, 0, -inf]")), "found -inf as z");
    EXPECT_SAYS(refusal(replaced(good, "[0, 0, 9]", "[0, 0, 9e9]")), "of at most");
    EXPECT_SAYS(refusal(replaced(good, "duration_s = 0.1", "duration_s = inf")), "expected a number");
    EXPECT_SAYS(refusal(replaced(good, "duration_s = 0.1", "duration_s = -1")), "found -1");
    EXPECT_SAYS(refusal(replaced(good, "kind = \"plane\"", "kind = \"torus\"")),
                "plane, box, sphere, capsule, cylinder");
    EXPECT_SAYS(refusal(replaced(good, "kind = \"plane\"", "kind = \"sphere\"")), "capsule or cylinder needs it");
    EXPECT_SAYS(refusal(replaced(good, "[[finger]]", "[[fingre]]")), "at least one");
    EXPECT_SAYS(refusal(replaced(good, "chinello-3rrs", "stewart")), "chinello-3rrs");
    EXPECT_SAYS(refusal(replaced(good, "t_s = 0.1", "t_s = 0")), "follow each other");
    EXPECT_SAYS(refusal(good + "limits = { low = 1.2 }\n"), "low");
    EXPECT_SAYS(refusal(good + "follow = \"index\"\n"), "no [recording]");
    EXPECT_SAYS(refusal(replaced(good, "name = \"index\"", "name = \"a/b\"")), "no slashes");
    EXPECT_SAYS(refusal(replaced(good, "{ kind = \"chinello-3rrs\" }",
                                 "{ kind = \"chinello-3rrs\", joint_min_deg = 20, joint_max_deg = 10 }")),
                "below the upper");
}

TEST_F(SceneFiles, BodiesFrictionsAndFilters) {
    auto with = [&](const std::string& object, const std::string& rest = "") {
        return refusal(
            replaced(good, "[[finger]]", "[[object]]\nname = \"thing\"\n" + object + "\n" + rest + "[[finger]]"));
    };
    const std::string box = "kind = \"box\"\nsize_mm = [20, 20, 20]\nposition_mm = [0, 90, 30]\n";
    EXPECT_EQ(with(box + "mass_g = 20\nrestitution = 0.5\nvelocity_m_per_s = [0, 1, 0]"), "");
    EXPECT_EQ(with(box + "density_kg_per_m3 = 500\nspin_rad_per_s = [0, 0, 3]",
                   "[[friction]]\nfirst = \"thing\"\nsecond = \"table\"\ncoefficient = 0.1\n"),
              "");
    EXPECT_SAYS(with(box + "mass_g = 0"), "object \"thing\".mass_g: expected a number from 0.001");
    EXPECT_SAYS(with(box + "mass_g = 20\ndensity_kg_per_m3 = 500"), "not both");
    EXPECT_SAYS(with(box + "restitution = 0.5"), "only an object with mass_g");
    EXPECT_SAYS(with("kind = \"plane\"\nmass_g = 20"), "a plane has no end");
    EXPECT_SAYS(with(box + "mass_g = 20\ntrack = [ { t_s = 0, position_mm = [0, 0, 0] } ]"),
                "either a track or a mass");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"thing\"\nsecond = \"chair\"\n"), "found \"chair\"");
    EXPECT_EQ(with(box, "[[friction]]\nfirst = \"index\"\nsecond = \"thing\"\ncoefficient = 0.1\n"), "");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"index\"\nsecond = \"index\"\n"), "is skin_friction");
    EXPECT_SAYS(with(box, "[[friction]]\nfirst = \"thing\"\nsecond = \"thing\"\n"), "does not touch itself");
    EXPECT_SAYS(with(box + "release_s = 1"), "only an object with mass_g");
    EXPECT_SAYS(with("kind = \"mesh\""), "needs the name of a file");
    EXPECT_SAYS(with("kind = \"mesh\"\nfile = \"nothing.obj\"\nmass_g = 5"), "no such file");
    EXPECT_SAYS(with(box, "[[object]]\nname = \"thing\"\n"), "two objects are called 'thing'");
    EXPECT_EQ(refusal(good, {"filter.min_cutoff_Hz=3"}), "");
    EXPECT_SAYS(refusal(good, {"filter.min_cutoff_Hz=0"}), "filter.min_cutoff_Hz: expected a number from 0.001");
    EXPECT_SAYS(refusal(good, {"solver.sample_refinement=0"}), "sample_refinement");
    EXPECT_EQ(refusal(good, {"finger.index.device.mode=force", "finger.index.device.max_force_N=3"}), "");
    EXPECT_SAYS(refusal(good, {"finger.index.device.mode=force", "finger.index.device.driver=maestro",
                               "finger.index.device.channels=[0, 1, 2]"}),
                "cannot limit their force");
    EXPECT_EQ(refusal(good, {"finger.index.device.mode=force", "finger.index.device.driver=dynamixel",
                             "finger.index.device.port=/dev/ttyUSB0", "finger.index.device.channels=[1, 2, 3]"}),
              "");
    EXPECT_SAYS(refusal(good, {"finger.index.device.mode=force", "finger.index.device.kind=shear-2dof"}),
                "cannot push its platform");
}

TEST_F(SceneFiles, AllProblemsInOnePass) {
    const std::string message = refusal(replaced(
        replaced(replaced(good, "elements = 100", "elements = 1"), "kind = \"plane\"", "kind = 3"), "title", "titel"));
    EXPECT_SAYS(message, "elements");
    EXPECT_SAYS(message, "object \"table\".kind");
    EXPECT_SAYS(message, "titel");
    EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 2) << message;
}

TEST_F(SceneFiles, OneErrorPerMistake) {
    auto only = [&](const std::string& text, const std::string& part, const std::vector<std::string>& overrides = {}) {
        const std::string message = refusal(text, overrides);
        EXPECT_SAYS(message, part);
        EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 0) << message;
    };
    const std::string device = "{ kind = \"chinello-3rrs\" }";
    auto with = [&](const std::string& object) {
        return replaced(good, "[[finger]]", "[[object]]\nname = \"thing\"\n" + object + "\n[[finger]]");
    };
    std::ofstream(scratch_.path / "open.obj") << "v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 3\n";
    only(replaced(good, device, "{ driver = \"arduino\", port = \"/dev/ttyACM0\", channels = [0, 1, 2] }"), "arduino");
    only(replaced(good, device, "{ kind = \"stewart\", geometry_mm = { crank = 9 }, mode = \"force\" }"), "stewart");
    only(replaced(good, device, "{ kind = \"cable-3\", geometry_mm = { crank = 9 } }"), "has no such length");
    only(replaced(good, device, "{ driver = \"maestro\", channels = [0, 0, 1] }"), "would drive two joints");
    only(replaced(good, device, "{ driver = \"maestro\", channels = [0, 1, 99] }"), "found 99 in it");
    only(replaced(good, "kind = \"plane\"", "kind = \"torus\"\nradius_mm = 3\nmass_g = 9"), "torus");
    only(with("kind = \"sphere\"\nradius_mm = -1\nmass_g = 4\nrestitution = 0.2"), "radius_mm");
    only(with("kind = \"sphere\"\nradius_mm = 3\nsize_mm = [1, 2, 3]"), "a sphere has none");
    only(with("kind = \"box\"\nsize_mm = [1, 2, nan]\nmass_g = 4"), "found nan as z");
    only(with("kind = \"mesh\"\nfile = \"absent.obj\"\nmass_g = 4\nsmoothing_mm = 1"), "no such file");
    only(with("kind = \"box\"\nsize_mm = [10, 10, 10]\nposition_mm = [0, 50, 50]\nmass_g = \"heavy\""), "mass_g");
    only(good +
             "[recording]\nfile = \"absent.jsonl\"\n[[finger]]\nname = \"b\"\nelements = 20\nfollow = \"index\"\n"
             "track = [ { t_s = 0, position_mm = [0, 90, 9] } ]\n",
         "absent.jsonl");
    only(good +
             "[tracker]\nsource = \"telepathy\"\n[[finger]]\nname = \"b\"\nelements = 20\nfollow = \"index\"\n"
             "track = [ { t_s = 0, position_mm = [0, 90, 9] } ]\n",
         "telepathy");
    only(replaced(good, "t_s = 0.1", "t_s = \"soon\""), "t_s: expected a number");
    only(good, "limits.low", {"limits.low=1.5"});
    only(replaced(good, "t_s = 0,", "time_s = 0,"), "did you mean 't_s'? (a keyframe needs its time)");
    only(with("kind = \"box\"\nsize = [5, 5, 5]\nmass_g = 4"), "did you mean 'size_mm'?");
    only(with("kind = \"sphere\"\nradius = 5\nmass_g = 4"), "did you mean 'radius_mm'?");
    only(with("kind = \"mesh\"\nfiel = \"open.obj\"\nmass_g = 4"), "did you mean 'file'?");
    only(with("kinda = \"sphere\"\nradius_mm = 5\nmass_g = 4"), "did you mean 'kind'?");
    const std::string open = refusal(with("kind = \"mesh\"\nfile = \"open.obj\"\nmass_g = 4\nrelease_s = 1"));
    EXPECT_EQ(open.find("unknown key"), std::string::npos) << open;
    EXPECT_EQ(open.find("mass_g"), std::string::npos) << open;
    EXPECT_SAYS(open, "object \"thing\".file");
}

TEST_F(SceneFiles, UnitsThatLookWrongAreSaid) {
    EXPECT_TRUE(warnings(good).empty());
    auto said = [&](const std::string& text, const std::string& part, const std::vector<std::string>& overrides = {}) {
        const auto found = warnings(text, overrides);
        ASSERT_EQ(found.size(), 1u) << (found.empty() ? part : found[1]);
        EXPECT_SAYS(found.front(), part);
    };
    auto with = [&](const std::string& object) {
        return replaced(good, "[[finger]]", "[[object]]\nname = \"thing\"\n" + object + "\n[[finger]]");
    };
    said(good, "30000 looks like Pa", {"finger.index.material.young_kPa=30000"});
    said(good, "looks like g/cm^3", {"material.density_kg_per_m3=1.05"});
    said(good, "0.005 looks like seconds", {"dt_ms=0.005"});
    said(good, "looks like mm/s", {"coupling.max_speed_m_per_s=500"});
    said(good, "looks like per cent", {"object.table.friction=50"});
    said(replaced(replaced(good, "[0, 0, 9]", "[0, 0, 0.009]"), "[0, 0, 7]", "[0, 0, 0.007]"), "looks like metres",
         {"object.table.position_mm=[0, 0, -30]"});
    said(replaced(good, "[0, 0, 9]", "[0, 0, 9], rotation_deg = [0, 0, 1.5708]"), "90 degrees in radians");
    const std::string aside = "\nposition_mm = [0, 90, 90]\n";
    said(with("kind = \"sphere\"\nradius_mm = 0.033" + aside), "0.033 looks like metres");
    said(with("kind = \"box\"\nsize_mm = [0.06, 0.04, 0.02]" + aside), "looks like metres");
    said(with("kind = \"sphere\"\nradius_mm = 33\nmass_g = 0.058" + aside), "looks like kg");
    said(with("kind = \"sphere\"\nradius_mm = 33\nmass_g = 58\nvelocity_m_per_s = [0, 0, 50]" + aside), "mm/s");
    EXPECT_SAYS(warnings(good, {"finger.index.material.young_kPa=30000", "dt_ms=0.005"}).front(), "dt_ms");
}

TEST_F(SceneFiles, WhatIsNarrowerThanSamplesAreApartIsSaid) {
    auto with = [&](const std::string& object) {
        return replaced(good, "[[finger]]",
                        "[[object]]\nname = \"thing\"\nposition_mm = [0, 90, 90]\n" + object + "\n[[finger]]");
    };
    for (const std::string narrow : {"kind = \"sphere\"\nradius_mm = 2", "kind = \"box\"\nsize_mm = [3, 80, 3]",
                                     "kind = \"capsule\"\nradius_mm = 2\nlength_mm = 50"}) {
        const auto said = warnings(with(narrow), {"finger.index.elements=350"});
        ASSERT_EQ(said.size(), 1u) << narrow;
        EXPECT_SAYS(said.front(), "object \"thing\" is");
        EXPECT_SAYS(said.front(), "passes between them unfelt");
        EXPECT_TRUE(warnings(with(narrow), {"finger.index.elements=8000"}).empty()) << narrow;
    }
    EXPECT_TRUE(warnings(with("kind = \"box\"\nsize_mm = [30, 80, 1]"), {"finger.index.elements=350"}).empty());
}

TEST_F(SceneFiles, WhatStartsInsideIsRefusedOrSaid) {
    auto at = [&](const char* z) { return replaced(good, "[0, 0, 9]", std::string("[0, 0, ") + z + "]"); };
    EXPECT_TRUE(warnings(at("8")).empty());
    const auto said = warnings(at("5"));
    ASSERT_EQ(said.size(), 1u);
    EXPECT_SAYS(said.front(), "finger \"index\" starts");
    EXPECT_SAYS(said.front(), "inside object \"table\"");
    EXPECT_SAYS(said.front(), "comes out at 50 mm/s");
    EXPECT_SAYS(refusal(at("0.009")), "its position looks like metres");
    EXPECT_SAYS(refusal(at("-500")), "finger \"index\" starts 50");
    EXPECT_SAYS(refusal(at("0.009")), "deeper than half its thickness");
    EXPECT_EQ(refusal(at("-500") + "[tracker]\nsource = \"udp:9000\"\n"), "");  // it is elsewhere once it is seen
    auto two = [&](double z, const char* first, const char* second) {
        const std::string box = "[[object]]\nkind = \"box\"\nsize_mm = [20, 20, 20]\n";
        return replaced(good, "[[finger]]",
                        box + "name = \"a\"\nposition_mm = [0, 90, 60]\n" + first + box +
                            "name = \"b\"\nposition_mm = [0, 90, " + std::to_string(60 + z) + "]\n" + second +
                            "[[finger]]");
    };
    const char *body = "mass_g = 20\n", *fixed = "";
    EXPECT_TRUE(warnings(two(20, body, body)).empty());
    EXPECT_SAYS(warnings(two(19.5, body, fixed)).front(), "objects \"a\" and \"b\" overlap by 0.5 mm");
    EXPECT_SAYS(refusal(two(10, fixed, body)), "thrown apart");
    EXPECT_EQ(refusal(two(10, fixed, fixed)), "");
    const auto merged = warnings(good +
                                 "[[finger]]\nname = \"thumb\"\nelements = 100\n"
                                 "track = [ { t_s = 0, position_mm = [4, 0, 10] } ]\n");
    ASSERT_EQ(merged.size(), 1u);
    EXPECT_SAYS(merged.front(), "fingers \"index\" and \"thumb\" overlap by");
}

TEST_F(SceneFiles, ThimblesDoNotShareServos) {
    const std::string device = "{ kind = \"chinello-3rrs\" }";
    auto pair = [&](const std::string& first, const std::string& second) {
        return replaced(good, device, "{ " + first + " }") +
               "[[finger]]\nname = \"thumb\"\nelements = 100\ndevice = { " + second +
               " }\ntrack = [ { t_s = 0, position_mm = [0, 60, 9] } ]\n";
    };
    auto maestro = [](const char* channels, const char* serial) {
        return std::string("driver = \"maestro\", channels = ") + channels +
               (*serial ? std::string(", serial = \"") + serial + "\"" : "");
    };
    EXPECT_EQ(refusal(pair(maestro("[0, 1, 2]", ""), maestro("[3, 4, 5]", ""))), "");
    EXPECT_EQ(refusal(pair(maestro("[0, 1, 2]", "001"), maestro("[0, 1, 2]", "002"))), "");
    EXPECT_SAYS(refusal(pair(maestro("[0, 1, 2]", ""), maestro("[2, 4, 5]", ""))), "both drive channel 2");
    EXPECT_SAYS(refusal(pair(maestro("[0, 1, 2]", "001"), maestro("[0, 1, 2]", "001"))), "\"index\" and \"thumb\"");
    EXPECT_SAYS(refusal(pair(maestro("[0, 1, 2]", "001"), maestro("[3, 4, 5]", ""))), "under two names");
    auto bus = [&](const char* driver, const std::filesystem::path& port, const char* channels) {
        return std::string("driver = \"") + driver + "\", port = \"" + port.string() + "\", channels = " + channels;
    };
    const auto tty = scratch_.path / "tty", link = scratch_.path / "by-id";
    std::ofstream(tty) << "";
    std::filesystem::create_symlink(tty, link);
    EXPECT_EQ(refusal(pair(bus("dynamixel", tty, "[1, 2, 3]"), bus("dynamixel", tty, "[4, 5, 6]"))), "");
    EXPECT_SAYS(refusal(pair(bus("dynamixel", tty, "[1, 2, 3]"), bus("dynamixel", link, "[4, 5, 6]"))), "in two ways");
    EXPECT_SAYS(refusal(pair(bus("dynamixel", tty, "[1, 2, 3]"), bus("feetech", link, "[4, 5, 6]"))), "one port as");
}

TEST_F(SceneFiles, CalibrationsFitTheirServos) {
    const std::string device = "{ kind = \"chinello-3rrs\" }";
    auto calibration = [&](const std::string& head, const std::string& unit, const std::string& zero) {
        std::ofstream out(scratch_.path / "thimble.toml");
        out << head;
        for (int c = 0; c < 3; ++c) out << "[[servo]]\nchannel = " << c << "\nzero_" << unit << " = " << zero << "\n";
    };
    auto used = [&](const std::string& driver) {
        return replaced(good, device, "{ " + driver + ", calibration = \"thimble.toml\" }");
    };
    const std::string maestro = "driver = \"maestro\"", bus = "driver = \"dynamixel\", port = \"/dev/ttyUSB0\"";
    calibration("unit = \"us\"\n", "us", "1500");
    EXPECT_EQ(refusal(used(maestro)), "");
    EXPECT_TRUE(warnings(used(maestro)).empty());
    EXPECT_SAYS(refusal(used(bus)), "it is in microseconds, and a dynamixel takes ticks");
    calibration("unit = \"ticks\"\n", "ticks", "2000");
    EXPECT_EQ(refusal(used(bus)), "");
    EXPECT_SAYS(refusal(used(maestro)), "it is in ticks, and a maestro takes microseconds");
    calibration("unit = \"us\"\n", "ticks", "2000");
    EXPECT_SAYS(refusal(used(maestro)), "zero_ticks: the file's unit is us");
    calibration("unit = \"us\"\n", "us", "1500");
    EXPECT_EQ(refusal(used(maestro + ", channels = [0, 1, 2]")), "");
    EXPECT_SAYS(refusal(used(maestro + ", channels = [3, 4, 5]")),
                "thimble.toml is of channels 0, 1, 2, and this device says channels 3, 4, 5");
    EXPECT_SAYS(refusal(used(maestro + ", channels = [1, 0, 2]")), "it belongs to other servos");
    auto servos = [&](const std::string& each) {
        std::ofstream out(scratch_.path / "thimble.toml");
        for (int c = 0; c < 3; ++c) out << "[[servo]]\n" << each;
    };
    servos("zero_us = 1500\nus_per_rad = 573\nmin_us = 900\nmax_us = 2100\n");  // of no channel: by order
    EXPECT_EQ(refusal(used(maestro + ", channels = [3, 4, 5]")), "");
    servos("channel = 0\nzero_us = 1500\n");
    EXPECT_SAYS(refusal(used(maestro)), "channel 0 is that of another [[servo]], too");
    // Its range has to hold the rest pose, and should hold all that the joint can do.
    servos("zero_us = 1500\nus_per_rad = 573\nmin_us = 1499\nmax_us = 1501\n");
    EXPECT_SAYS(
        refusal(used(maestro)),
        "thimble.toml: the rest pose is at 1756 us of servo 1 (channel 0), outside of its range, 1499 us to 1501");
    servos("zero_us = 1500\nus_per_rad = -573\nmin_us = 1200\nmax_us = 2100\n");
    const auto lost = warnings(used(maestro));
    ASSERT_EQ(lost.size(), 3u);
    EXPECT_SAYS(lost.front(),
                "servo 1 (channel 0) needs 1122 us to 1851 us for its joint, and its range is 1200 us to");
    EXPECT_SAYS(lost.front(), "7.8 degrees (78 us) are lost");
    // Without a calibration it runs, and says that it should not be armed.
    const auto said = warnings(replaced(good, device, "{ driver = \"maestro\", channels = [0, 1, 2] }"));
    ASSERT_EQ(said.size(), 1u);
    EXPECT_SAYS(said.front(), "has no calibration");
}

/// Scenes as nobody would write them: the loader refuses or loads, whatever it gets.
TEST_F(SceneFiles, MutatedScenesAreRefusedOrLoaded) {
    const char* count = std::getenv("PALPATE_SCENE_MUTATIONS");
    const int mutations = count ? std::atoi(count) : 40;
    std::string base = replaced(good, "elements = 100", "elements = 20");
    base +=
        "material = { young_kPa = 40 }\n[solver]\npreset = \"fast\"\n[coupling]\nmax_force_N = 20\n"
        "[[object]]\nname = \"thing\"\nkind = \"box\"\nsize_mm = [9, 9, 9]\nposition_mm = [0, 70, 70]\nmass_g = 3\n"
        "[[friction]]\nfirst = \"thing\"\nsecond = \"table\"\ncoefficient = 0.3\n";
    const std::vector<std::string> words{"nan",
                                         "-inf",
                                         "1e308",
                                         "-9223372036854775808",
                                         "9223372036854775807",
                                         "true",
                                         "\"\"",
                                         "\"mesh\"",
                                         "\"chain\"",
                                         "[]",
                                         "{}",
                                         "[[[[]]]]",
                                         "{ a = { b = { c = [ { } ] } } }",
                                         "1979-05-27",
                                         "0",
                                         "-1",
                                         "0.5",
                                         "\"../../etc/passwd\"",
                                         "\"\\u0000\"",
                                         "[nan, nan, nan]",
                                         "[ 1, \"a\", { } ]",
                                         std::string(3000, '[') + std::string(3000, ']')};
    std::mt19937 random(11);
    auto below = [&](std::size_t n) { return std::size_t(random() % n); };
    int loaded = 0;
    for (int i = 0; i < mutations; ++i) {
        std::string text = base;
        for (int k = 0; k < 1 + int(below(3)); ++k) {
            const std::size_t at = below(text.size()), equals = text.find("= ", at);
            switch (below(5)) {
                case 0:
                    text.erase(at, 1 + below(12));
                    break;
                case 1:
                    text.insert(at, words[below(words.size())]);
                    break;
                case 2:
                    if (equals != std::string::npos)
                        text.replace(equals + 2, text.find_first_of(",}\n", equals + 2) - equals - 2,
                                     words[below(words.size())]);
                    break;
                case 3:
                    if (const std::size_t digit = text.find_first_of("0123456789", at); digit != std::string::npos)
                        text[digit] = char('0' + below(10));
                    break;
                default:
                    text.insert(text.find('\n', at) + 1, text.substr(at, below(200)));
            }
        }
        const std::string message = refusal(text);
        loaded += message.empty();
        EXPECT_TRUE(message.empty() || message.find("scene.toml") != std::string::npos) << message << text;
    }
    EXPECT_GT(loaded, 0);
    EXPECT_LT(loaded, mutations);
}

TEST_F(SceneFiles, MissingFiles) {
    EXPECT_THROW(load_scene(scratch_.path / "absent.toml"), InputError);
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { surface = \"absent.obj\" }")),
                "no such file");
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { tets = \"absent.msh\" }")),
                "no such file");
    EXPECT_SAYS(refusal(good + "[recording]\nfile = \"absent.jsonl\"\n"), "no such file");
    EXPECT_SAYS(refusal(replaced(good, "shape = { finger = \"index\" }", "mesh = { }")), "either surface");
}

TEST_F(SceneFiles, Overrides) {
    const auto path = scratch_.path / "scene.toml";
    std::ofstream(path) << good;
    const Scene scene = load_scene(path, {"finger.index.material.young_kPa=44", "solver.newton_iterations=3",
                                          "title=changed", "object.0.friction=0.2"});
    EXPECT_EQ(scene.spec.fingers[0].young_modulus, 44e3);
    EXPECT_EQ(scene.spec.solver.newton_iterations, 3);
    EXPECT_EQ(scene.title, "changed");
    EXPECT_EQ(scene.spec.objects[0].friction, 0.2);
    // A star stands for every entry, as in the axes of a sweep.
    const std::string two = std::string(good) + "\n[[finger]]\nname = \"thumb\"\nelements = 100\n" +
                            "track = [ { t_s = 0, position_mm = [0, 50, 12] } ]\n";
    std::ofstream(path) << two;
    for (const FingerSpec& finger : load_scene(path, {"finger.*.material.young_kPa=44"}).spec.fingers)
        EXPECT_EQ(finger.young_modulus, 44e3);
    EXPECT_SAYS(refusal(two, {"finger.*.elements=many"}), "finger \"thumb\".elements");
    EXPECT_SAYS(refusal(good, {"fingers.*.elements=50"}), "there is no 'fingers' to set");
    EXPECT_SAYS(refusal(good, {"solver.*.preset=fast"}), "there is no 'solver' to set");
    EXPECT_SAYS(refusal(good, {"nothing"}), "--set nothing");
    EXPECT_SAYS(refusal(good, {"finger.pinky.elements=50"}), "there is no 'pinky'");
    EXPECT_SAYS(refusal(good, {"solver.newton_iteration=3"}), "did you mean 'newton_iterations'?");
}

TEST_F(SceneFiles, FingersOfOneShapeFamilyShareAMesh) {
    const auto path = scratch_.path / "scene.toml";
    std::ofstream(path) << good << "\n[[finger]]\nname = \"thumb\"\nelements = 100\nshape = { finger = \"thumb\" }\n"
                        << "track = [ { t_s = 0, position_mm = [0, 50, 12] } ]\n";
    const Scene scene = load_scene(path);
    EXPECT_EQ(scene.spec.fingers[0].mesh.tets, scene.spec.fingers[1].mesh.tets);
    EXPECT_NE(scene.spec.fingers[0].mesh.nodes, scene.spec.fingers[1].mesh.nodes);
}

TEST_F(SceneFiles, ConformingMeshesAndPatches) {
    const std::string shape = "shape = { finger = \"index\" }";
    const std::string conforming = replaced(replaced(good, "elements = 100", "elements = 300"), shape,
                                            shape + "\nmesh = { kind = \"conforming\", patch = 5 }");
    EXPECT_EQ(refusal(conforming), "");
    const auto path = scratch_.path / "conforming.toml";
    std::ofstream(path) << conforming;
    const TetMesh mesh = load_scene(path, {}, &meshes_).spec.fingers[0].mesh;
    EXPECT_EQ(mesh.patches.size(), mesh.tets.size());
    // Fingers that differ in size share their template, and with it their lanes.
    std::string two = conforming + conforming.substr(conforming.find("[[finger]]"));
    two.replace(two.rfind("\"index\" }"), 9, "\"thumb\" }");
    two = replaced(two, "name = \"index\"\nelements = 300\nshape = { finger = \"thumb\" }",
                   "name = \"thumb\"\nelements = 300\nshape = { finger = \"thumb\" }");
    std::ofstream(path) << two;
    const Scene scene = load_scene(path, {}, &meshes_);
    EXPECT_EQ(scene.spec.fingers[0].mesh.tets, scene.spec.fingers[1].mesh.tets);
    EXPECT_EQ(scene.spec.fingers[0].mesh.patches, scene.spec.fingers[1].mesh.patches);

    EXPECT_SAYS(refusal(replaced(conforming, "\"conforming\"", "\"fine\"")), "uniform");
    EXPECT_SAYS(refusal(replaced(conforming, "patch = 5", "patch = 17")), "16");
    EXPECT_SAYS(refusal(replaced(conforming, "patch = 5 }",
                                 "patch = 5 }\nlayer = [ { thickness_mm = 1, young_kPa = 80, "
                                 "across_kPa = 90 } ]")),
                "across_kPa: expected no more than young_kPa");
    EXPECT_SAYS(refusal(replaced(conforming, "patch = 5", "patch = 5, limits = \"nodes\"")), "elements, patches");
    std::ofstream(path) << replaced(conforming, "patch = 5", "patch = 5, limits = \"patches\"")
                        << "\n[limits]\nlow = 0.6\nhigh = 1.4\n";
    EXPECT_FALSE(load_scene(path).spec.fingers[0].mesh.limit_patches.empty());
    EXPECT_SAYS(refusal(replaced(conforming, shape, shape + "\nmaterial = { kind = \"neo-hookean\" }")),
                "corotational");
    EXPECT_SAYS(refusal(replaced(conforming, shape, shape + "\nbone = { normal = [0, 0, 1], offset_mm = 1 }")),
                "no normal and no list");
    EXPECT_SAYS(refusal(replaced(conforming, shape, shape + "\nbone = { phalanx_height = 0.97 }")), "skin at (");
}

TEST_F(SceneFiles, JsonLinesRecording) {
    auto line = [](double t, double z, bool valid) {
        std::string joints;
        for (int j = 0; j < 26; ++j)
            joints += std::string(j ? "," : "") + "[" + std::to_string(0.01 * j) + "," + std::to_string(z) +
                      ",0,0,0,0,1,0.008]";
        return "{\"t\":" + std::to_string(t) + ",\"hand\":\"right\",\"valid\":" + (valid ? "true" : "false") +
               ",\"joints\":[" + joints + "]}\n";
    };
    const std::string header = "{\"units\":\"m\",\"up\":\"y\"}\n";
    const auto path = scratch_.path / "hand.jsonl";
    std::ofstream(path) << header << line(10, 0.10, true) << line(10.05, 0.12, true) << line(10.1, 0.14, false)
                        << line(10.3, 0.14, true) << line(10.35, 0.14, true);
    const HandRecording r = read_hand_recording(path, "right");
    ASSERT_EQ(r.frames.size(), 5u);
    EXPECT_NEAR(sample_recording(r, 1, 0.025).pose.position.z, 0.11, 1e-12);  // y up became z up
    EXPECT_TRUE(sample_recording(r, 1, 0.025).valid);
    EXPECT_FALSE(sample_recording(r, 1, 0.09).valid);  // marked invalid
    EXPECT_FALSE(sample_recording(r, 1, 0.2).valid);   // gap
    EXPECT_FALSE(sample_recording(r, 1, 5).valid);     // past the end
    // Fingers point along -z of the joint: distal is +y of the upright world.
    const Mat3<double> R = rotation_matrix(sample_recording(r, 1, 0.0).pose.rotation);
    EXPECT_NEAR(R[1][0], 1, 1e-9);
    EXPECT_NEAR(R[2][2], 1, 1e-9);
    for (const std::string& bad :
         {header + line(1, 0, true), header + "{\"t\":1,\"joints\":[1]}\n",
          header + line(2, 0, true) + line(1, 0, true), header + line(1, 0, true) + "{\"t\": 2, \"joi"}) {
        std::ofstream(path) << bad;
        EXPECT_THROW(read_hand_recording(path, "right"), InputError);
    }
    EXPECT_THROW(read_hand_recording(path, "left"), InputError);
}

}  // namespace
}  // namespace palpate
