// The first signal ends the program, whatever it is at; what it leaves behind does not look finished.

#include <sys/stat.h>

#include <fstream>

#include "meshes/mesh_files.h"
#include "tests/support.h"

namespace palpate {
namespace {

using namespace testing;

/// What the program said, and how it ended, where a signal comes after `seconds`; it is killed (137) where it has not
/// ended long after.
Outcome interrupted(const std::string& signal, double seconds, const std::string& arguments) {
    return shell("timeout --foreground --preserve-status -k 100 -s " + signal + " " + std::to_string(seconds) + " " +
                 program_path() + " " + arguments);
}

TEST(Interruption, EndsMeshing) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/";
    std::ofstream(here + "fine.toml") << "[[finger]]\nname = \"f\"\nelements = 150000\n";
    int number = 0;
    for (const std::string arguments :
         {"mesh index --elements 200000", "indent index --elements 150000 --out ", "run "}) {
        std::string all = arguments;
        if (arguments.starts_with("indent")) all += here + "indent";
        if (arguments.starts_with("run")) all += here + "fine.toml --out " + here + "out";
        ++number;
        for (const char* signal : {"INT", "TERM"}) {
            if (!testing::is_tried(number++, 2)) continue;
            const Outcome o = interrupted(signal, 1.5, all);
            EXPECT_EQ(o.code, 130) << signal << " " << all << "\n" << o.out;
            EXPECT_NE(o.out.find("interrupted"), std::string::npos) << o.out;
        }
    }
    EXPECT_FALSE(std::filesystem::exists(here + "indent"));
    EXPECT_FALSE(std::filesystem::exists(here + "out"));
    const std::string mesher = std::filesystem::path(program_path()).parent_path().string() + "/palpate-tetgen";
    EXPECT_TRUE(eventually([&] { return shell("pgrep -P 1 -f " + mesher).code != 0; })) << "a mesher is left at work";
}

TEST(Interruption, APipeThatNobodyReadsIsNoRecording) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/", pipe = here + "pipe";
    ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    std::ofstream(here + "mine.toml") << "duration_s = 0.05\n[[finger]]\nname = \"f\"\nelements = 100\n";
    const std::string run = "run " + here + "mine.toml --no-picture --out " + here + "out --record " + pipe;
    const Outcome refused = interrupted("TERM", 20, run);
    EXPECT_EQ(refused.code, 2) << refused.out;
    EXPECT_NE(refused.out.find("nobody reads"), std::string::npos) << refused.out;
    EXPECT_EQ(palpate_program("tracker udp:0 --seconds 0.1 --record " + pipe).code, 2);
    // One that is read is written to, and who stops reading ends the recording, not the run.
    const Outcome read = shell("cat " + pipe + " > " + here + "r.palpate & sleep 0.5; " + program_path() + " " + run);
    EXPECT_EQ(read.code, 0) << read.out;
    for (int k = 0; k < 100 && !std::filesystem::exists(here + "r.palpate"); ++k)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_EQ(palpate_program("replay " + here + "r.palpate").code, 0);
    const Outcome stalled = shell("(exec sleep 60 < " + pipe + ") & (sleep 0.5; " + program_path() + " " + run +
                                  " --duration 3; code=$?; kill $!; exit $code)");
    EXPECT_EQ(stalled.code, 1) << stalled.out;
    EXPECT_NE(stalled.out.find("cannot be written any further"), std::string::npos) << stalled.out;
}

TEST(Interruption, WhatIsLeftSaysSo) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/";
    std::ofstream csv(here + "data.csv");
    csv << "force_N,displacement_mm\n";
    for (int k = 1; k <= 5; ++k) csv << 0.025 * k * k << "," << 0.2 * k << "\n";
    csv.close();
    const Outcome fit =
        interrupted("INT", 2.5,
                    "fit " + here + "data.csv --fit young_kPa --elements 260 --starts 100 --iterations 1000 --out " +
                        here + "fitted.toml --json");
    EXPECT_EQ(fit.code, 130) << fit.out;
    if (std::filesystem::exists(here + "fitted.toml")) {  // a slow machine was still meshing
        const std::string text = read_file(here + "fitted.toml");
        EXPECT_NE(text.find("# INTERRUPTED"), std::string::npos) << text;
        EXPECT_NE(text.find("fit interrupted"), std::string::npos) << text;
        EXPECT_NE(fit.out.find("\"interrupted\": true"), std::string::npos) << fit.out;
    }
    const Outcome compared =
        interrupted("INT", 1, "compare roll --set duration_s=1000 --quiet --out " + here + "compared");
    EXPECT_EQ(compared.code, 130) << compared.out;
    EXPECT_NE(compared.out.find("interrupted"), std::string::npos) << compared.out;
}

}  // namespace
}  // namespace palpate
