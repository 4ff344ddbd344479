#include "scenes/section.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace palpate {

void Problems::add(const toml::node* where, const std::string& message) {
    std::ostringstream out;
    out << file.string();
    if (where && where->source().begin.line > 0)
        out << ":" << where->source().begin.line << ":" << where->source().begin.column;
    out << ": " << message;
    messages.push_back(out.str());
}

namespace {

std::string describe(const toml::node& node) {
    std::ostringstream out;
    if (node.is_table()) return "a table";
    if (node.is_array()) return "an array";
    node.visit([&](const auto& n) {
        if constexpr (toml::is_string<decltype(n)>)
            out << "the text \"" << n.get() << "\"";
        else if constexpr (toml::is_integer<decltype(n)> || toml::is_floating_point<decltype(n)>)
            out << n.get();
        else if constexpr (toml::is_boolean<decltype(n)>)
            out << (n.get() ? "true" : "false");
        else
            out << "something else";
    });
    return out.str();
}

std::string number_text(double x) {
    std::ostringstream out;
    out << x;
    return out.str();
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
    std::vector<std::size_t> row(b.size() + 1);
    for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (std::size_t i = 1; i <= a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i;
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t old = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
            diagonal = old;
        }
    }
    return row[b.size()];
}

std::string joined(const std::vector<std::string>& words) {
    std::string all;
    for (const auto& w : words) all += (all.empty() ? "" : ", ") + w;
    return all;
}

}  // namespace

const toml::node* Section::get(const std::string& key) {
    known_.insert(key);
    return table_ ? table_->get(key) : nullptr;
}

bool Section::has(const std::string& key) { return get(key) != nullptr; }

double Section::number(const std::string& key, double fallback, double low, double high, double factor) {
    const toml::node* node = get(key);
    if (!node) return fallback * factor;
    const auto value = node->value<double>();
    if (!node->is_number() || !value || !std::isfinite(*value) || *value < low || *value > high) {
        problems_->add(node, full(key) + ": expected a number from " + number_text(low) + " to " + number_text(high) +
                                 ", found " + describe(*node));
        return fallback * factor;
    }
    return *value * factor;
}

int Section::integer(const std::string& key, int fallback, int low, int high) {
    const toml::node* node = get(key);
    if (!node) return fallback;
    const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
    if (!value || *value < low || *value > high) {
        problems_->add(node, full(key) + ": expected a whole number from " + std::to_string(low) + " to " +
                                 std::to_string(high) + ", found " + describe(*node));
        return fallback;
    }
    return int(*value);
}

bool Section::boolean(const std::string& key, bool fallback) {
    const toml::node* node = get(key);
    if (!node) return fallback;
    if (!node->is_boolean()) {
        problems_->add(node, full(key) + ": expected true or false, found " + describe(*node));
        return fallback;
    }
    return *node->value<bool>();
}

std::string Section::text(const std::string& key, const std::string& fallback) {
    const toml::node* node = get(key);
    if (!node) return fallback;
    if (!node->is_string()) {
        problems_->add(node, full(key) + ": expected a text in quotes, found " + describe(*node));
        return fallback;
    }
    return *node->value<std::string>();
}

std::string Section::choice(const std::string& key, const std::string& fallback,
                            const std::vector<std::string>& allowed) {
    const std::string value = text(key, fallback);
    if (std::find(allowed.begin(), allowed.end(), value) != allowed.end()) return value;
    problems_->add(get(key), full(key) + ": expected one of " + joined(allowed) + ", found \"" + value + "\"");
    return fallback;
}

Vec3<double> Section::vector(const std::string& key, const Vec3<double>& fallback, double bound, double factor) {
    const toml::node* node = get(key);
    if (!node) return factor * fallback;
    Vec3<double> v{0, 0, 0};
    const toml::array* array = node->as_array();
    bool good = array && array->size() == 3;
    for (int i = 0; good && i < 3; ++i) {
        const auto x = (*array)[i].value<double>();
        good = (*array)[i].is_number() && x && std::isfinite(*x) && std::abs(*x) <= bound;
        if (good) v[i] = *x * factor;
    }
    if (good) return v;
    problems_->add(
        node, full(key) + ": expected three numbers [x, y, z] of at most " + number_text(bound) + ", found " +
                  (array ? "an array of " + std::to_string(array->size()) + " values, or one that is no such number"
                         : describe(*node)));
    return factor * fallback;
}

