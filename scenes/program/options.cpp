#include "scenes/program/options.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>

#include "scenes/load/find_scene.h"

namespace palpate {

Option Option::required() {
    option_->required();
    return *this;
}

Option Option::finite() {
    const auto check = [](const std::string& given) {
        char* end = nullptr;
        const double value = std::strtod(given.c_str(), &end);
        const bool number = end != given.c_str();  // what is none is refused as it is read
        return number && !std::isfinite(value) ? "expected a finite number, found " + given : std::string();
    };
    option_->check(CLI::Validator(check, ""));
    return *this;
}

Option Option::range(int low, int high) {
    option_->check(CLI::Range(low, high));
    return *this;
}

Option Option::range(double low, double high) {
    option_->check(CLI::Range(low, high));
    return *this;
}

Option Option::among(const std::vector<std::string>& words) {
    option_->check(CLI::IsMember(words));
    return *this;
}

Option Option::comma_separated() {
    option_->delimiter(',');
    return *this;
}

Option Option::repeatable() {
    option_->take_all()->allow_extra_args(false);
    return *this;
}

Command Command::subcommand(const std::string& name, const std::string& description) const {
    return Command(app_->add_subcommand(name, description));
}

Command Command::formerly(const std::string& name) const {
    app_->alias(name);
    return *this;
}

Option Command::option(const std::string& name, std::string& value, const std::string& description) const {
    return Option(app_->add_option(name, value, description));
}

Option Command::option(const std::string& name, int& value, const std::string& description) const {
    return Option(app_->add_option(name, value, description));
}

Option Command::option(const std::string& name, double& value, const std::string& description) const {
    return Option(app_->add_option(name, value, description)).finite();
}

Option Command::option(const std::string& name, std::optional<double>& value, const std::string& description) const {
    return Option(app_->add_option(name, value, description)).finite();
}

Option Command::scene(const std::string& name, std::string& file, const std::string& description) const {
    CLI::Option* option = app_->add_option(name, file, description);
    option->transform([](const std::string& given) { return find_scene(given).string(); }, "");
    return Option(option);
}

void Command::footer(const std::string& text) const { app_->footer(text); }

Option Command::flag(const std::string& name, bool& value, const std::string& description) const {
    return Option(app_->add_flag(name, value, description));
}

}  // namespace palpate
