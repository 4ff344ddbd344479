// "path=value" on the command line.

#include <toml++/toml.h>
#include <sstream>

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

namespace {

/// Entry of an array of tables, by number or by the value of its "name".
toml::node* find_entry(toml::array& array, const std::string& key) {
    for (auto& entry : array)
        if (entry.is_table() && (*entry.as_table())["name"].value_or(std::string()) == key) return &entry;
    char* end = nullptr;
    const long index = std::strtol(key.c_str(), &end, 10);
    return !*end && !key.empty() && index >= 0 && index < long(array.size()) ? &array[std::size_t(index)] : nullptr;
}

/// A whole table, or an entry of an array of tables: "object.ball=none".
bool take_out(toml::node& node, const std::string& key) {
    if (node.is_array()) {
        toml::array& array = *node.as_array();
        toml::node* entry = find_entry(array, key);
        if (!entry || !entry->is_table()) return false;
        for (auto it = array.begin(); it != array.end(); ++it)
            if (&*it == entry) return array.erase(it), true;
        return false;
    }
    toml::table* table = node.as_table();
    if (!table || (table->get(key) && !table->get(key)->is_table())) return false;
    table->erase(key);  // nothing where there is none
    return true;
}

/// What is wrong with taking out a key that stands nowhere: nothing, if a scene could have it there.
std::string unknown_key(const std::vector<std::string>& keys) {
    const KeyInfo scene = scene_keys();
    const KeyInfo* table = &scene;
    for (std::size_t i = 0; i < keys.size(); ++i) {
        std::vector<std::string> known;
        const KeyInfo* found = nullptr;
        for (const KeyInfo& k : table->keys) {
            known.push_back(k.name);
            if (k.name == keys[i]) found = &k;
        }
        if (!found) return "there is no key '" + keys[i] + "' to take out; " + nearest_or_all(keys[i], known);
        if (found->type == KeyInfo::Type::tables) ++i;  // the name or number of an entry
        table = found;
    }
    return "";
}

/// Sets, below `node`, what keys from `first` on name; `*` is every entry of an array. Returns what is wrong.
std::string set_below(toml::node* node, const std::vector<std::string>& keys, std::size_t first,
                      const std::string& value) {
    for (std::size_t i = first; i + 1 < keys.size(); ++i) {
        if (keys[i] == "*") {
            if (!node->is_array() || node->as_array()->empty())
                return "there is no '" + (i > 0 ? keys[i - 1] : keys[i]) + "' to set";
            std::string wrong;
            for (auto& entry : *node->as_array())
                if (wrong.empty()) wrong = set_below(&entry, keys, i + 1, value);
            return wrong;
        }
        if (node->is_array())
            node = find_entry(*node->as_array(), keys[i]);
        else if (node->is_table()) {
            if (!node->as_table()->contains(keys[i])) node->as_table()->insert(keys[i], toml::table{});
            node = node->as_table()->get(keys[i]);
        } else
            node = nullptr;
        if (!node) return "there is no '" + keys[i] + "' to set";
    }
    if (value == "none") {
        const bool stands = node->is_table() && node->as_table()->contains(keys.back());
        const std::string wrong = stands || node->is_array() ? "" : unknown_key(keys);
        if (!wrong.empty()) return wrong;
        if (take_out(*node, keys.back())) return "";
    }
    if (node->is_array() || !node->is_table() || keys.empty())
        return "'" + (keys.empty() ? "" : keys.back()) + "' is not a key of a table";
    toml::table parsed;
    try {
        parsed = toml::parse("v = " + value);
    } catch (const toml::parse_error&) {
        parsed = toml::table{{"v", value}};  // words need no quotes on a command line
    }
    // A copy carries no line of the file: messages about it name the key alone.
    parsed.get("v")->visit([&](const auto& v) { node->as_table()->insert_or_assign(keys.back(), v); });
    return "";
}

}  // namespace

void apply_override(toml::table& root, const std::string& assignment, Problems& problems) {
    const std::string where = "--set " + assignment + ": ";
    const std::size_t equals = assignment.find('=');
    if (equals == std::string::npos || equals == 0) return problems.add(nullptr, where + "expected key=value");
    std::vector<std::string> keys;
    std::istringstream path(assignment.substr(0, equals));
    for (std::string key; std::getline(path, key, '.');) keys.push_back(key);
    const std::string wrong = set_below(&root, keys, 0, assignment.substr(equals + 1));
    if (!wrong.empty()) problems.add(nullptr, where + wrong);
}

}  // namespace palpate
