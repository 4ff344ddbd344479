// What commands write replaces nothing of another kind, and tracks turn as they are written.

#include <cmath>
#include <fstream>
#include <iterator>

#include "scenes/trackers/trajectory.h"
#include "tests/support.h"

namespace palpate {
namespace {

using namespace testing;

std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

TEST(Outputs, NothingOfAnotherKindIsReplaced) {
    ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/", scene = here + "mine.toml";
    const auto run = [&](const std::string& arguments) {
        return palpate_program(arguments + " --out " + here + "out --no-picture");
    };
    const std::string text = "duration_s = 0.05\n[[finger]]\nname = \"f\"\nelements = 100\n";
    std::ofstream(scene) << text;
    ASSERT_EQ(run("run " + scene + " --record " + here + "r.palpate").code, 0);
    const std::string recording = text_of(here + "r.palpate");
    std::ofstream(here + "notes.txt") << "mine";
    for (const std::string& arguments :
         {"run " + scene + " --record " + scene, "run " + scene + " --report " + scene,
          "run " + scene + " --video " + scene, "run " + scene + " --record " + here + "notes.txt"}) {
        const Outcome o = run(arguments);
        EXPECT_EQ(o.code, 2) << arguments << o.out;
        EXPECT_NE(o.out.find("it would be lost"), std::string::npos) << o.out;
    }
    const std::string replayed = here + "r.palpate";
    for (const std::string& arguments :
         {"convert " + replayed + " --hdf5 " + replayed, "replay " + replayed + " --extract " + replayed,
          "replay " + replayed + " --report " + replayed,
          "tracker udp:5990 --seconds 0.1 --record " + here + "notes.txt"})
        EXPECT_EQ(palpate_program(arguments).code, 2) << arguments;
    EXPECT_EQ(text_of(scene), text);
    EXPECT_EQ(text_of(replayed), recording);
    EXPECT_EQ(text_of(here + "notes.txt"), "mine");
    // Of its own kind it is, and where no frame came an old recording stays.
    EXPECT_EQ(run("run " + scene + " --record " + replayed).code, 0);
    EXPECT_EQ(palpate_program("replay " + replayed + " --extract " + scene).code, 0);
    std::ofstream(here + "hand.jsonl") << "{\"t\": 0}\n";
    EXPECT_EQ(palpate_program("tracker udp:0 --seconds 0.1 --record " + here + "hand.jsonl").code, 0);
    EXPECT_EQ(text_of(here + "hand.jsonl"), "{\"t\": 0}\n");
}

TEST(Outputs, NamesAreTextForXml) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/";
    std::ofstream(here + "mine.toml") << "duration_s = 0.05\n[[finger]]\nname = \"a<b & c\"\nelements = 100\n";
    const Outcome o =
        palpate_program("run " + here + "mine.toml --no-picture --pads-per-second 50 --out " + here + "out");
    ASSERT_EQ(o.code, 0) << o.out;
    const std::string pvd = text_of(here + "out/a<b & c.pvd");
    EXPECT_NE(pvd.find("file=\"a&lt;b &amp; c_0000.vtu\""), std::string::npos) << pvd;
}

TEST(Outputs, OptionsThatMeanNothingAreRefused) {
    const ScratchFolder scratch;
    const std::string out = " --out " + scratch.path.string() + "/out ";
    for (const auto& [arguments, said] :
         std::vector<std::pair<std::string, std::string>>{{"run press --hold key", "without --arm"},
                                                          {"view press --port 0 --hold key", "without --arm"},
                                                          {"run press --stream udp:127.0.0.1:0", "port of 1 to 65535"},
                                                          {"run press --duration nan", "finite"},
                                                          {"run press --pads-per-second nan", "finite"},
                                                          {"indent index --depth-mm nan", "finite"},
                                                          {"indent index --angle 0,nan", "finite"},
                                                          {"tracker udp:0 --seconds nan", "finite"},
                                                          {"tracker udp:0 --seconds inf", "finite"},
                                                          {"tracker udp:0 --seconds -nan", "finite"}}) {
        const bool has_out = arguments.starts_with("run") || arguments.starts_with("indent");
        const Outcome o = palpate_program(arguments + (has_out ? out : ""));
        EXPECT_EQ(o.code, 2) << arguments << "\n" << o.out;
        EXPECT_NE(o.out.find(said), std::string::npos) << arguments << "\n" << o.out;
    }
    EXPECT_FALSE(std::filesystem::exists(scratch.path / "out"));
}

TEST(Outputs, ReplaysNameFilesThatHaveChanged) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/";
    std::filesystem::copy_file(scenes + "mug.obj", here + "mug.obj");
    std::ofstream(here + "mine.toml") << "duration_s = 0.05\n[[object]]\nname = \"mug\"\nkind = \"mesh\"\nfile = "
                                         "\"mug.obj\"\nposition_mm = [100, 0, 0]\n[[finger]]\nname = \"f\"\nelements = "
                                         "100\n";
    const std::string file = here + "r.palpate";
    ASSERT_EQ(palpate_program("run " + here + "mine.toml --no-picture --out " + here + "out --record " + file).code, 0);
    Outcome o = palpate_program("replay " + file);
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_EQ(o.out.find("changed"), std::string::npos) << o.out;
    std::ofstream(here + "mug.obj", std::ios::app) << "# changed\n";
    o = palpate_program("replay " + file);
    EXPECT_NE(o.out.find(here + "mug.obj: has changed since the run was recorded"), std::string::npos) << o.out;
}

