#include "scenes/load/section.h"

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

bool has_controls(const std::string& text) {
    return std::any_of(text.begin(), text.end(), [](unsigned char c) { return c < 32 || c == 127; });
}

std::string Problems::placed(const toml::node* where, const std::string& message) const {
    PlainText out;
    out << file.string();
    if (where && where->source().begin.line > 0)
        out << ":" << where->source().begin.line << ":" << where->source().begin.column;
    out << ": " << message;
    return out.str();
}

namespace {

std::string describe(const toml::node& node) {
    PlainText out;
    if (node.is_table()) return "a table";
    if (node.is_array()) return "an array";
    node.visit([&](const auto& n) {
        if constexpr (toml::is_string<decltype(n)>)
            out << "the text \"" << n.get().substr(0, 80) << (n.get().size() > 80 ? "..." : "") << "\"";
        else if constexpr (toml::is_integer<decltype(n)> || toml::is_floating_point<decltype(n)>)
            out << n.get();
        else if constexpr (toml::is_boolean<decltype(n)>)
            out << (n.get() ? "true" : "false");
        else
            out << "a date or time";
    });
    return out.str();
}

std::string with_unit(const std::string& text, const Unit& unit) { return *unit.name ? text + " " + unit.name : text; }

std::string range_text(const Range& range) { return number_text(range.low) + " to " + number_text(range.high); }

std::string vector_text(const Vec3<double>& v, double si) {
    return "[" + number_text(v.x / si) + ", " + number_text(v.y / si) + ", " + number_text(v.z / si) + "]";
}

/// A node's number, unless it is none.
std::optional<double> number_of(const toml::node& node) {
    return node.is_number() ? node.value<double>() : std::optional<double>();
}

}  // namespace

KeyInfo& Section::declare(KeyInfo::Type type, const Name& key, const char* sentence) {
    known_.push_back(key.now);
    if (!declared_) return unrecorded_;
    KeyInfo& info = declared_->keys.emplace_back();
    info.type = type;
    info.name = key.now;
    info.before = key.before;
    info.sentence = sentence;
    return info;
}

const toml::node* Section::get(const Name& key) {
    if (!table_) return nullptr;
    const toml::node *now = table_->get(key.now), *before = key.before.empty() ? nullptr : table_->get(key.before);
    if (!before) return now;
    known_.push_back(key.before);
    // What the command line says (it has no place in the file) wins over the file, under whichever name.
    const bool before_wins = now && before->source().begin.line == 0 && now->source().begin.line > 0;
    if (now && before->source().begin.line > 0 && now->source().begin.line > 0)
        problems_->add(before, full(key.before) + ": is called " + key.now + " now, and that is given, too");
    else
        problems_->notes.push_back(problems_->placed(before, full(key.before) + ": is called " + key.now + " now"));
    return now && !before_wins ? now : before;
}

const toml::node* Section::place(const std::string& key) const {
    const toml::node* node = table_ ? table_->get(key) : nullptr;
    return node ? node : static_cast<const toml::node*>(table_);
}

bool Section::has(const std::string& key) const { return table_ && table_->contains(key); }

void Section::complain(const std::string& key, const std::string& message) {
    if (!wrong_.insert(key).second) return;
    if (table_ && !has(key)) absent_.push_back({key, message, problems_->messages.size()});
    problems_->add(place(key), full(key) + ": " + message);
}

void Section::doubt(const std::string& key, const std::string& message) {
    problems_->warnings.push_back(problems_->placed(place(key), full(key) + ": " + message));
}

void Section::complain(const std::string& message) {
    problems_->add(table_, (path_.empty() ? "" : path_ + ": ") + message);
}

void Section::complain_as_found(const std::string& key, const std::vector<std::string>& messages) {
    if (!wrong_.insert(key).second) return;
    for (const auto& message : messages) problems_->add(place(key), full(key) + ": " + message);
}

void Section::wrong(const Name& key, const toml::node* node, const std::string& expected) {
    wrong_.insert(key.now);
    const bool older = !table_->contains(key.now);
    problems_->add(node, full(older ? key.before : key.now) + ": expected " + expected);
}

bool Section::read_number(const Name& key, double& value, const Unit& unit, const Range& range,
                          const std::optional<Likely>& likely) {
    const toml::node* node = get(key);
    if (!node) return false;
    const auto found = number_of(*node);
    if (!found || !range.holds(*found)) {
        wrong(key, node, with_unit("a number from " + range_text(range), unit) + ", found " + describe(*node));
        return false;
    }
    value = *found * unit.si;
    if (!likely || (*found >= likely->low && *found <= likely->high)) return true;
    const char* looks = *found < likely->low ? likely->looks_below : likely->looks_above;
    const std::string usual =
        "usual are " + with_unit(number_text(likely->low) + " to " + number_text(likely->high), unit);
    if (*looks)
        problems_->warnings.push_back(problems_->placed(
            node, full(key.now) + ": " + number_text(*found) + " looks like " + looks +
                      (*unit.name ? "; " + std::string(unit.name) + " are expected" : "") + " (" + usual + ")"));
    return true;
}

