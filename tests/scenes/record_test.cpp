// Recorded runs: the same bits again, and nothing lost to a kill.

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <random>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/recording/hdf5_file.h"
#include "scenes/recording/run_file.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::scenes;

int exit_code_of(const std::string& arguments) {
    const int status = std::system((testing::program_path() + " " + arguments + " > /dev/null 2>&1").c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// Records `steps` steps of a scene.
void record(const std::filesystem::path& path, const std::string& scene, int steps) {
    Simulation s = make_simulation(load_scene(scenes + scene), 1);
    RunWriter writer(path, s, {});
    for (int k = 0; k < steps; ++k) {
        const StepInputs inputs = next_inputs(s);
        advance(s, inputs);
        writer.record(inputs, s);
    }
    writer.finish();
}

TEST(Record, ReplayGivesTheSameBitsForAnyNumberOfThreads) {
    testing::ScratchFolder scratch;
    const std::string file = (scratch.path / "run.palpate").string(), out = (scratch.path / "out").string();
    ASSERT_EQ(exit_code_of("run " + scenes + "hand.toml --duration 0.6 --threads 2 --no-picture --out " + out +
                           " --record " + file),
              0);
    EXPECT_EQ(exit_code_of("replay " + file + " --threads 1"), 0);
    EXPECT_EQ(exit_code_of("replay " + file + " --threads 2 --out " + out + "2"), 0);
    EXPECT_TRUE(std::filesystem::exists(out + "2/index.csv"));
    EXPECT_EQ(exit_code_of("replay " + file + " --extract " + out + ".toml"), 0);
    EXPECT_EQ(std::filesystem::file_size(out + ".toml"), std::filesystem::file_size(scenes + "hand.toml"));
}

TEST(Record, ConvertsToTablesAndPads) {
    testing::ScratchFolder scratch;
    const std::string file = (scratch.path / "run").string(), out = (scratch.path / "out").string();
    record(file, "press.toml", 80);
    ASSERT_EQ(exit_code_of("convert " + file + " --csv " + out + " --vtu " + out + "/pads --rate 20"), 0);
    const RecordedRun run = read_recording(file).runs.at(0);
    std::ifstream in(out + "/fingers/index.csv");
    std::string line;
    std::getline(in, line);
    EXPECT_EQ(line.substr(0, 30), "time_s,tracked,sample_time_s,x");
    std::size_t rows = 0;
    double last_force = 0;
    for (; std::getline(in, line); ++rows) last_force = std::strtod(line.c_str() + line.rfind(',') + 1, nullptr);
    EXPECT_EQ(rows, run.steps.size());
    EXPECT_NEAR(last_force, run.steps.back().outcome.forces[0].z, 1e-9);
    EXPECT_GT(last_force, 0.1);
    EXPECT_TRUE(std::filesystem::exists(out + "/objects/table.csv"));
    EXPECT_TRUE(std::filesystem::exists(out + "/pads/index.pvd"));
    EXPECT_TRUE(std::filesystem::exists(out + "/pads/index_0007.vtu"));
    const int hdf5 = exit_code_of("convert " + file + " --hdf5 " + out + ".h5");
    EXPECT_EQ(hdf5, has_hdf5() ? 0 : 2);
    if (has_hdf5()) {
        std::ifstream h5(out + ".h5", std::ios::binary);
        char head[4] = "";
        h5.read(head, 4);
        EXPECT_EQ(std::string(head, 4), "\x89HDF");
        EXPECT_GT(std::filesystem::file_size(out + ".h5"), 5000u);
        const std::string bytes = read_file(out + ".h5");
        for (const char* text : {"s,1,s,mm,mm,mm,1,1,1,1,N,N,N", "scene_text", "settings", "duration_s = "})
            EXPECT_NE(bytes.find(text), std::string::npos) << text;
    }
    EXPECT_EQ(exit_code_of("convert " + file), 2) << "to what?";
    EXPECT_EQ(exit_code_of("convert " + file + " --hdf5 /nowhere/x.h5"), 2);
}

TEST(Record, SaysWhereARunComesOutOtherwise) {
    testing::ScratchFolder scratch;
    record(scratch.path / "run", "press.toml", 60);
    RecordedRun run = read_recording(scratch.path / "run").runs.at(0);
    ASSERT_EQ(run.steps.size(), 60u);
    run.steps[30].inputs.fingers[0].pose.position.x += 1e-6;
    Simulation s = make_simulation(load_scene(run.scene, run.overrides), 1);
    for (std::size_t k = 0; k < run.steps.size(); ++k) {
        advance(s, run.steps[k].inputs);
        EXPECT_EQ(outcome_of(s).hashes == run.steps[k].outcome.hashes, k < 30) << "step " << k;
    }
}

TEST(Record, AChangedSceneIsNotReplayed) {
    testing::ScratchFolder scratch;
    const auto scene = scratch.path / "scene.toml";
    std::filesystem::copy_file(scenes + "press.toml", scene);
    const std::string file = (scratch.path / "run").string(), out = (scratch.path / "out").string();
    ASSERT_EQ(exit_code_of("run " + scene.string() + " --duration 0.1 --no-picture --out " + out + " --record " + file),
              0);
    std::ofstream(scene, std::ios::app) << "\n# changed\n";
    EXPECT_EQ(exit_code_of("replay " + file), 2);
    EXPECT_EQ(exit_code_of("replay " + file + " --extract " + scene.string()), 0);
    EXPECT_EQ(exit_code_of("replay " + file), 0);
}

TEST(Record, EverythingUpToTheLastCompleteFrameCanBeReadWhereverTheFileEnds) {
    testing::ScratchFolder scratch;
    const auto whole = scratch.path / "run", cut = scratch.path / "cut";
    record(whole, "press.toml", 40);
    std::ifstream in(whole, std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    const std::size_t frame = 12 + 33 + 89 + 56 + 3 * 8;  // one finger, one object, one thimble
    const std::size_t end = 12 + 8, header = bytes.size() - 40 * frame - end;
    std::mt19937 random(1);
    for (int trial = 0; trial < 100; ++trial) {
        const std::size_t size = std::uniform_int_distribution<std::size_t>(header, bytes.size() - end)(random);
        std::ofstream(cut, std::ios::binary).write(bytes.data(), std::streamsize(size));
        const Recording r = read_recording(cut);
        EXPECT_EQ(r.runs.at(0).steps.size(), (size - header) / frame);
        EXPECT_EQ(r.unread_bytes, (size - header) % frame);
        EXPECT_FALSE(r.losses.empty());
    }
    for (int trial = 0; trial < 100; ++trial) {  // damage
        auto damaged = bytes;
        const std::size_t at = std::uniform_int_distribution<std::size_t>(header, bytes.size() - end - 1)(random);
        damaged[at] = char(damaged[at] ^ (1 << trial % 8));
        std::ofstream(cut, std::ios::binary).write(damaged.data(), std::streamsize(damaged.size()));
        const Recording r = read_recording(cut);
        const std::size_t lost = (at - header) / frame;
        ASSERT_EQ(r.runs.at(0).steps.size(), 39u) << "what lies behind the damage is read, too";
        EXPECT_EQ(r.runs[0].gaps.at(0).step, lost);
        EXPECT_EQ(r.losses.size(), 1u);
        for (std::size_t k = 0; k < 39; ++k) EXPECT_EQ(r.runs[0].steps[k].number, int(k + (k >= lost) + 1));
    }
    for (const std::string& text : {std::string(), std::string("palpate1"), std::string("palpate2"),
                                    std::string("palpate3"), std::string("palpate1{}{}{}{}{}{}{}{}{}")}) {
        std::ofstream(cut, std::ios::binary) << text;
        EXPECT_THROW(read_recording(cut), InputError);
    }
}

TEST(Record, NothingRecordedIsLostWhenTheProcessIsKilled) {
    testing::ScratchFolder scratch;
    std::mt19937 random(2);
    for (int trial = 0; trial < 8; ++trial) {
        const std::string file = (scratch.path / "run").string();
        std::filesystem::remove(file);
        const pid_t child = fork();
        if (child == 0) {
            execl(testing::program_path().c_str(), "palpate", "run", (scenes + "press.toml").c_str(), "--quiet",
                  "--duration", "500", "--out", (scratch.path / "out").c_str(), "--record", file.c_str(), nullptr);
            _exit(4);
        }
        std::uintmax_t seen = 0;
        for (int i = 0; i < 30'000 && seen < 20'000; ++i, usleep(2'000))
            if (std::filesystem::exists(file)) seen = std::filesystem::file_size(file);
        usleep(std::uniform_int_distribution<useconds_t>(0, 30'000)(random));
        kill(child, SIGKILL);
        waitpid(child, nullptr, 0);
        const Recording recording = read_recording(file);
        const RecordedRun& run = recording.runs.at(0);
        EXPECT_GT(run.steps.size(), 50u);
        EXPECT_EQ(recording.unread_bytes, 0u);  // frames are written whole
        EXPECT_FALSE(run.ended);
        for (std::size_t k = 1; k < run.steps.size(); ++k) EXPECT_GT(run.steps[k].time, run.steps[k - 1].time);
    }
}

}  // namespace
}  // namespace palpate
