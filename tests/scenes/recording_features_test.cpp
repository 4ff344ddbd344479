// Recordings of everything that a scene can hold: killed, cut, of many runs, of the old version, on a full disk.

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "meshes/mesh_files.h"
#include "scenes/recording/hdf5_file.h"
#include "scenes/recording/run_file.h"
#include "scenes/run/carry_over.h"
#include "tests/support.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using testing::scenes;

/// Bodies that are released one after the other (declared in another order), a mesh, a soft object, a script, a
/// recorded hand, friction of pairs, limits, thimbles that match shapes and forces.
fs::path scene_of_everything(const fs::path& folder, const std::string& solver = "") {
    fs::copy_file(scenes + "mug.obj", folder / "mug.obj", fs::copy_options::skip_existing);
    fs::copy_file(scenes + "pinch.jsonl", folder / "pinch.jsonl", fs::copy_options::skip_existing);
    const fs::path file = folder / "everything.toml";
    write_file(file, R"(
title = "Everything"
duration_s = 0.5
dt_ms = 5
[limits]
low = 0.6
high = 1.4
[solver]
)" + solver + R"(
[recording]
file = "pinch.jsonl"
start_s = 0.6
[[object]]
name = "late"
kind = "sphere"
radius_mm = 12
position_mm = [0, 0, 100]
mass_g = 8
friction = 0.8
release_s = 0.16
[[object]]
name = "table"
kind = "plane"
friction = 0.5
[[object]]
name = "early"
kind = "box"
size_mm = [10, 10, 10]
position_mm = [60, 0, 20]
mass_g = 5
release_s = 0.06
[[object]]
name = "free"
kind = "sphere"
radius_mm = 6
position_mm = [90, 0, 30]
mass_g = 5
[[object]]
name = "mug"
kind = "mesh"
file = "mug.obj"
smoothing_mm = 4
position_mm = [0, 200, 0]
mass_g = 300
[[object]]
name = "cushion"
kind = "sphere"
radius_mm = 25
position_mm = [-100, -6, -25]
stiffness_kPa_per_mm = 15
[[object]]
name = "pusher"
kind = "capsule"
radius_mm = 3
length_mm = 10
track = [ { t_s = 0, position_mm = [40, 0, 6] }, { t_s = 0.3, position_mm = [52, 0, 6] } ]
[[friction]]
first = "early"
second = "table"
coefficient = 0.2
[[finger]]
name = "thumb"
shape = { finger = "thumb" }
follow = "thumb"
device = { kind = "chinello-3rrs" }
[[finger]]
name = "index"
shape = { finger = "index" }
follow = "index"
[[finger]]
name = "middle"
shape = { finger = "middle" }
device = { kind = "chinello-3rrs", method = "force" }
track = [ { t_s = 0, position_mm = [-98, 0, 8] }, { t_s = 0.3, position_mm = [-98, 0, 5] } ]
)");
    return file;
}

/// Runs the program with --record, and kills it as soon as the file has `bytes` bytes; 0: lets it end.
void record_and_kill(const fs::path& scene, const fs::path& file, const std::vector<std::string>& more,
                     std::uintmax_t bytes, useconds_t later) {
    std::vector<std::string> words{"palpate",      "run",   scene.string(),         "--quiet",
                                   "--no-picture", "--out", file.string() + ".out", "--record",
                                   file.string()};
    words.insert(words.end(), more.begin(), more.end());
    const pid_t child = fork();
    if (child == 0) {
        std::vector<char*> arguments;
        for (std::string& w : words) arguments.push_back(w.data());
        arguments.push_back(nullptr);
        execv(testing::program_path().c_str(), arguments.data());
        _exit(4);
    }
    std::error_code error;
    while (bytes > 0 && waitpid(child, nullptr, WNOHANG) == 0 &&
           (!fs::exists(file, error) || fs::file_size(file, error) < bytes))
        usleep(1000);
    if (bytes > 0) usleep(later), kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
}

/// Rows of a table, its header apart.
std::size_t rows_of(const fs::path& csv) {
    const std::string text = read_file(csv);
    return std::size_t(std::count(text.begin(), text.end(), '\n')) - 1;
}

/// A recording of version 1, as palpate wrote them before: with steps that grow where a body is released.
std::string as_version_1(const RecordedRun& run) {
    std::string out = "palpate1";
    auto frame = [&](std::uint32_t kind, const std::string& payload) {
        // The checksum is that of a frame of version 2.
        const fs::path file = testing::ScratchFolder().path.string() + ".frame";
        FrameWriter(file, "palpate1").append(kind, {payload.begin(), payload.end()});
        out += read_file(file).substr(8);
        fs::remove(file);
    };
    frame(1, nlohmann::json{{"scene", run.scene},
                            {"text", run.text},
                            {"overrides", run.overrides},
                            {"fingers", run.fingers},
                            {"objects", run.objects},
                            {"arrays", run.arrays},
                            {"governed", run.governed}}
                 .dump());
    for (const RecordedStep& step : run.steps) {
        std::vector<std::uint8_t> p;
        auto pose = [&](const Pose<double>& x) {
            for (double v :
                 {x.position.x, x.position.y, x.position.z, x.rotation.w, x.rotation.x, x.rotation.y, x.rotation.z})
                put(p, v);
        };
        put(p, step.time);
        for (const auto& s : step.inputs.fingers) put(p, std::uint8_t(s.valid)), put(p, s.time), pose(s.pose);
        for (const auto& x : step.inputs.objects) pose(x);
        for (const auto hash : step.outcome.hashes) put(p, hash);
        for (const auto& f : step.outcome.forces) put(p, f.x), put(p, f.y), put(p, f.z);
        if (run.governed) put(p, std::uint8_t(step.inputs.preset));
        frame(2, {p.begin(), p.end()});
    }
    return out;
}