void Section::number(const Name& key, double& value, const Unit& unit, const Range& range, const char* sentence,
                     const std::optional<Likely>& likely) {
    KeyInfo& info = declare(KeyInfo::Type::number, key, sentence);
    info.unit = unit.name;
    info.range = range;
    info.fallback = number_text(value / unit.si);
    read_number(key, value, unit, range, likely);
}

void Section::number(const Name& key, std::optional<double>& value, const Unit& unit, const Range& range,
                     const char* sentence, const std::optional<Likely>& likely) {
    KeyInfo& info = declare(KeyInfo::Type::number, key, sentence);
    info.unit = unit.name;
    info.range = range;
    if (double found = 0; read_number(key, found, unit, range, likely)) value = found;
}

void Section::integer(const Name& key, int& value, const Range& range, const char* sentence) {
    KeyInfo& info = declare(KeyInfo::Type::integer, key, sentence);
    info.range = range;
    info.fallback = std::to_string(value);
    const toml::node* node = get(key);
    if (!node) return;
    const auto found = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
    if (found && double(*found) >= range.low && double(*found) <= range.high)
        value = int(*found);
    else
        wrong(key, node, "a whole number from " + range_text(range) + ", found " + describe(*node));
}

void Section::boolean(const Name& key, bool& value, const char* sentence) {
    declare(KeyInfo::Type::boolean, key, sentence).fallback = value ? "true" : "false";
    const toml::node* node = get(key);
    if (!node) return;
    if (node->is_boolean())
        value = *node->value<bool>();
    else
        wrong(key, node, "true or false, found " + describe(*node));
}

void Section::text(const Name& key, std::string& value, const char* sentence) {
    declare(KeyInfo::Type::text, key, sentence).fallback = value.empty() ? "" : "\"" + value + "\"";
    const toml::node* node = get(key);
    if (!node) return;
    if (node->is_string())
        value = *node->value<std::string>();
    else
        wrong(key, node, "a text in quotes, found " + describe(*node));
}

void Section::choice(const Name& key, int& value, const std::vector<std::string>& words, const char* sentence,
                     const std::vector<std::pair<std::string, std::string>>& synonyms) {
    KeyInfo& info = declare(KeyInfo::Type::choice, key, sentence);
    info.words = words;
    info.fallback = "\"" + words.at(std::size_t(value)) + "\"";
    for (const auto& [older, word] : synonyms) info.synonyms.push_back(older);
    const toml::node* node = get(key);
    if (!node) return;
    std::string found = node->value<std::string>().value_or("");
    for (const auto& [older, word] : synonyms)
        if (found == older) found = word;
    const auto it = std::find(words.begin(), words.end(), found);
    if (it == words.end() || !node->is_string())
        return wrong(key, node, "one of " + joined(words) + ", found " + describe(*node));
    value = int(it - words.begin());
}

void Section::choice(const Name& key, std::string& value, const std::vector<std::string>& words, const char* sentence) {
    int place = int(std::find(words.begin(), words.end(), value) - words.begin());
    choice(key, place, words, sentence);
    value = words[std::size_t(place)];
}

bool Section::read_vector(const Name& key, Vec3<double>& value, const Unit& unit, double bound) {
    const toml::node* node = get(key);
    if (!node) return false;
    const toml::array* array = node->as_array();
    std::string found = array ? "an array of " + std::to_string(array->size()) : describe(*node);
    bool good = array && array->size() == 3;
    Vec3<double> v{0, 0, 0};
    for (std::size_t i = 0; good && i < 3; ++i) {
        const auto x = number_of((*array)[i]);
        good = x && std::abs(*x) <= bound;
        if (good)
            v[int(i)] = *x * unit.si;
        else
            found = describe((*array)[i]) + " as " + "xyz"[i];
    }
    if (good)
        value = v;
    else
        wrong(key, node,
              "three numbers [x, y, z] of at most " + with_unit(number_text(bound), unit) + ", found " + found);
    return good;
}

void Section::vector(const Name& key, Vec3<double>& value, const Unit& unit, double bound, const char* sentence) {
    KeyInfo& info = declare(KeyInfo::Type::vector, key, sentence);
    info.unit = unit.name;
    info.range = {-bound, bound};
    info.fallback = vector_text(value, unit.si);
    read_vector(key, value, unit, bound);
}

void Section::vector(const Name& key, std::optional<Vec3<double>>& value, const Unit& unit, double bound,
                     const char* sentence) {
    KeyInfo& info = declare(KeyInfo::Type::vector, key, sentence);
    info.unit = unit.name;
    info.range = {-bound, bound};
    if (Vec3<double> found{0, 0, 0}; read_vector(key, found, unit, bound)) value = found;
}

