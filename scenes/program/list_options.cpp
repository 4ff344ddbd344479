// Options of several values, which take as long to compile as all others.

#include <CLI/CLI.hpp>

#include "scenes/program/options.h"

namespace palpate {

Option Command::option(const std::string& name, std::vector<std::string>& values,
                       const std::string& description) const {
    return Option(app_->add_option(name, values, description));
}

Option Command::option(const std::string& name, std::vector<int>& values, const std::string& description) const {
    return Option(app_->add_option(name, values, description));
}

Option Command::option(const std::string& name, std::vector<double>& values, const std::string& description) const {
    return Option(app_->add_option(name, values, description)).finite();
}

}  // namespace palpate
