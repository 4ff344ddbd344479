#pragma once
// Reading tables of a scene file: every problem is collected with file, line, key, what was expected
// and what was found; keys that nobody read are problems too.

#include <toml++/toml.h>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "engine/ecs/linear.h"

namespace palpate {

struct Problems {
    std::filesystem::path file;
    std::vector<std::string> messages;
    /// Adds "file:line:column: message".
    void add(const toml::node* where, const std::string& message);
};

/// One table. Each getter marks its key as known; `finish` complains about the rest.
class Section {
  public:
    Section(const toml::table* table, std::string path, Problems& problems)
        : table_(table), path_(std::move(path)), problems_(&problems) {}

    explicit operator bool() const { return table_ != nullptr; }
    const std::string& path() const { return path_; }
    bool has(const std::string& key);

    /// A finite number in [low, high], times `factor` to SI. The fallback is in the unit of the file, too.
    double number(const std::string& key, double fallback, double low, double high, double factor = 1);
    int integer(const std::string& key, int fallback, int low, int high);
    bool boolean(const std::string& key, bool fallback);
    std::string text(const std::string& key, const std::string& fallback);
    /// One of the allowed words.
    std::string choice(const std::string& key, const std::string& fallback, const std::vector<std::string>& allowed);
    /// Three finite numbers of at most `bound` each, times `factor`.
    Vec3<double> vector(const std::string& key, const Vec3<double>& fallback, double bound, double factor = 1);
    std::vector<int> integers(const std::string& key);
    /// A table; empty (false) if the key is absent.
    Section table(const std::string& key);
    /// An array of tables; empty if the key is absent.
    std::vector<Section> tables(const std::string& key);

    /// Complains at the place of a key (or of the table).
    void complain(const std::string& key, const std::string& message);
    /// Complains about keys that were not asked for. Call last.
    void finish();

  private:
    const toml::node* get(const std::string& key);
    std::string full(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }
    const toml::table* table_;
    std::string path_;
    Problems* problems_;
    std::set<std::string> known_;
};

/// Applies "path=value" to a parsed scene: finger.index.young_kPa=40, solver.newton_iterations=3. An
/// entry of an array of tables is chosen by its name or its number. Problems name the override.
void apply_override(toml::table& root, const std::string& assignment, Problems& problems);

}  // namespace palpate
