// Sweeps, budgets, comparisons and the stress suite, as their users run them.

#include "scenes/sweep.h"

#include <fstream>
#include <sstream>

#include "meshes/input_error.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::Outcome;
using testing::palpate_program;
using testing::ScratchFolder;

const std::string scenes = PALPATE_SOURCE_DIR "/scenes/";

std::string text_of(const std::filesystem::path& file) {
    std::stringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
}

TEST(Sweep, AxesAreReadAndCombined) {
    const SweepAxis axis = parse_axis("dt_ms=1,2,5");
    EXPECT_EQ(axis.key, "dt_ms");
    EXPECT_EQ(axis.values, (std::vector<std::string>{"1", "2", "5"}));
    EXPECT_THROW(parse_axis("dt_ms"), InputError);
    EXPECT_THROW(parse_axis("dt_ms="), InputError);
    const std::vector<SweepAxis> axes{axis, parse_axis("finger.*.elements=100,200")};
    EXPECT_EQ(combinations(axes).size(), 6u);
    EXPECT_EQ(overrides_of(axes, {"2", "200"}, {"thumb", "index"}),
              (std::vector<std::string>{"dt_ms=2", "finger.thumb.elements=200", "finger.index.elements=200"}));
}

TEST(Sweep, ErrorsAreSharesOfTheReference) {
    SweepTrace::Finger finger;
    finger.net = {0, 0, 2};
    finger.area = 1e-4;
    finger.field = {{0, 0, 1}, {0, 0, 1}};
    SweepTrace reference{{{finger}}}, other = reference;
    other.samples[0][0].field[0].z = 0.9;
    other.samples[0][0].net.z = 1.9;
    const SweepErrors e = errors_of(other, reference);
    EXPECT_NEAR(e.field, 0.05, 1e-12);
    EXPECT_NEAR(e.net, 0.05, 1e-12);
    EXPECT_EQ(e.area, 0);
    EXPECT_TRUE(std::isnan(e.platform_mm));
    other.samples[0][0].field.pop_back();  // another mesh: its field cannot be compared, its net force can
    EXPECT_TRUE(std::isnan(errors_of(other, reference).field));
    EXPECT_NEAR(errors_of(other, reference).net, 0.05, 1e-12);
}

TEST(Sweep, FindsThatMoreIterationsAreCloserAndGoesOnWhereItWas) {
    ScratchFolder scratch;
    const std::string command = "sweep " + scenes + "hand.toml --set duration_s=0.3 --out " + scratch.path.string() +
                                " --axes dt_ms=10 solver.newton_iterations=1,6";
    Outcome o = palpate_program(command);
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_NE(o.out.find("settings on the Pareto front"), std::string::npos) << o.out;
    EXPECT_TRUE(std::filesystem::exists(scratch.path / "sweep.svg"));
    std::istringstream rows(text_of(scratch.path / "sweep.csv"));
    std::vector<double> errors;
    for (std::string line; std::getline(rows, line);)
        if (line.starts_with("10,")) errors.push_back(std::strtod(line.c_str() + line.find(',', 3) + 1, nullptr));
    ASSERT_EQ(errors.size(), 2u);
    EXPECT_GT(errors[0], 2 * errors[1]);
    EXPECT_LT(errors[1], 0.05);
    // Cut in the middle of a row, as a kill would: that row is run again, the other is not.
    std::string text = text_of(scratch.path / "sweep.csv");
    const std::string first = text.substr(0, text.rfind("\n10,6") + 1);
    std::ofstream(scratch.path / "sweep.csv") << first << "10,6,0.0\n";
    o = palpate_program(command);
    EXPECT_EQ(o.code, 0) << o.out;
    text = text_of(scratch.path / "sweep.csv");
    EXPECT_TRUE(text.starts_with(first));
    EXPECT_EQ(palpate_program("sweep " + scenes + "hand.toml --axes dt_ms").code, 2);
    EXPECT_EQ(palpate_program("sweep " + scenes + "hand.toml --axes dt_ms=-1").code, 2);
}

TEST(Sweep, TwoProcessesFindWhatOneFinds) {
    if (std::system("command -v mpirun > /dev/null") != 0) GTEST_SKIP() << "mpirun is not installed (openmpi-bin)";
    ScratchFolder scratch;
    const std::string command =
        "sweep " + scenes + "press.toml --axes dt_ms=10,20 solver.newton_iterations=1,2,6 --threads 1 --out ";
    ASSERT_EQ(palpate_program(command + (scratch.path / "one").string()).code, 0);
    const std::string launch = "mpirun --allow-run-as-root --oversubscribe -n 2 " PALPATE_PROGRAM " ";
    const std::string two = launch + command + (scratch.path / "two").string() + " > /dev/null 2>&1";
    ASSERT_EQ(std::system(two.c_str()), 0);
    // Settings and errors; times differ.
    auto errors = [](const std::filesystem::path& file) {
        std::istringstream in(text_of(file));
        std::string kept;
        for (std::string line; std::getline(in, line);) {
            std::size_t end = 0;
            for (int comma = 0; comma < 6 && end != std::string::npos; ++comma) end = line.find(',', end + 1);
            kept += line.substr(0, end) + "\n";
        }
        return kept;
    };
    EXPECT_EQ(errors(scratch.path / "one" / "sweep.csv"), errors(scratch.path / "two" / "sweep.csv"));
    EXPECT_FALSE(std::filesystem::exists(scratch.path / "two" / "sweep-1.csv"));
}

TEST(Budget, TakesTheMostAccuratePresetThatFits) {
    ScratchFolder scratch;
    const std::string command = "run " + scenes + "press.toml --duration 0.2 --out " + scratch.path.string();
    Outcome o = palpate_program(command + " --budget-ms 10000");
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_NE(o.out.find("p99 of a step: reference"), std::string::npos) << o.out;
    o = palpate_program(command + " --budget-ms 0.001");
    EXPECT_EQ(o.code, 2);
    EXPECT_NE(o.out.find("no preset keeps its steps within"), std::string::npos) << o.out;
}

TEST(Compare, KindsMethodsAndServo) {
    ScratchFolder scratch;
    const Outcome o =
        palpate_program("compare " + scenes + "press.toml --set duration_s=0.3 --servo --out " + scratch.path.string() +
                        " --kinds rrs-exact,serial-5dof --methods constrained,force");
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_NE(o.out.find("serial-5dof, force matching"), std::string::npos) << o.out;
    EXPECT_TRUE(std::filesystem::exists(scratch.path / "index-rrs-exact-errors.csv"));
    EXPECT_EQ(palpate_program("compare " + scenes + "press.toml --kinds no-such-kind").code, 2);
}

TEST(Stress, TheShortCasesPass) {
    const Outcome o = palpate_program("stress --short --case S1,S2,S3,S4,S5,S6,S6b,S7,S9,S11,S13,S14");
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_EQ(o.out.find("FAIL"), std::string::npos) << o.out;
    EXPECT_EQ(palpate_program("stress --case S99").code, 2);
}

}  // namespace
}  // namespace palpate