/// Frames of a recording stand in it once more, behind its end.
TEST(Outputs, NoLessThanNoStepsAreLost) {
    const ScratchFolder scratch;
    const std::string here = scratch.path.string() + "/", file = here + "r.palpate";
    std::ofstream(here + "mine.toml") << "duration_s = 0.3\ndt_ms = 5\n[[finger]]\nname = \"f\"\nelements = 100\n";
    ASSERT_EQ(palpate_program("run " + here + "mine.toml --no-picture --out " + here + "out --record " + file).code, 0);
    const std::string text = text_of(file);
    std::ofstream(file, std::ios::app | std::ios::binary) << text.substr(text.size() / 2, text.size() / 4);
    const Outcome o = palpate_program("replay " + file);
    EXPECT_EQ(o.code, 1) << o.out;
    EXPECT_NE(o.out.find("bytes are damaged before step"), std::string::npos) << o.out;
    EXPECT_EQ(o.out.find(": -"), std::string::npos) << o.out;
}

/// Angle of a track's turn about z, followed through it in small steps [degrees].
double turned_about_z(const std::vector<Keyframe>& track) {
    double sum = 0;
    Quaternion<double> before = track.front().pose.rotation;
    for (int k = 1; k <= 1000; ++k) {
        const Quaternion<double> now = trajectory_pose(track, 1e-3 * k).rotation, step = now * conjugate(before);
        sum += 2 * std::atan2(step.z, step.w < 0 ? -step.w : step.w) * (step.w < 0 ? -1 : 1);
        before = now;
    }
    return sum * 180 / M_PI;
}

TEST(Tracks, TurnAsWritten) {
    const double degree = M_PI / 180;
    for (double from : {0.0, -30.0})
        for (double by : {10.0, 170.0, 180.0, 270.0, 360.0, -360.0, 800.0, -3600.0}) {
            std::vector<Keyframe> track(2);
            track[1].time = 1;
            const Vec3<double> first{0, 0, from * degree}, last{0, 0, (from + by) * degree};
            track[0].pose.rotation = from_roll_pitch_yaw(first.x, first.y, first.z);
            track[1].pose.rotation = from_roll_pitch_yaw(last.x, last.y, last.z);
            track[1].turn = written_turn(first, last);
            EXPECT_EQ(track[1].turn.empty(), std::abs(by) < 180) << by;
            EXPECT_NEAR(turned_about_z(track), by, 1e-6) << from;
        }
}

TEST(Tracks, SeveralAnglesThatChangeMayBeASmallTurn) {
    const Vec3<double> a{0.3, 0, -1}, b{0, 1.4, 2.9};  // as in `hand`: 220 degrees of yaw
    EXPECT_TRUE(written_turn(a, b).empty());
    EXPECT_FALSE(written_turn(a, {0, 1.4, 5.4}).empty());
}

}  // namespace
}  // namespace palpate
