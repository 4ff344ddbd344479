// What meets a newcomer: scenes to begin with, lists, suggestions, examples, completion, the manual.

#include <fstream>
#include <iterator>

#include "scenes/load/presets.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::Outcome;
using testing::palpate_program;
using testing::program_path;
using testing::ScratchFolder;
using testing::shell;

std::string read(const std::filesystem::path& path) {
    std::ifstream in(path);
    return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> commands() {
    std::istringstream all(palpate_program("--help").out);
    std::vector<std::string> names;
    bool there = false;
    for (std::string line; std::getline(all, line);) {
        if (there && line.starts_with("  ") && line[2] != ' ')
            names.push_back(line.substr(2, line.find_first_of(" ,", 2) - 2));
        there = there || line == "Subcommands:";
    }
    return names;
}

class Template : public ::testing::TestWithParam<const char*> {};

TEST_P(Template, IsASceneThatRuns) {
    ScratchFolder scratch;
    const auto scene = scratch.path / "mine.toml";
    const Outcome written = palpate_program("new " + scene.string() + " --from " + GetParam());
    ASSERT_EQ(written.code, 0) << written.out;
    EXPECT_NE(written.out.find("palpate run " + scene.string()), std::string::npos) << written.out;
    const Outcome ran = palpate_program("run " + scene.string() + " --duration 0.05 --out " + scratch.path.string());
    EXPECT_EQ(ran.code, 0) << ran.out;
    const std::string text = read(scene);
    EXPECT_GT(std::count(text.begin(), text.end(), '#'), 5) << "it explains itself";
    EXPECT_NE(text.find(scene.string()), std::string::npos) << "its comments name the file as it was called";
}

INSTANTIATE_TEST_SUITE_P(New, Template, ::testing::Values("press", "grasp", "tracker", "thimble"),
                         [](const auto& info) { return std::string(info.param); });

TEST(Door, NewKeepsWhatIsThere) {
    ScratchFolder scratch;
    const auto scene = scratch.path / "mine.toml", dangling = scratch.path / "dangling.toml";
    std::ofstream(scene) << "precious";
    const Outcome refused = palpate_program("new " + scene.string());
    EXPECT_EQ(refused.code, 2);
    EXPECT_NE(refused.out.find("--force"), std::string::npos) << refused.out;
    EXPECT_EQ(read(scene), "precious");
    EXPECT_EQ(palpate_program("new " + scene.string() + " --force").code, 0);
    EXPECT_NE(read(scene), "precious");
    std::filesystem::create_symlink(scratch.path / "nowhere.toml", dangling);
    for (const std::string& arguments :
         {scratch.path.string(), (scratch.path / "mine.txt").string(), (scratch.path / "absent/mine.toml").string(),
          std::string(".toml"), std::string("''"), scene.string() + " --force --from cup", dangling.string(),
          "\"$(printf '" + scratch.path.string() + "/a\\nb.toml')\""}) {
        const Outcome o = palpate_program("new " + arguments);
        EXPECT_EQ(o.code, 2) << arguments << "\n" << o.out;
        EXPECT_GT(o.out.size(), 10u);
    }
    const auto folder = scratch.path / "folder.toml";
    std::filesystem::create_directory(folder);
    EXPECT_EQ(palpate_program("new " + folder.string() + " --force").code, 2);
}

TEST(Door, ListsWhatThereIs) {
    const std::string all = palpate_program("list").out;
    for (const char* name : {"hold_mug", "Five fingers lift a mug", "grasp", "index-median", "reference", "rrs-exact",
                             "geometry_mm", "chain", "dynamixel", "maestro-dry", "udp:PORT"})
        EXPECT_NE(all.find(name), std::string::npos) << name;
    const Outcome kinds = palpate_program("list kinds");
    EXPECT_EQ(kinds.code, 0);
    EXPECT_EQ(kinds.out.find("dynamixel"), std::string::npos);
    // Presets of fingers and of the solver stand apart.
    const std::string presets = palpate_program("list presets").out;
    const auto solver = presets.find("presets of the solver");
    EXPECT_LT(presets.find("thumb-large"), solver);
    for (const std::string& name : preset_names()) EXPECT_GT(presets.find("  " + name + " ", solver), solver) << name;
    EXPECT_EQ(palpate_program("list planets").code, 2);
    ScratchFolder scratch;  // from anywhere
    EXPECT_NE(shell("cd " + scratch.path.string() + " && " + program_path() + " list scenes").out.find("hold_mug"),
              std::string::npos);
}

TEST(Door, MistypedCommandsAndOptionsAreExitCodeTwoWithWhatWasMeant) {
    const std::pair<const char*, const char*> typed[] = {
        {"rnu scenes/press.toml", "'run'"},
        {"veiw scenes/press.toml", "'view'"},
        {"emulate-traker x", "'emulate-tracker'"},
        {"run scenes/press.toml --duratoin 1", "'--duration'"},
        {"run --thread=2 scenes/press.toml", "'--threads'"},
        {"mesh index --element 400", "'--elements'"},
        {"--verson", "'--version'"},
        {"quibble", "explain"},
    };
    for (const auto& [arguments, meant] : typed) {
        const Outcome o = palpate_program(arguments);
        EXPECT_EQ(o.code, 2) << arguments;
        EXPECT_NE(o.out.find(meant), std::string::npos) << arguments << "\n" << o.out;
    }
}

TEST(Door, EveryCommandHasExamplesThatNameIt) {
    ASSERT_GT(commands().size(), 20u);
    for (const std::string& command : commands()) {
        const Outcome o = palpate_program(command + " --help");
        EXPECT_EQ(o.code, 0);
        const auto examples = o.out.find("Examples:");
        ASSERT_NE(examples, std::string::npos) << command;
        EXPECT_NE(o.out.find("palpate " + command, examples), std::string::npos) << command;
    }
}

TEST(Door, VersionTellsCommitAndLanes) {
    const Outcome o = palpate_program("--version");
    EXPECT_EQ(o.code, 0);
    EXPECT_TRUE(o.out.starts_with("palpate 0.")) << o.out;
    EXPECT_NE(o.out.find("side by side in double"), std::string::npos) << o.out;
    const Outcome commit = shell("git -C " + testing::source_dir() + " rev-parse --short HEAD 2>/dev/null");
    if (commit.code == 0) { EXPECT_NE(o.out.find('('), std::string::npos) << o.out; }
}

/// What bash offers for a line whose last word is being typed.
std::string completed_by_bash(const std::string& line) {
    std::istringstream typed(line);
    std::string words;
    int count = 0;
    for (std::string word; typed >> word; ++count) words += " '" + word + "'";
    if (line.ends_with(" ")) words += " ''", ++count;
    return shell("bash --norc -c 'eval \"$(" + program_path() + " completion bash)\"; COMP_WORDS=(" +
                 [&] {  // quotes within quotes
                     std::string q;
                     for (const char c : words) q += c == '\'' ? "'\\''" : std::string(1, c);
                     return q;
                 }() +
                 "); COMP_CWORD=" + std::to_string(count - 1) + "; _palpate; echo \"${COMPREPLY[@]}\"'")
        .out;
}

TEST(Door, CommandsKeepTheirNamesOfBefore) {
    for (const char* before : {"device --help", "devices --help", "calibrate --help", "device chinello-3rrs --json"})
        EXPECT_EQ(palpate_program(before).code, 0) << before;
}

TEST(Door, BashCompletesCommandsOptionsAndWords) {
    if (shell("bash --version").code != 0) GTEST_SKIP() << "no bash";
    EXPECT_EQ(completed_by_bash("palpate calib"), "calibrate-thimble\n");
    EXPECT_EQ(completed_by_bash("palpate run --budg"), "--budget-ms\n");
    EXPECT_EQ(completed_by_bash("palpate new x.toml --from "), "grasp press thimble tracker\n");
    EXPECT_EQ(completed_by_bash("palpate kinematics rrs"), "rrs-exact\n");
    EXPECT_EQ(completed_by_bash("palpate list k"), "kinds\n");
    EXPECT_EQ(completed_by_bash("palpate run scenes/pr"), "\n") << "files are left to bash itself";
    EXPECT_EQ(completed_by_bash("palpate run --out re"), "\n");
    for (const std::string& command : commands())
        EXPECT_EQ(completed_by_bash("palpate " + command + " --hel"), "--help\n") << command;
}

TEST(Door, ZshReadsItsCompletion) {
    if (shell("zsh --version").code != 0) GTEST_SKIP() << "no zsh";
    const Outcome o = shell("zsh -fc 'autoload -U compinit; compinit -D; source <(" + program_path() +
                            " completion zsh); print $_comps[palpate]'");
    EXPECT_EQ(o.code, 0) << o.out;
    EXPECT_NE(o.out.find("_palpate"), std::string::npos) << o.out;
}

TEST(Door, TheManualIsCleanRoff) {
    ScratchFolder scratch;
    const auto page = (scratch.path / "palpate.1").string();
    ASSERT_EQ(shell(program_path() + " man > " + page).code, 0);
    const std::string text = read(page);
    for (const std::string& command : commands()) {
        std::string escaped;
        for (const char c : command) escaped += c == '-' ? "\\-" : std::string(1, c);
        EXPECT_NE(text.find(".SS palpate " + escaped), std::string::npos) << command;
    }
    if (shell("command -v groff").code != 0) GTEST_SKIP() << "no groff";
    const Outcome lint = shell("groff -man -Tascii -ww -z " + page);
    EXPECT_EQ(lint.code, 0);
    EXPECT_EQ(lint.out, "");
    const std::string shown = shell("groff -man -Tascii -P-cbou " + page).out;
    EXPECT_NE(shown.find("--budget-ms"), std::string::npos);
    EXPECT_NE(shown.find("130"), std::string::npos);
    if (shell("command -v man").code == 0) { EXPECT_NE(shell("man -l " + page).out.find("NAME"), std::string::npos); }
}

}  // namespace
}  // namespace palpate
