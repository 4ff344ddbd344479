// Results folders: those of one run, complete or as they were.

#include "scenes/recording/results_folder.h"

#include <algorithm>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/load/scene.h"
#include "scenes/recording/svg.h"
#include "tests/support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using testing::scenes;

std::vector<std::string> names_in(const fs::path& folder) {
    std::vector<std::string> out;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) out.push_back(entry.path().lexically_relative(folder).string());
    std::sort(out.begin(), out.end());
    return out;
}

std::string all(const std::vector<std::string>& sentences) {
    std::string out;
    for (const auto& s : sentences) out += s + "\n";
    return out;
}

std::vector<std::string> fill(const fs::path& folder, const std::vector<std::string>& names) {
    ResultsFolder results(folder);
    for (const auto& name : names) {
        fs::create_directories((results.part() / name).parent_path());
        write_file(results.part() / name, "text of " + name);
    }
    return results.finish();
}

TEST(Results, OfAnotherSceneGoAndWhatPalpateDidNotWriteStays) {
    testing::ScratchFolder scratch;
    const fs::path out = scratch.path / "out";
    EXPECT_TRUE(fill(out, {"index.csv", "thumb.csv", "summary.json", "sub/a.csv"}).empty());
    write_file(out / "mine.txt", "my notes");
    write_file(out / "thumb.csv", "edited by hand");
    write_file(out / "ring.csv", "of unknown origin");
    const std::string said = all(fill(out, {"index.csv", "ring.csv", "summary.json"}));
    EXPECT_EQ(names_in(out), (std::vector<std::string>{"files.json", "index.csv", "mine.txt", "ring.csv",
                                                       "summary.json", "thumb.csv"}));
    EXPECT_EQ(read_file(out / "ring.csv"), "text of ring.csv");
    EXPECT_EQ(read_file(out / "thumb.csv"), "edited by hand");
    for (const char* part : {"removed 1 file", "sub/a.csv", "overwrites 1 file of unknown origin (ring.csv)",
                             "changed since: thumb.csv", "1 file beside them was left alone (mine.txt)"})
        EXPECT_NE(said.find(part), std::string::npos) << part << " in\n" << said;
}

TEST(Results, AManifestFromElsewhereRemovesNothingOutside) {
    testing::ScratchFolder scratch;
    const fs::path out = scratch.path / "out", victim = scratch.path / "victim.txt";
    fill(out, {"a.csv"});
    write_file(victim, "keep");
    for (const std::string text : {"{", "[]", R"({"files": 3})", R"({"files": [3, {"name": 4}, {"name": ""}]})",
                                   R"({"files": [{"name": "../victim.txt", "bytes": 4, "modified": 0}]})",
                                   R"({"files": [{"name": "a.csv", "bytes": "x"}]})"}) {
        write_file(out / "files.json", text);
        EXPECT_NO_THROW(fill(out, {"b.csv"})) << text;
    }
    EXPECT_EQ(read_file(victim), "keep");
}

TEST(Results, WhatIsNotFinishedLeavesTheFolderAsItWas) {
    testing::ScratchFolder scratch;
    const fs::path out = scratch.path / "out";
    fill(out, {"index.csv"});
    const auto before = names_in(out);
    {
        ResultsFolder results(out);
        write_file(results.part() / "half.csv", "half");
    }
    EXPECT_EQ(names_in(out), before);
    // What a process that was killed has left goes with the next run.
    fs::create_directory(out / "palpate-unfinished-99999998");
    write_file(out / "palpate-unfinished-99999998" / "half.csv", "half");
    fill(out, {"index.csv"});
    EXPECT_FALSE(fs::exists(out / "palpate-unfinished-99999998"));
    { ResultsFolder fresh(scratch.path / "fresh"); }
    EXPECT_FALSE(fs::exists(scratch.path / "fresh"));
}

