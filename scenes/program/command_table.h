#pragma once
// The program's commands as plain data, taken from CLI11's own tables: for completion, the manual and suggestions.

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace palpate {

struct OptionInfo {
    std::string name;        ///< "--out", or of a positional "scene"
    std::string short_name;  ///< "-h"; empty: none
    std::string description;
    std::string value;               ///< what it takes, for people: "TEXT", "FLOAT in [0.001 - 100000]"; empty: a flag
    std::vector<std::string> words;  ///< all that it takes, where that is a list
    bool required = false;
};

struct CommandInfo {
    std::string name, description;
    std::vector<OptionInfo> positionals, options;
    std::string examples;  ///< one per line
};

/// The program itself comes first.
std::vector<CommandInfo> command_table(const CLI::App& program);

/// Examples of a command, a line each; empty if there is no such command.
std::string examples_of(const std::string& command);

/// What a person may have meant who typed a command or an option that does not exist; empty if all exist.
std::string suggestion(const std::vector<CommandInfo>& commands, const std::vector<std::string>& arguments);

/// A script that completes commands, options and their words.
std::string bash_completion(const std::vector<CommandInfo>& commands);
std::string zsh_completion(const std::vector<CommandInfo>& commands);

/// The manual page, for man(1).
std::string manual_page(const std::vector<CommandInfo>& commands, const std::string& version);

}  // namespace palpate