void Section::integers(const Name& key, std::vector<int>& values, const Range& range, const char* sentence) {
    declare(KeyInfo::Type::integers, key, sentence).range = range;
    const toml::node* node = get(key);
    if (!node) return;
    std::vector<int> read;
    std::string found = node->is_array() ? "" : describe(*node);
    if (node->is_array())
        for (const auto& entry : *node->as_array()) {
            const auto x = entry.is_integer() ? entry.value<std::int64_t>() : std::nullopt;
            if (x && double(*x) >= range.low && double(*x) <= range.high)
                read.push_back(int(*x));
            else if (found.empty())
                found = describe(entry) + " in it";
        }
    if (found.empty())
        values = std::move(read);
    else
        wrong(key, node, "an array of whole numbers from " + range_text(range) + ", found " + found);
}

Section Section::table(const Name& key, const char* sentence) {
    KeyInfo& info = declare(KeyInfo::Type::table, key, sentence);
    const toml::node* node = get(key);
    if (node && !node->is_table()) wrong(key, node, "a table, found " + describe(*node));
    return Section(node ? node->as_table() : nullptr, full(key.now), *problems_, declared_ ? &info : nullptr);
}

std::vector<Section> Section::tables(const Name& key, const char* sentence) {
    KeyInfo& info = declare(KeyInfo::Type::tables, key, sentence);
    std::vector<Section> list;
    if (declared_) list.emplace_back(nullptr, full(key.now), *problems_, &info);
    const toml::node* node = get(key);
    if (!node) return list;
    if (!node->is_array()) {
        wrong(key, node, "an array of tables ([[" + key.now + "]]), found " + describe(*node));
        return list;
    }
    int index = 0;
    for (const auto& entry : *node->as_array()) {
        std::string path = full(key.now) + "[" + std::to_string(index++) + "]";
        if (!entry.is_table()) {
            wrong_.insert(key.now);
            problems_->add(&entry, path + ": expected a table, found " + describe(entry));
            continue;
        }
        const std::string name = (*entry.as_table())["name"].value_or(std::string());
        if (!name.empty() && name.size() <= 80 && !has_controls(name)) path = full(key.now) + " \"" + name + "\"";
        list.emplace_back(entry.as_table(), path, *problems_);
    }
    return list;
}

void Section::require(const std::string& key, const std::string& why) {
    if (declared_)
        for (KeyInfo& info : declared_->keys)
            if (info.name == key) info.required = true;
    if (table_ && !has(key)) complain(key, why);
}

bool Section::misspelt(const std::string& key) const {
    if (!table_ || has(key)) return false;
    return std::any_of(table_->begin(), table_->end(), [&](const auto& entry) {
        const std::string other(entry.first.str());
        return std::find(known_.begin(), known_.end(), other) == known_.end() && is_much_like(other, key);
    });
}

void Section::finish() {
    if (!table_) return;
    std::vector<std::string> unknown;
    for (const auto& [name, node] : *table_) {
        const std::string key(name.str());
        if (std::find(known_.begin(), known_.end(), key) == known_.end()) unknown.push_back(key);
    }
    for (const std::string& key : unknown) {
        const toml::node* node = table_->get(key);
        // Where one key is needed and another unknown, one was meant for the other, however it is written.
        const auto meant = std::find_if(absent_.begin(), absent_.end(), [&](const Absent& a) {
            return is_much_like(key, a.key) || (unknown.size() == 1 && absent_.size() == 1);
        });
        if (meant == absent_.end()) {
            problems_->add(node, full(key) + ": unknown key; " + nearest_or_all(key, known_));
            continue;
        }
        const std::string text = full(key) + ": unknown key; did you mean '" + meant->key + "'? (" + meant->why + ")";
        problems_->messages[meant->message] = problems_->placed(node, text);
        absent_.erase(meant);
    }
}

namespace {

InputError fault_of(const toml::parse_error& error, const std::filesystem::path& file) {
    const auto& at = error.source().begin;
    return InputError(file.string() + ":" + std::to_string(at.line) + ":" + std::to_string(at.column) + ": " +
                      std::string(error.description()));
}

}  // namespace

toml::table parse_toml(const std::filesystem::path& file) {
    if (!std::filesystem::is_regular_file(file)) throw InputError(file.string() + ": no such file");
    try {
        return toml::parse_file(file.string());
    } catch (const toml::parse_error& error) { throw fault_of(error, file); }
}

toml::table parse_toml(const std::string& text, const std::filesystem::path& file) {
    try {
        return toml::parse(text);
    } catch (const toml::parse_error& error) { throw fault_of(error, file); }
}

}  // namespace palpate