TEST(Results, AKilledRunLeavesItsTables) {
    testing::ScratchFolder scratch;
    const fs::path out = scratch.path / "out";
    const std::string run =
        testing::program_path() + " run " + scenes + "press.toml --quiet --no-picture --out " + out.string();
    // Killed once some of every table of a run that would take far longer is there (steps.csv is written last).
    testing::shell(run + " --duration 3000 --set dt_ms=5 --set solver.preset=fast & p=$!; for i in $(seq 600); do " +
                   "[ $(cat " + out.string() + "/*/steps.csv | wc -l) -gt 200 ] && break; sleep 0.1; done; " +
                   "kill -KILL $p; wait $p");
    fs::path left;
    for (const auto& entry : fs::directory_iterator(out)) left = entry.path();
    ASSERT_TRUE(left.filename().string().starts_with("palpate-unfinished-")) << left;
    EXPECT_TRUE(fs::exists(left / "UNFINISHED.txt"));
    EXPECT_FALSE(fs::exists(out / "summary.json"));
    const std::string table = read_file(left / "index.csv"), steps = read_file(left / "steps.csv");
    EXPECT_GT(std::count(table.begin(), table.end(), '\n'), 100);
    EXPECT_GT(std::count(steps.begin(), steps.end(), '\n'), 100);
    // The next one removes it, says so, and begins with the same rows.
    const auto next = testing::shell(testing::program_path() + " run " + scenes + "press.toml --no-picture --out " +
                                     out.string() + " --duration 0.1 --set dt_ms=5 --set solver.preset=fast");
    EXPECT_EQ(next.code, 0);
    EXPECT_NE(next.out.find("removes what a run that was killed had left unfinished"), std::string::npos) << next.out;
    EXPECT_FALSE(fs::exists(left));
    const std::string whole = read_file(out / "index.csv");
    EXPECT_EQ(whole, table.substr(0, whole.size()));
    EXPECT_NE(whole.find(",bone_qw,bone_qx,bone_qy,bone_qz,pressure_peak_kPa\n"), std::string::npos);
}

/// Steps in real time shall not wait for tables to be moved to where there is room for more, however long the run and
/// with armed thimbles' own column; where they do not fit into half of the memory, that is said.
TEST(Results, TablesHaveRoomForTheWholeRun) {
    const auto tables = [](const std::string& duration) {
        return make_simulation(load_scene(scenes + "press.toml", {"dt_ms=1", "duration_s=" + duration}), 1);
    };
    const Simulation hour = tables("2400");
    const Series& finger = hour.finger_series[0];
    if (hour.scene.warnings.empty()) {  // on a machine of 3 GB and more
        EXPECT_GE(finger.values.capacity(), 2400000 * (finger.columns.size() + 1));
    }
    const Simulation days = tables("100000");
    ASSERT_FALSE(days.scene.warnings.empty());
    EXPECT_NE(days.scene.warnings.back().find("the tables of 1e+08 steps take "), std::string::npos)
        << days.scene.warnings.back();
}

