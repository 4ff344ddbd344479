#pragma once
// Reading tables of a scene file. Every call states all there is to know of a key: unit, range, default and a sentence.
// Problems are collected with file, line, key, what was expected and what was found; keys that nobody read are
// problems, too. The same readers over no file give the reference of all keys (key_reference.h).

#include <toml++/impl/forward_declarations.h>
#include <array>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include "engine/math/linear_algebra.h"
#include "scenes/load/key.h"

namespace palpate {

/// Whether a text has characters that nobody sees, such as NUL, at which names of files end.
bool has_controls(const std::string& text);

struct Problems {
    std::filesystem::path file;
    std::vector<std::string> messages;       ///< errors
    std::vector<std::string> warnings = {};  ///< accepted, but likely a mistake
    std::vector<std::string> notes = {};     ///< accepted, but there is a newer way to say it
    /// Adds "file:line:column: message".
    void add(const toml::node* where, const std::string& message) { messages.push_back(placed(where, message)); }
    std::string placed(const toml::node* where, const std::string& message) const;
};

/// One table, or a specimen of one that stands in no file and whose keys are only declared. Each reader takes the
/// default in `value` and leaves there what the file says, in SI units. `finish` complains about keys that no reader
/// knows. Of each key, one error is reported.
class Section {
  public:
    Section(const toml::table* table, std::string path, Problems& problems, KeyInfo* declared = nullptr)
        : table_(table), path_(std::move(path)), problems_(&problems), declared_(declared) {}

    /// Whether the table is there (or is a specimen).
    explicit operator bool() const { return table_ || declared_; }
    /// Whether it stands in a file: there is nothing to build of a specimen.
    bool in_file() const { return table_ != nullptr; }
    bool has(const std::string& key) const;
    /// False once there was an error with the key: what follows from its value would be false, too.
    bool sound(const std::string& key) const { return !wrong_.count(key); }

    /// A finite number in `range`, in the unit of the file.
    void number(const Name& key, double& value, const Unit& unit, const Range& range, const char* sentence,
                const std::optional<Likely>& likely = {});
    /// The same without a default: empty unless the file has it.
    void number(const Name& key, std::optional<double>& value, const Unit& unit, const Range& range,
                const char* sentence, const std::optional<Likely>& likely = {});
    void integer(const Name& key, int& value, const Range& range, const char* sentence);
    void boolean(const Name& key, bool& value, const char* sentence);
    void text(const Name& key, std::string& value, const char* sentence);
    /// One of the words, by its place. `synonyms` are older words for some of them.
    void choice(const Name& key, int& value, const std::vector<std::string>& words, const char* sentence,
                const std::vector<std::pair<std::string, std::string>>& synonyms = {});
    template <class E>
    requires std::is_enum_v<E>
    void choice(const Name& key, E& value, const std::vector<std::string>& words, const char* sentence) {
        int place = int(value);
        choice(key, place, words, sentence);
        value = E(place);
    }
    void choice(const Name& key, std::string& value, const std::vector<std::string>& words, const char* sentence);
    /// Three finite numbers of at most `bound` each, in the unit of the file.
    void vector(const Name& key, Vec3<double>& value, const Unit& unit, double bound, const char* sentence);
    void vector(const Name& key, std::optional<Vec3<double>>& value, const Unit& unit, double bound,
                const char* sentence);
    void integers(const Name& key, std::vector<int>& values, const Range& range, const char* sentence);
    /// A table; empty (false) if the key is absent.
    Section table(const Name& key, const char* sentence);
    /// An array of tables; empty if the key is absent. A specimen has one.
    std::vector<Section> tables(const Name& key, const char* sentence);
    /// Complains if the key, declared before, is absent.
    void require(const std::string& key, const std::string& why);

    /// An error at the place of a key (or of the table). Nothing if there was one already.
    void complain(const std::string& key, const std::string& message);
    /// The same as a warning: the file is accepted.
    void doubt(const std::string& key, const std::string& message);
    /// A fault of the table as a whole.
    void complain(const std::string& message);
    /// What others found wrong, with places of their own.
    void complain_as_found(const std::string& key, const std::vector<std::string>& messages);
    /// Whether the key is absent, and another that nobody knows is written much like it: what would follow from its
    /// default is not meant then.
    bool misspelt(const std::string& key) const;
    /// Complains about keys that were not declared; of one that was meant for a key whose absence has been complained
    /// of, in the place of that. Call last.
    void finish();
    /// What the table is called in messages.
    const std::string& path() const { return path_; }

  private:
    KeyInfo& declare(KeyInfo::Type type, const Name& key, const char* sentence);
    const toml::node* get(const Name& key);
    void wrong(const Name& key, const toml::node* node, const std::string& expected);
    bool read_number(const Name& key, double& value, const Unit& unit, const Range& range,
                     const std::optional<Likely>& likely);
    bool read_vector(const Name& key, Vec3<double>& value, const Unit& unit, double bound);
    std::string full(const std::string& key) const { return path_.empty() ? key : path_ + "." + key; }
    const toml::node* place(const std::string& key) const;

    const toml::table* table_;
    std::string path_;
    Problems* problems_;
    KeyInfo* declared_;  ///< of a specimen
    KeyInfo unrecorded_ = {};
    std::vector<std::string> known_;
    std::set<std::string> wrong_;
    /// A key that is needed and absent, and the error that says so.
    struct Absent {
        std::string key, why;
        std::size_t message;
    };
    std::vector<Absent> absent_;
};

/// Applies "path=value" to a parsed scene: finger.index.young_kPa=40, solver.newton_iterations=3. An
/// entry of an array of tables is chosen by its name or its number. Problems name the override.
void apply_override(toml::table& root, const std::string& assignment, Problems& problems);

/// Parses a file. Throws InputError with file, line and column of a fault.
toml::table parse_toml(const std::filesystem::path& file);
/// Parses text; messages call it `file`.
toml::table parse_toml(const std::string& text, const std::filesystem::path& file);

}  // namespace palpate
