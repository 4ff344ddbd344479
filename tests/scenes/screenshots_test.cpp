// The page as people see it: in a real browser, on phones, laptops and large screens, light and dark, one sees who
// presses what, where and how hard. Kept in screenshots/, beside the tests.

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <set>
#include <sstream>

#include "scenes/run/simulation.h"
#include "tests/scenes/browser.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::attribute, testing::BrowserWindow, testing::page_of;

/// A scene of one's own: a torus as a surface from a file, and a finger that presses on it.
std::string torus_scene(const std::filesystem::path& folder) {
    std::ofstream surface(folder / "torus.obj");
    constexpr int around = 48, across = 24;
    for (int i = 0; i < around; ++i)
        for (int j = 0; j < across; ++j) {
            const double a = 2 * std::numbers::pi * i / around, b = 2 * std::numbers::pi * j / across;
            const double r = 22 + 9 * std::cos(b);
            surface << "v " << r * std::cos(a) << " " << r * std::sin(a) << " " << 9 * std::sin(b) << "\n";
        }
    auto vertex = [&](int i, int j) { return 1 + (i % around) * across + j % across; };
    for (int i = 0; i < around; ++i)
        for (int j = 0; j < across; ++j)
            surface << "f " << vertex(i, j) << " " << vertex(i + 1, j) << " " << vertex(i + 1, j + 1) << "\nf "
                    << vertex(i, j) << " " << vertex(i + 1, j + 1) << " " << vertex(i, j + 1) << "\n";
    std::ofstream(folder / "torus.toml") << R"(title = "A torus of one's own"
duration_s = 0.6
[[object]]
name = "torus"
kind = "mesh"
file = "torus.obj"
position_mm = [0, 0, -9]
[[finger]]
name = "index"
finger = "index-median"
device = { kind = "chinello-3rrs" }
track = [ { t_s = 0, position_mm = [22, 0, 9] }, { t_s = 0.4, position_mm = [22, 0, 5] } ]
)";
    return (folder / "torus.toml").string();
}

std::vector<std::string> parts_of(const std::string& text, char between) {
    std::vector<std::string> out;
    std::istringstream in(text);
    for (std::string part; std::getline(in, part, between);) out.push_back(part);
    return out;
}

struct Shown {
    std::string name;
    double moment;  ///< when it is looked at [s]
};
class Screenshots : public ::testing::TestWithParam<Shown> {};

TEST_P(Screenshots, ShowWhoPressesWhereAndHowHard) {
    if (!testing::browser_is_installed()) GTEST_SKIP() << "no browser to open it with (Debian package chromium)";
    const auto& [name, moment] = GetParam();
    testing::ScratchFolder scratch;
    const std::string scene =
        name == "torus" ? torus_scene(scratch.path) : testing::source_dir() + "/scenes/" + name + ".toml";
    const std::string out = (scratch.path / "out").string(), file = (scratch.path / "report.html").string();
    std::ostringstream command;
    command << testing::program_path() << " run " << scene << " --quiet --no-picture --duration " << moment + 0.04
            << " --out " << out << " --report " << file;
    ASSERT_EQ(std::system(command.str().c_str()), 0);
    std::vector<std::string> fingers;
    for (const FingerSpec& f : load_scene(scene).spec.fingers) fingers.push_back(f.name);

    std::ostringstream there;
    there << "file://" << file << "#still=1&probe=1&keys=End,ArrowLeft,ArrowLeft&hover=" << moment;
    const bool all =
        std::getenv("PALPATE_ALL_WINDOWS");  // as the nightly preset has it; else one, which is soon looked at
    std::string page;
    for (const int width : {390, 900, 1600})
        for (const bool dark : {false, true}) {
            if (!all && (width != 900 || dark)) continue;
            const std::string look = name + "-" + std::to_string(width) + (dark ? "-dark" : "");
            const std::filesystem::path shot = testing::screenshots() / (look + ".png");
            std::filesystem::remove(shot);
            page = page_of(there.str(), {width, width == 390 ? 844 : width * 9 / 16 + 150, dark, shot});
            EXPECT_EQ(attribute(page, "data-error"), "") << look;
            EXPECT_GT(std::atoi(attribute(page, "data-colours").c_str()), 500) << look << ": the picture is empty";
            EXPECT_GT(std::atoi(attribute(page, "data-red").c_str()), 30) << look << ": no contact is seen";
            EXPECT_LE(std::atoi(attribute(page, "data-across").c_str()), 0) << look << ": one has to scroll sideways";
            // Every finger's name and force, and the name of its pad, stand there whole, none covers another.
            std::set<std::string> names;
            for (const std::string& tag : parts_of(attribute(page, "data-names"), '|'))
                names.insert(tag.ends_with(" N") ? tag.substr(0, tag.find_last_of(' ', tag.size() - 3)) : tag);
            EXPECT_EQ(names, std::set<std::string>(fingers.begin(), fingers.end())) << look;
            EXPECT_GE(parts_of(attribute(page, "data-pads"), '|').size(), fingers.size()) << look;
            EXPECT_GT(std::filesystem::file_size(shot), 20'000u) << look;
        }

    // What a pointer over the first plot reads is the table's, for every finger; keys step through the frames.
    std::istringstream hover(attribute(page, "data-hover"));
    double time = 0;
    std::string unit;
    ASSERT_TRUE(hover >> time >> unit);
    for (const std::string& finger : fingers) {
        double force = -1;
        EXPECT_TRUE(hover >> force) << finger;
        const auto column = testing::column_by_ms(out + "/" + finger + ".csv", "contact_force_N");
        const int ms = int(std::lround(1e3 * time));
        ASSERT_TRUE(column.contains(ms)) << finger << " at " << time;
        EXPECT_NEAR(force, column.at(ms), 1e-3 * column.at(ms) + 1e-4) << finger;
    }
    EXPECT_NEAR(std::stod(attribute(page, "data-time")), moment - 1.5 / 30, 1.5 / 30);
    if (name == "hand") {
        EXPECT_EQ(
            testing::what_a_browser_says("file://" + file + "#still=1&probe=1&keys=Home,%20", "played to the end"),
            "played to the end");
    }
}

std::string name_of(const ::testing::TestParamInfo<Shown>& shown) {
    std::string out;
    for (const std::string& word : parts_of(shown.param.name, '_')) out += char(std::toupper(word[0])) + word.substr(1);
    return out;
}
INSTANTIATE_TEST_SUITE_P(Scenes, Screenshots,
                         ::testing::Values(Shown{"hand", 0.6}, Shown{"two_hands", 0.8}, Shown{"hold_mug", 1.0},
                                           Shown{"egg", 1.0}, Shown{"pinch", 0.8}, Shown{"torus", 0.5},
                                           Shown{"nodule", 0.6}),
                         name_of);

}  // namespace
}  // namespace palpate