TEST(Results, PlotsHoldForcesAreasPressuresJointsAndStepTimes) {
    testing::ScratchFolder scratch;
    const fs::path out = scratch.path / "out";
    ASSERT_EQ(testing::shell(testing::program_path() + " run " + scenes + "press.toml --quiet --no-picture --out " +
                             out.string())
                  .code,
              0);
    const std::string svg = read_file(out / "plots.svg");
    std::size_t at = 0;
    for (const char* title : {"Contact force", "force [N]", "Contact area", "area [mm2]", "Pressure peak",
                              "pressure [kPa]", "Joint 1 of", "angle [degrees]", "Joint 3 of", "Step time"}) {
        const std::size_t found = svg.find(title, at);
        ASSERT_NE(found, std::string::npos) << title;
        at = found;
    }
    // Of many points, those that one sees: a spike of one point stays.
    Curve curve{"steps", {}, {}};
    for (int k = 0; k < 200'000; ++k)
        curve.x.push_back(1e-3 * k), curve.y.push_back(k == 123'456 ? 7 : 0.5 + 1e-3 * (k % 100));
    Plot plot{"a spike", "time [s]", "one", {curve}, {}, false};
    write_svg(scratch.path / "whole.svg", {plot});
    const std::string whole = read_file(scratch.path / "whole.svg");
    EXPECT_LT(whole.size(), 60'000u);
    plot.curves[0].x = {0, 100, 123.456, 123.457, 199.999}, plot.curves[0].y = {0.5, 0.5, 7, 0.5, 0.5};
    write_svg(scratch.path / "few.svg", {plot});
    const std::string few = read_file(scratch.path / "few.svg");
    // The spike's point, as the same axes place it.
    const std::size_t from = few.find('L', few.find('L') + 1) + 1;
    const std::string spike = few.substr(from, few.find('L', from) - from);
    EXPECT_NE(whole.find("L" + spike + "L"), std::string::npos) << spike;
}

TEST(Results, OfARunReplaceThoseOfAnotherScene) {
    testing::ScratchFolder scratch;
    const std::string out = (scratch.path / "out").string();
    const std::string thimble = scenes + "pinch.toml", press = scenes + "press.toml";
    ASSERT_EQ(testing::palpate_program("run " + thimble + " --duration 0.02 --no-picture --out " + out).code, 0);
    EXPECT_TRUE(fs::exists(out + "/thumb.csv"));
    const auto second = testing::palpate_program("run " + press + " --duration 0.02 --no-picture --out " + out);
    EXPECT_EQ(second.code, 0);
    EXPECT_NE(second.out.find("replaces the results that were there: removed"), std::string::npos) << second.out;
    EXPECT_FALSE(fs::exists(out + "/thumb.csv"));
    EXPECT_FALSE(fs::exists(out + "/object_cube.csv"));
    EXPECT_TRUE(fs::exists(out + "/index.csv"));
}

TEST(Results, AFullDiskLeavesNoPartialFileAndIsSaid) {
    testing::ScratchFolder scratch;
    const std::string out = (scratch.path / "out").string(),
                      run = testing::program_path() + " run " + scenes + "press.toml ";
    ASSERT_EQ(testing::shell(run + "--quiet --duration 0.02 --out " + out).code, 0);
    const auto before = names_in(out);
    const std::string summary = read_file(out + "/summary.json");
    // A limit on the size of files stands for the disk: the first large one cannot be written.
    for (const std::string& more : {std::string("--duration 1"), std::string("--duration 0.02 --pads-per-second 100"),
                                    "--duration 0.02 --report " + out + ".html"}) {
        const auto full = testing::shell("ulimit -f 8; " + run + more + " --out " + out);
        EXPECT_EQ(full.code, 1) << more << "\n" << full.out;
        EXPECT_NE(full.out.find("cannot be written: File too large"), std::string::npos) << full.out;
    }
    EXPECT_FALSE(fs::exists(out + ".html"));
    EXPECT_FALSE(fs::exists(out + ".html.part"));
    EXPECT_EQ(names_in(out), before);
    EXPECT_EQ(read_file(out + "/summary.json"), summary);
    EXPECT_EQ(testing::shell(run + "--duration 0.02 --out /dev/null/x").code, 2);
}

/// A scene of a body "x", a fixed one "y" and fingers with these names.
std::string scene_of(const std::vector<std::string>& fingers) {
    std::string text =
        "duration_s = 0.02\ndt_ms = 5\n[[object]]\nname = \"x\"\nkind = \"sphere\"\nradius_mm = 5\n"
        "mass_g = 5\nposition_mm = [0, 0, -50]\n[[object]]\nname = \"y\"\nkind = \"sphere\"\nradius_mm = 5\n"
        "position_mm = [0, 0, -90]\n";
    for (std::size_t k = 0; k < fingers.size(); ++k)
        text += "[[finger]]\nelements = 100\nname = \"" + fingers[k] + "\"\ntrack = [ { t_s = 0, position_mm = [0, " +
                std::to_string(60 * k) + ", 30] } ]\n";
    return text;
}

std::string refusal_of(const std::vector<std::string>& fingers) {
    try {
        load_scene_text(scene_of(fingers), "scene.toml");
        return "";
    } catch (const InputError& error) { return error.what(); }
}

TEST(Results, NamesThatWriteOneFileTwiceAreRefused) {
    EXPECT_EQ(refusal_of({"steps"}),
              "scene.toml:16:8: finger \"steps\".name: its table would be steps.csv, which is the table of steps: "
              "rename it");
    EXPECT_EQ(refusal_of({"object_x"}),
              "scene.toml:16:8: finger \"object_x\".name: its table would be object_x.csv, which is the table of "
              "object \"x\": rename it");
    EXPECT_EQ(refusal_of({"index", "index_nodes"}),
              "scene.toml:20:8: finger \"index_nodes\".name: its table would be index_nodes.csv, which is the table "
              "of nodes of finger \"index\": rename it");
    EXPECT_NE(refusal_of({"index_nodes", "index"}).find("its table of nodes would be index_nodes.csv"),
              std::string::npos);
    for (const char* controls : {"a\\u0000b", "a\\tb", "a\\u007f"}) {
        const std::string said = refusal_of({controls});
        EXPECT_TRUE(said.starts_with("scene.toml:16:8: finger[0].name: a name is used for files")) << said;
        EXPECT_EQ(said.find('\0'), std::string::npos);
    }
    // Of a fixed object there is no table; other words are as good as ever.
    EXPECT_EQ(refusal_of({"object_y", "summary", "step", "Steps", "index", "index_node", "d\u00e9"}), "");
}

TEST(Results, NamesThatArePadsOverTimeAreRefusedWhereThoseAreWritten) {
    testing::ScratchFolder scratch;
    const std::string file = (scratch.path / "pads.toml").string(),
                      run = "run " + file + " --no-picture --out " + (scratch.path / "out").string();
    write_file(file, scene_of({"index", "index_0001"}));
    EXPECT_EQ(testing::palpate_program(run + " --record " + file + ".palpate").code, 0);
    for (const std::string& pads :
         {run + " --pads-per-second 100", "convert " + file + ".palpate --vtu " + (scratch.path / "pads").string()}) {
        const auto o = testing::palpate_program(pads);
        EXPECT_EQ(o.code, 2) << o.out;
        EXPECT_NE(o.out.find("pads.toml: the mesh of finger \"index_0001\" would be index_0001.vtu, which is one of "
                             "the pads over time of finger \"index\""),
                  std::string::npos)
            << o.out;
    }
    write_file(file, scene_of({"index", "index_01", "index_0001x"}));
    EXPECT_EQ(testing::palpate_program(run + " --pads-per-second 100").code, 0);
}

TEST(Program, OutputThatCannotBeWrittenIsSaid) {
    testing::ScratchFolder scratch;
    const std::string run =
        "run " + scenes + "press.toml --duration 0.02 --no-picture --out " + (scratch.path / "out").string();
    const std::string says = "standard output: No space left on device";
    for (const std::string& command :
         {std::string("keys --json-schema"), run + " --json", run + " --stream -", run, std::string("man"),
          std::string("completion bash"), std::string("kinematics chinello-3rrs --json"),
          "explain " + scenes + "press.toml", std::string("--version"), std::string("run --help")}) {
        const auto o = testing::shell("(" + testing::program_path() + " " + command + " > /dev/full)");
        EXPECT_EQ(o.code, 1) << command << "\n" << o.out;
        EXPECT_NE(o.out.find(says), std::string::npos) << command << "\n" << o.out;
    }
    EXPECT_EQ(testing::palpate_program("run /no/such.toml > /dev/full").code, 2);
    // Whoever reads no more than the first line has what they want.
    for (const char* command : {"keys --json-schema", "man", "list scenes"}) {
        const auto o = testing::shell("(" + testing::program_path() + " " + command + " || echo code $? >&2) | true");
        EXPECT_EQ(o.out, "") << command;
    }
}

}  // namespace
}  // namespace palpate