TEST(Recording, OfEverythingReplaysAndConvertsWholeBeyondEveryRelease) {
    testing::ScratchFolder scratch;
    int number = 0;
    for (const std::string solver :
         {"detail = \"auto\"", "preset = \"fast\"\nprecision = \"float\"\ndeadline_ms = 0.5"}) {
        if (!testing::is_tried(number++, 2)) continue;
        const fs::path scene = scene_of_everything(scratch.path, solver), file = scratch.path / "run";
        record_and_kill(scene, file, {}, 0, 0);
        const Recording r = read_recording(file);
        ASSERT_EQ(r.runs.size(), 1u);
        ASSERT_EQ(r.runs[0].steps.size(), 100u) << solver;
        EXPECT_TRUE(r.losses.empty());
        EXPECT_EQ(r.runs[0].steps[0].outcome.moved.size(), 2u);
        EXPECT_EQ(r.runs[0].steps[99].outcome.moved.size(), 4u);
        EXPECT_EQ(r.runs[0].steps[99].arrays->size(), r.runs[0].steps[0].arrays->size() + 2);
        const testing::Outcome replayed = testing::palpate_program("replay " + file.string() + " --threads 1");
        EXPECT_EQ(replayed.code, 0) << replayed.out;
        EXPECT_NE(replayed.out.find("100 steps, 0.5 s: the same bit for bit"), std::string::npos) << replayed.out;
        const fs::path out = scratch.path / "tables";
        const std::string hdf5 = has_hdf5() ? " --hdf5 " + (scratch.path / "t.h5").string() : "";
        const auto converted = testing::palpate_program("convert " + file.string() + " --csv " + out.string() +
                                                        " --vtu " + (out / "pads").string() + " --rate 20" + hdf5);
        EXPECT_EQ(converted.code, 0) << converted.out;
        for (const char* table : {"fingers/thumb", "fingers/middle", "objects/late", "objects/early", "objects/mug"})
            EXPECT_EQ(rows_of(out / (std::string(table) + ".csv")), 100u) << table;
        EXPECT_TRUE(fs::exists(out / "pads" / "thumb_0009.vtu"));
        // What was let go has fallen.
        const std::string early = read_file(out / "objects/early.csv");
        EXPECT_EQ(r.runs[0].steps[10].inputs.objects[2].position.z, 0.02);
        EXPECT_LT(r.runs[0].steps[99].outcome.moved.at(1).pose.position.z, 0.015);
    }
}

