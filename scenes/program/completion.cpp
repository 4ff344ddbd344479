// Completion for shells, and the command that prints it.

#include <cstdio>
#include <memory>

#include "scenes/program/command_table.h"
#include "scenes/program/commands.h"

namespace palpate {

namespace {

std::string spaced(const std::vector<std::string>& words) {
    std::string all;
    for (const std::string& w : words) all += (all.empty() ? "" : " ") + w;
    return all;
}

std::string option_words(const CommandInfo& command) {
    std::vector<std::string> names;
    for (const OptionInfo& option : command.options) names.push_back(option.name);
    return spaced(names);
}

/// The words of the first positional that has a list of them.
std::string positional_words(const CommandInfo& command) {
    for (const OptionInfo& positional : command.positionals)
        if (!positional.words.empty()) return spaced(positional.words);
    return "";
}

/// Text inside single quotes of _arguments: brackets and colons have meanings there.
std::string zsh_quoted(const std::string& text) {
    std::string quoted;
    for (const char c : text) {
        if (c == '\'') {
            quoted += "'\\''";
            continue;
        }
        if (c == '[' || c == ']' || c == ':' || c == '\\') quoted += '\\';
        quoted += c;
    }
    return quoted;
}

std::string zsh_action(const OptionInfo& option) {
    return option.words.empty() ? "_files" : "(" + spaced(option.words) + ")";
}

std::string zsh_arguments(const CommandInfo& command) {
    std::string text;
    for (const OptionInfo& option : command.options) {
        text += " \\\n            '*" + option.name + "[" + zsh_quoted(option.description) + "]";
        if (!option.value.empty()) text += ":" + zsh_quoted(option.value) + ":" + zsh_action(option);
        text += "'";
    }
    for (const OptionInfo& positional : command.positionals)
        text += " \\\n            ':" + zsh_quoted(positional.name) + ":" + zsh_action(positional) + "'";
    return text;
}

}  // namespace

std::string bash_completion(const std::vector<CommandInfo>& commands) {
    std::string names;
    for (auto c = commands.begin() + 1; c != commands.end(); ++c) names += (names.empty() ? "" : " ") + c->name;
    std::string text =
        "# Completion of palpate for bash: eval \"$(palpate completion bash)\"\n"
        "_palpate() {\n"
        "    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} command= options words= i\n"
        "    for ((i = 1; i < COMP_CWORD; ++i)); do\n"
        "        [[ ${COMP_WORDS[i]} == -* ]] || { command=${COMP_WORDS[i]}; break; }\n"
        "    done\n"
        "    case $command in\n"
        "        '') options='" +
        option_words(commands.front()) + "' words='" + names + "' ;;\n";
    for (auto c = commands.begin() + 1; c != commands.end(); ++c) {
        text += "        " + c->name + ") options='" + option_words(*c) + "' words='" + positional_words(*c) +
                "'\n            case $previous in\n";
        for (const OptionInfo& option : c->options)
            if (!option.value.empty())
                text += "                " + option.name + ") options= words='" + spaced(option.words) + "' ;;\n";
        text += "            esac ;;\n";
    }
    return text +
           "        *) return ;;\n"
           "    esac\n"
           "    [[ $current == -* ]] && words=$options\n"
           "    [[ -z $words ]] || COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
           "}\n"
           "complete -o default -F _palpate palpate\n";
}

std::string zsh_completion(const std::vector<CommandInfo>& commands) {
    std::string text =
        "#compdef palpate\n"
        "# Completion of palpate for zsh: palpate completion zsh > a folder of $fpath/_palpate\n"
        "_palpate() {\n"
        "    local -a commands\n"
        "    commands=(";
    for (auto c = commands.begin() + 1; c != commands.end(); ++c)
        text += "\n        '" + zsh_quoted(c->name) + ":" + zsh_quoted(c->description) + "'";
    text +=
        ")\n"
        "    if (( CURRENT == 2 )); then\n"
        "        _describe command commands\n"
        "        return\n"
        "    fi\n"
        "    local command=$words[2]\n"
        "    shift words\n"
        "    (( CURRENT-- ))\n"
        "    case $command in\n";
    for (auto c = commands.begin() + 1; c != commands.end(); ++c)
        text += "        " + c->name + ") _arguments -s" + zsh_arguments(*c) + " ;;\n";
    return text +
           "    esac\n"
           "}\n"
           "if [ \"$funcstack[1]\" = _palpate ]; then _palpate \"$@\"; else compdef _palpate palpate; fi\n";
}

Action add_completion_command(const Command& program) {
    const Command c = program.subcommand("completion", "print a script that completes commands and options in a shell");
    auto shell = std::make_shared<std::string>();
    c.option("shell", *shell, "whose").required().among({"bash", "zsh"});
    return [program, shell] {
        const auto commands = command_table(program.app());
        std::fputs((*shell == "bash" ? bash_completion(commands) : zsh_completion(commands)).c_str(), stdout);
        return 0;
    };
}

}  // namespace palpate
