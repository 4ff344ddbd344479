// What was meant by a command or an option that does not exist.

#include <algorithm>

#include "scenes/load/key.h"
#include "scenes/program/command_table.h"

namespace palpate {

namespace {

std::vector<std::string> option_names(const CommandInfo& command) {
    std::vector<std::string> names;
    for (const OptionInfo& option : command.options) names.push_back(option.name);
    return names;
}

}  // namespace

std::string suggestion(const std::vector<CommandInfo>& commands, const std::vector<std::string>& arguments) {
    const auto word = std::find_if(arguments.begin(), arguments.end(), [](auto& a) { return !a.starts_with("-"); });
    const auto command = word == arguments.end() ? commands.begin()
                                                 : std::find_if(commands.begin() + 1, commands.end(),
                                                                [&](auto& c) { return c.name == *word; });
    if (command == commands.end()) {
        std::vector<std::string> names;
        for (auto c = commands.begin() + 1; c != commands.end(); ++c) names.push_back(c->name);
        return "no command '" + *word + "'; " + nearest_or_all(*word, names);
    }
    const std::vector<std::string> names = option_names(*command);
    for (const std::string& argument : arguments) {
        if (argument == "--") break;
        const std::string name = argument.substr(0, argument.find('='));
        if (name.starts_with("--") && std::find(names.begin(), names.end(), name) == names.end())
            return "no option '" + name + "'; " + nearest_or_all(name, names);
    }
    return "";
}

}  // namespace palpate
