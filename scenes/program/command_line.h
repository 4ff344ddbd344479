#pragma once
// From the words of a command line to the command that is done.

#include <functional>
#include <map>
#include <string>

#include "scenes/program/commands.h"

namespace palpate {

/// What each command does, by its name.
using Actions = std::map<std::string, Action>;

/// Does the command that the arguments name, and returns its exit code; 2 where they name none, having said what may
/// have been meant. Throws what the command throws.
int obey_command_line(int argc, char** argv, const std::string& version,
                      const std::function<Actions(const Command& program)>& add_commands);

}  // namespace palpate
