#include "scenes/program/command_table.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>

namespace palpate {

namespace {

/// The words of a list that CLI::IsMember checks: its type is named "TEXT:{a,b}".
std::vector<std::string> words_in(const std::string& type) {
    std::vector<std::string> words;
    const auto open = type.find('{'), close = type.rfind('}');
    if (open == std::string::npos || close == std::string::npos || close < open) return words;
    std::istringstream list(type.substr(open + 1, close - open - 1));
    for (std::string word; std::getline(list, word, ',');) words.push_back(word);
    return words;
}

OptionInfo describe(const CLI::Option& option) {
    OptionInfo info;
    const auto& longs = option.get_lnames();
    const auto& shorts = option.get_snames();
    if (option.get_positional() && longs.empty())
        info.name = option.get_name();
    else if (!longs.empty())
        info.name = "--" + longs.front();
    if (!shorts.empty()) info.short_name = "-" + shorts.front();
    info.description = option.get_description();
    info.required = option.get_required();
    if (option.get_items_expected_max() == 0) return info;
    const std::string type = option.get_type_name();
    info.words = words_in(type);
    const auto colon = type.find(':');  // "INT:INT in [1 - 1024]": the check says it all
    info.value = !info.words.empty() || colon == std::string::npos ? type.substr(0, colon) : type.substr(colon + 1);
    return info;
}

CommandInfo describe(const CLI::App& app) {
    CommandInfo info;
    info.name = app.get_name();
    info.description = app.get_description();
    info.examples = examples_of(info.name);
    for (const CLI::Option* option : app.get_options({}))
        (option->get_positional() ? info.positionals : info.options).push_back(describe(*option));
    return info;
}

}  // namespace

std::vector<CommandInfo> command_table(const CLI::App& program) {
    std::vector<CommandInfo> commands{describe(program)};
    for (const CLI::App* command : program.get_subcommands({})) commands.push_back(describe(*command));
    return commands;
}

}  // namespace palpate