TEST(Recording, WhatWasCompleteWhenTheProgramWasKilledIsReadReplayedAndConverted) {
    testing::ScratchFolder scratch;
    const fs::path scene = scene_of_everything(scratch.path, "preset = \"fast\""), file = scratch.path / "run";
    std::mt19937 random(5);
    for (int trial = 0; trial < 6; ++trial) {
        if (!testing::is_tried(trial, 3)) continue;
        fs::remove(file);
        const auto bytes = std::uniform_int_distribution<std::uintmax_t>(10'000, 90'000)(random);
        record_and_kill(scene, file, {"--duration", "60"}, bytes, useconds_t(random() % 20'000));
        const Recording r = read_recording(file);
        const RecordedRun& run = r.runs.at(0);
        ASSERT_GT(run.steps.size(), 2u);
        EXPECT_LT(r.unread_bytes, 2000u);
        EXPECT_TRUE(run.gaps.empty());
        for (std::size_t k = 0; k < run.steps.size(); ++k) ASSERT_EQ(run.steps[k].number, std::int64_t(k + 1));
        const auto replayed = testing::palpate_program("replay " + file.string());
        EXPECT_EQ(replayed.code, 1) << "it has no end";
        EXPECT_NE(replayed.out.find("the same bit for bit"), std::string::npos) << replayed.out;
        EXPECT_NE(replayed.out.find("it holds " + std::to_string(run.steps.size()) + " steps"), std::string::npos);
        const fs::path out = scratch.path / "tables";
        EXPECT_EQ(testing::palpate_program("convert " + file.string() + " --csv " + out.string()).code, 1);
        EXPECT_EQ(rows_of(out / "objects/late.csv"), run.steps.size());
    }
}

TEST(Recording, OfVersion1IsReadBeyondAReleaseAndReplayed) {
    testing::ScratchFolder scratch;
    const fs::path scene = scene_of_everything(scratch.path), file = scratch.path / "run", old = scratch.path / "old";
    // Meshes of which nothing was said were uniform then.
    write_file(scene, read_file(scene) + "[mesh]\nkind = \"uniform\"\npatch = 0\n");
    record_and_kill(scene, file, {}, 0, 0);
    const RecordedRun run = read_recording(file).runs.at(0);
    write_file(old, as_version_1(run));
    const Recording r = read_recording(old);
    EXPECT_EQ(r.version, 1);
    EXPECT_TRUE(r.losses.empty());
    ASSERT_EQ(r.runs.at(0).steps.size(), run.steps.size());
    for (std::size_t k = 0; k < run.steps.size(); ++k) {
        EXPECT_EQ(r.runs[0].steps[k].outcome.hashes, run.steps[k].outcome.hashes);
        EXPECT_EQ(r.runs[0].steps[k].outcome.forces[0].x, run.steps[k].outcome.forces[0].x);
    }
    const auto replayed = testing::palpate_program("replay " + old.string());
    EXPECT_EQ(replayed.code, 0) << replayed.out;
    EXPECT_NE(replayed.out.find("100 steps"), std::string::npos);
    const std::string bytes = read_file(old);
    write_file(old, bytes.substr(0, bytes.size() - 100));
    const auto cut = testing::palpate_program("replay " + old.string());
    EXPECT_EQ(cut.code, 1);
    EXPECT_NE(cut.out.find("99 steps"), std::string::npos) << cut.out;
}

TEST(Recording, KeepsEveryRunAndSettingsThatChangeWhileItGoesOn) {
    testing::ScratchFolder scratch;
    const fs::path scene = scene_of_everything(scratch.path, "preset = \"fast\""), file = scratch.path / "run";
    auto s = std::make_unique<Simulation>(make_simulation(load_scene(scene, {}), 1));
    RunWriter writer(file, *s, {});
    auto go = [&](int steps) {
        for (int k = 0; k < steps; ++k) {
            const StepInputs inputs = next_inputs(*s);
            advance(*s, inputs);
            writer.record(inputs, *s);
        }
    };
    go(50);
    writer.finish();
    const std::vector<std::string> soft{"material.young_kPa=20"},
        rough{"material.young_kPa=20", "solver.newton_iterations=3"};
    s = std::make_unique<Simulation>(make_simulation(load_scene(scene, soft), 1));
    writer.begin(*s, soft);
    go(25);
    auto fresh = std::make_unique<Simulation>(make_simulation(load_scene(scene, rough), 1));
    ASSERT_TRUE(carry_over(*s, *fresh));
    s = std::move(fresh);
    writer.change_settings(*s, rough);
    go(35);
    const Recording r = read_recording(file);
    ASSERT_EQ(r.runs.size(), 2u);
    EXPECT_EQ(r.runs[0].steps.size(), 50u);
    EXPECT_TRUE(r.runs[0].ended);
    EXPECT_EQ(r.runs[1].steps.size(), 60u);
    EXPECT_FALSE(r.runs[1].ended);
    ASSERT_EQ(r.runs[1].changes.size(), 1u);
    EXPECT_EQ(r.runs[1].changes[0].step, 25u);
    writer.finish();
    const auto replayed = testing::palpate_program("replay " + file.string() + " --threads 1");
    EXPECT_EQ(replayed.code, 0) << replayed.out;
    EXPECT_NE(replayed.out.find("run 2: 60 steps"), std::string::npos) << replayed.out;
    const fs::path out = scratch.path / "tables";
    EXPECT_EQ(testing::palpate_program("convert " + file.string() + " --csv " + out.string()).code, 0);
    EXPECT_EQ(rows_of(out / "run_0001/objects/late.csv"), 50u);
    EXPECT_EQ(rows_of(out / "run_0002/objects/late.csv"), 60u);
}

TEST(Recording, OnAFullDiskEndsWithAWholeFrameAndTheRunGoesOn) {
    testing::ScratchFolder scratch;
    const fs::path file = scratch.path / "run", out = scratch.path / "out";
    const testing::Outcome run = testing::shell(
        "ulimit -f 40; " + testing::program_path() + " run " + scenes + "press.toml --duration 1.5 --out " +
        out.string() + "2 --record " + file.string());  // 40 KiB in a POSIX shell's blocks of 512 bytes or 1 KiB
    EXPECT_EQ(run.code, 1) << run.out;
    EXPECT_NE(run.out.find("File too large; the recording ends there"), std::string::npos) << run.out;
    const Recording r = read_recording(file);
    EXPECT_EQ(r.unread_bytes, 0u);
    EXPECT_GT(r.runs.at(0).steps.size(), 20u);
    EXPECT_FALSE(r.runs[0].ended);
    EXPECT_EQ(testing::palpate_program("run " + scenes + "press.toml --record /dev/full").code, 1);
    EXPECT_EQ(testing::palpate_program("run " + scenes + "press.toml --record /nowhere/x").code, 2);
}

}  // namespace
}  // namespace palpate
