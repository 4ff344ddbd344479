#pragma once
// Options of commands: a thin layer over CLI11, which takes ten seconds to compile wherever it is included.

#include <optional>
#include <string>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace palpate {

/// What a declared option demands of its values. Handles are cheap to copy; CLI11 owns what they stand for.
class Option {
  public:
    explicit Option(CLI::Option* option) : option_(option) {}
    Option required();
    /// Numbers, none of them infinite or nan, which ranges let through.
    Option finite();
    /// Values in [low, high].
    Option range(int low, int high);
    Option range(double low, double high);
    /// Values among these words.
    Option among(const std::vector<std::string>& words);
    /// Several values, separated by commas.
    Option comma_separated();
    /// Given any number of times, with one value each time.
    Option repeatable();

  private:
    CLI::Option* option_;
};

/// A command, or the program itself. What options are read into must outlive the parsing.
class Command {
  public:
    explicit Command(CLI::App* app) : app_(app) {}
    const CLI::App& app() const { return *app_; }
    Command subcommand(const std::string& name, const std::string& description) const;
    /// Its name of before, which still works.
    Command formerly(const std::string& name) const;
    /// "--name" is optional, "name" is a positional argument; the value given before stays where there is none.
    Option option(const std::string& name, std::string& value, const std::string& description) const;
    Option option(const std::string& name, int& value, const std::string& description) const;
    Option option(const std::string& name, double& value, const std::string& description) const;
    Option option(const std::string& name, std::optional<double>& value, const std::string& description) const;
    Option option(const std::string& name, std::vector<std::string>& values, const std::string& description) const;
    Option option(const std::string& name, std::vector<int>& values, const std::string& description) const;
    Option option(const std::string& name, std::vector<double>& values, const std::string& description) const;
    /// A scene file, found by its bare name, too (find_scene.h).
    Option scene(const std::string& name, std::string& file, const std::string& description) const;
    /// What its help ends with, before the examples.
    void footer(const std::string& text) const;
    Option flag(const std::string& name, bool& value, const std::string& description) const;

  private:
    CLI::App* app_;
};

}  // namespace palpate