std::vector<int> Section::integers(const std::string& key) {
    const toml::node* node = get(key);
    std::vector<int> values;
    if (!node) return values;
    bool good = node->is_array();
    if (good)
        for (const auto& entry : *node->as_array()) {
            const auto x = entry.is_integer() ? entry.value<std::int64_t>() : std::nullopt;
            good = good && x && *x >= 0 && *x < 10000000;
            if (good) values.push_back(int(*x));
        }
    if (!good)
        problems_->add(node, full(key) + ": expected an array of whole numbers from 0, found " + describe(*node));
    return values;
}

Section Section::table(const std::string& key) {
    const toml::node* node = get(key);
    if (node && !node->is_table()) problems_->add(node, full(key) + ": expected a table, found " + describe(*node));
    return Section(node ? node->as_table() : nullptr, full(key), *problems_);
}

std::vector<Section> Section::tables(const std::string& key) {
    std::vector<Section> list;
    const toml::node* node = get(key);
    if (!node) return list;
    if (!node->is_array()) {
        problems_->add(node,
                       full(key) + ": expected an array of tables ([[" + full(key) + "]]), found " + describe(*node));
        return list;
    }
    int index = 0;
    for (const auto& entry : *node->as_array()) {
        const std::string path = full(key) + "[" + std::to_string(index++) + "]";
        if (entry.is_table())
            list.emplace_back(entry.as_table(), path, *problems_);
        else
            problems_->add(&entry, path + ": expected a table, found " + describe(entry));
    }
    return list;
}

void Section::complain(const std::string& key, const std::string& message) {
    const toml::node* node = table_ ? table_->get(key) : nullptr;
    problems_->add(node ? node : static_cast<const toml::node*>(table_), full(key) + ": " + message);
}

void Section::finish() {
    if (!table_) return;
    for (const auto& [name, node] : *table_) {
        const std::string key(name.str());
        if (known_.count(key)) continue;
        std::string nearest;
        for (const std::string& k : known_)
            if (edit_distance(k, key) <= std::max<std::size_t>(2, key.size() / 4) &&
                (nearest.empty() || edit_distance(k, key) < edit_distance(nearest, key)))
                nearest = k;
        problems_->add(&node, full(key) + ": unknown key; " +
                                  (nearest.empty() ? "known here: " + joined({known_.begin(), known_.end()})
                                                   : "did you mean '" + nearest + "'?"));
    }
}

namespace {

/// Entry of an array of tables, by number or by the value of its "name".
toml::node* find_entry(toml::array& array, const std::string& key) {
    for (auto& entry : array)
        if (entry.is_table() && (*entry.as_table())["name"].value_or(std::string()) == key) return &entry;
    char* end = nullptr;
    const long index = std::strtol(key.c_str(), &end, 10);
    return !*end && !key.empty() && index >= 0 && index < long(array.size()) ? &array[std::size_t(index)] : nullptr;
}

}  // namespace

void apply_override(toml::table& root, const std::string& assignment, Problems& problems) {
    const std::string where = "--set " + assignment + ": ";
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0) return problems.add(nullptr, where + "expected key=value");
    std::vector<std::string> keys;
    std::istringstream path(assignment.substr(0, equals));
    for (std::string key; std::getline(path, key, '.');) keys.push_back(key);
    toml::node* node = &root;
    for (std::size_t i = 0; i + 1 < keys.size(); ++i) {
        if (node->is_array())
            node = find_entry(*node->as_array(), keys[i]);
        else if (node->is_table()) {
            if (!node->as_table()->contains(keys[i])) node->as_table()->insert(keys[i], toml::table{});
            node = node->as_table()->get(keys[i]);
        } else
            node = nullptr;
        if (!node) return problems.add(nullptr, where + "there is no '" + keys[i] + "' to set");
    }
    const std::string value = assignment.substr(equals + 1);
    if (node->is_array() || !node->is_table() || keys.empty())
        return problems.add(nullptr, where + "'" + (keys.empty() ? "" : keys.back()) + "' is not a key of a table");
    toml::table parsed;
    try {
        parsed = toml::parse("v = " + value);
    } catch (const toml::parse_error&) {
        parsed = toml::table{{"v", value}};  // words need no quotes on a command line
    }
    // A copy carries no line of the file: messages about it name the key alone.
    parsed.get("v")->visit([&](const auto& v) { node->as_table()->insert_or_assign(keys.back(), v); });
}

}  // namespace palpate
