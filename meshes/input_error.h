#pragma once
// What is thrown for input that cannot be used: one sentence per problem, all of them at once.

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace palpate {

/// Each message names the place, what was expected, what was found and, where possible, the remedy.
class InputError : public std::runtime_error {
  public:
    explicit InputError(std::vector<std::string> list) : std::runtime_error(join(list)), messages(std::move(list)) {}
    explicit InputError(std::string message) : InputError(std::vector<std::string>{std::move(message)}) {}
    std::vector<std::string> messages;

  private:
    static std::string join(const std::vector<std::string>& list) {
        std::string all;
        for (const auto& m : list) all += (all.empty() ? "" : "\n") + m;
        return all;
    }
};

/// Throws an InputError that names the line of a file.
[[noreturn]] inline void refuse_line(const std::filesystem::path& path, int line, const std::string& what) {
    throw InputError(path.string() + ":" + std::to_string(line) + ": " + what);
}

}  // namespace palpate
