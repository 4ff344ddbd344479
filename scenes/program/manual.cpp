// The manual page, and the command that prints it.

#include <cstdio>

#include "scenes/program/command_table.h"
#include "scenes/program/commands.h"
#include "scenes/program/version.h"

namespace palpate {

namespace {

/// Text of a roff line: no character of it is a command.
std::string roff(const std::string& text) {
    std::string safe = text.starts_with(".") || text.starts_with("'") ? "\\&" : "";
    for (const char c : text) {
        if (c == '\\')
            safe += "\\e";
        else if (c == '-')
            safe += "\\-";
        else if (c == '\n')
            safe += ' ';
        else if (c == '\'')
            safe += "\\(aq";
        else if (c == '`')
            safe += "\\(ga";
        else if (c == '"')
            safe += "\\(dq";
        else
            safe += c;
    }
    return safe;
}

std::string entry(const OptionInfo& option) {
    std::string text = ".TP\n";
    if (!option.short_name.empty()) text += "\\fB" + roff(option.short_name) + "\\fR, ";
    text += "\\fB" + roff(option.name) + "\\fR";
    if (!option.value.empty()) text += " \\fI" + roff(option.value) + "\\fR";
    text += "\n" + roff(option.description);
    std::string words;
    for (const std::string& w : option.words) words += (words.empty() ? "" : ", ") + w;
    if (!words.empty()) text += "\n.br\nOne of " + roff(words) + ".";
    return text + "\n";
}

std::string section(const CommandInfo& command) {
    std::string text = ".SS palpate " + roff(command.name);
    for (const OptionInfo& p : command.positionals) text += roff(p.required ? " " + p.name : " [" + p.name + "]");
    text += "\n" + roff(command.description) + "\n";
    for (const OptionInfo& p : command.positionals) text += entry(p);
    for (const OptionInfo& o : command.options)
        if (o.name != "--help") text += entry(o);
    if (command.examples.empty()) return text;
    text += ".PP\nExamples:\n.PP\n.EX\n";
    std::size_t begin = 0;
    while (begin <= command.examples.size()) {
        const auto end = std::min(command.examples.find('\n', begin), command.examples.size());
        text += "    " + roff(command.examples.substr(begin, end - begin)) + "\n";
        begin = end + 1;
    }
    return text + ".EE\n";
}

}  // namespace

std::string manual_page(const std::vector<CommandInfo>& commands, const std::string& version) {
    std::string text = ".TH PALPATE 1 \"\" \"palpate " + roff(version) +
                       "\" \"User Commands\"\n"
                       ".SH NAME\npalpate \\- feel virtual objects with several fingers at once\n"
                       ".SH SYNOPSIS\n.B palpate\n.I command\n[\\fIoptions\\fR]\n"
                       ".SH DESCRIPTION\n"
                       "Simulates soft finger pads that follow a tracked hand, lets them press, explore and grasp "
                       "virtual objects, and finds for each finger the configuration of a wearable thimble whose "
                       "platform touches the pad where the object does.\n"
                       "Scenes are TOML files; \\fBpalpate new\\fR writes one to begin with.\n"
                       ".SH OPTIONS\n";
    for (const OptionInfo& option : commands.front().options) text += entry(option);
    text += ".SH COMMANDS\n";
    for (auto c = commands.begin() + 1; c != commands.end(); ++c) text += section(*c);
    return text +
           ".SH EXIT STATUS\n"
           ".TP\n.B 0\ndone\n"
           ".TP\n.B 1\nfailure inside\n"
           ".TP\n.B 2\ninput that cannot be used: every problem at once, with file, line and remedy; no partial "
           "output\n"
           ".TP\n.B 130\ninterrupted: results so far are written, thimbles go to their rest pose\n"
           ".SH FILES\n"
           ".TP\n.I results/SCENE/\nwhere \\fBpalpate run\\fR writes, unless \\fB\\-\\-out\\fR says otherwise\n"
           ".TP\n.I ~/.cache/palpate/\ntimes of presets that \\fB\\-\\-budget\\-ms\\fR has measured\n";
}

Action add_man_command(const Command& program) {
    program.subcommand("man", "print the manual page (roff)");
    return [program] {
        std::fputs(manual_page(command_table(program.app()), program_version).c_str(), stdout);
        return 0;
    };
}

}  // namespace palpate
