#include "scenes/program/command_line.h"

#include <CLI/CLI.hpp>
#include <cstdio>

#include "scenes/program/command_table.h"

namespace palpate {

namespace {

std::string indented(std::string lines) {
    for (auto at = lines.find('\n'); at != std::string::npos; at = lines.find('\n', at + 1)) lines.insert(at + 1, "  ");
    return "  " + lines;
}

/// CLI11's own message, unless a command or an option is mistyped; then what may have been meant.
int complain(const CLI::App& program, const CLI::ParseError& error, const std::vector<std::string>& arguments) {
    if (error.get_exit_code() == 0) return program.exit(error);
    if (arguments.empty()) {
        std::fputs(program.help().c_str(), stderr);
        return 2;
    }
    const std::string meant = suggestion(command_table(program), arguments);
    if (meant.empty())
        program.exit(error);
    else
        std::fprintf(stderr, "palpate: %s\nRun with --help for more information.\n", meant.c_str());
    return 2;
}

}  // namespace

int obey_command_line(int argc, char** argv, const std::string& version,
                      const std::function<Actions(const Command&)>& add_commands) {
    CLI::App program{"palpate: feel virtual objects with several fingers at once", "palpate"};
    program.require_subcommand(1);
    program.set_version_flag("--version", version);
    program.footer("Begin with: palpate new mine.toml");
    const Actions actions = add_commands(Command(&program));
    for (CLI::App* command : program.get_subcommands({}))
        command->footer((command->get_footer().empty() ? "" : command->get_footer() + "\n\n") + "Examples:\n" +
                        indented(examples_of(command->get_name())));
    try {
        program.parse(argc, argv);
    } catch (const CLI::ParseError& error) { return complain(program, error, {argv + 1, argv + argc}); }
    return actions.at(program.get_subcommands().front()->get_name())();
}

}  // namespace palpate
