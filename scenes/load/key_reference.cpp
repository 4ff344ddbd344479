#include "scenes/load/key_reference.h"

#include <algorithm>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "scenes/load/finger_model.h"
#include "scenes/load/load_devices.h"
#include "scenes/load/scene.h"

namespace palpate {

namespace {

using Type = KeyInfo::Type;

bool is_table(const KeyInfo& k) { return k.type == Type::table || k.type == Type::tables; }

std::string type_text(const KeyInfo& k) {
    switch (k.type) {
        case Type::number:
            return "number";
        case Type::integer:
            return "whole number";
        case Type::boolean:
            return "true or false";
        case Type::text:
            return "text";
        case Type::choice:
            return "choice";
        case Type::vector:
            return "[x, y, z]";
        case Type::integers:
            return "whole numbers";
        case Type::table:
            return "table";
        case Type::tables:
            return "tables";
    }
    return "";
}

/// What the key takes: its words, or its bounds.
std::string range_text(const KeyInfo& k) {
    if (k.type == Type::choice) return joined(k.words);
    const bool bounded =
        k.type == Type::number || k.type == Type::integer || k.type == Type::vector || k.type == Type::integers;
    return bounded ? number_text(k.range.low) + " to " + number_text(k.range.high) : "";
}

/// How a table is written in a file.
std::string heading(const KeyInfo& table, const std::string& path) {
    return table.type == Type::tables ? "[[" + path + "]]" : "[" + path + "]";
}

std::string below(const std::string& path, const KeyInfo& k) { return path.empty() ? k.name : path + "." + k.name; }

/// Whether two tables hold the same keys: [coupling] and that of a finger.
bool same_keys(const KeyInfo& a, const KeyInfo& b) {
    return a.type == b.type && a.keys.size() == b.keys.size() &&
           std::equal(a.keys.begin(), a.keys.end(), b.keys.begin(), [](const KeyInfo& x, const KeyInfo& y) {
               return x.name == y.name && x.sentence == y.sentence && (!is_table(x) || same_keys(x, y));
           });
}

void list_tables(const KeyInfo& table, const std::string& path, std::vector<std::string>& names) {
    for (const KeyInfo& k : table.keys)
        if (is_table(k)) {
            names.push_back(below(path, k));
            list_tables(k, below(path, k), names);
        }
}

}  // namespace

std::vector<KeyInfo> file_kinds() { return {scene_keys(), finger_file_keys(), calibration_keys()}; }

const KeyInfo& find_table(const std::vector<KeyInfo>& kinds, const std::string& path) {
    if (path.empty()) return kinds.front();
    const KeyInfo* at = nullptr;
    std::istringstream parts(path);
    for (std::string part; std::getline(parts, part, '.');) {
        const KeyInfo* next = nullptr;
        if (!at)
            for (const KeyInfo& kind : kinds)
                if (kind.name == part) next = &kind;
        if (!next)
            for (const KeyInfo& k : (at ? *at : kinds.front()).keys)
                if (k.name == part && is_table(k)) next = &k;
        if (!next) {
            std::vector<std::string> names;
            for (const KeyInfo& kind : kinds) {
                names.push_back(kind.name);
                list_tables(kind, &kind == &kinds.front() ? "" : kind.name, names);
            }
            throw InputError("there is no table '" + path + "'; " + nearest_or_all(path, names));
        }
        at = next;
    }
    return at ? *at : kinds.front();
}

std::string key_listing(const std::vector<KeyInfo>& kinds, const std::string& name) {
    const KeyInfo& table = find_table(kinds, name);
    // In its own file a table goes by its path there.
    std::string path = name;
    for (const KeyInfo& kind : kinds)
        if (name == kind.name || name.starts_with(kind.name + "."))
            path = name.substr(std::min(name.size(), kind.name.size() + 1));
    PlainText out;
    out << (path.empty() ? table.name : heading(table, path)) << "  " << table.sentence << "\n";
    for (const KeyInfo& k : table.keys) {
        if (is_table(k)) continue;
        std::string line = "  " + k.name + (k.fallback.empty() ? "" : " = " + k.fallback);
        line.resize(std::max<std::size_t>(line.size() + 2, 44), ' ');
        line += type_text(k);
        if (const std::string range = range_text(k); !range.empty()) line += ": " + range;
        if (!k.unit.empty()) line += " " + k.unit;
        if (k.required) line += " (needed)";
        out << line << "\n      " << k.sentence << (k.before.empty() ? "" : " (Called " + k.before + " before.)")
            << "\n";
    }
    for (const KeyInfo& k : table.keys)
        if (is_table(k)) out << "  " << heading(k, below(path, k)) << "  " << k.sentence << "\n";
    return out.str();
}

namespace {

std::string cell(const std::string& text) {
    std::string out;
    for (char c : text) {
        if (c == '|') out += '\\';
        out += c;
    }
    return out;
}

void add_markdown(const KeyInfo& table, const std::string& path,
                  std::vector<std::pair<const KeyInfo*, std::string>>& seen, PlainText& out) {
    if (!path.empty()) {
        out << "### `" << heading(table, path) << "`\n\n" << table.sentence << "\n\n";
        for (const auto& [other, name] : seen)
            if (same_keys(*other, table)) {
                out << "Its keys are those of `" << heading(*other, name) << "`, over what stands there.\n\n";
                return;
            }
        seen.emplace_back(&table, path);
    }
    if (std::any_of(table.keys.begin(), table.keys.end(), [](const KeyInfo& k) { return !is_table(k); })) {
        out << "| key | takes | unit | default | what |\n|---|---|---|---|---|\n";
        for (const KeyInfo& k : table.keys) {
            if (is_table(k)) continue;
            const std::string range = range_text(k);
            out << "| `" << k.name << "` | " << cell(type_text(k) + (range.empty() ? "" : ": " + range)) << " | "
                << k.unit << " | "
                << (k.required           ? "needed"
                    : k.fallback.empty() ? ""
                                         : "`" + k.fallback + "`")
                << " | " << cell(k.sentence) << (k.before.empty() ? "" : " Called `" + k.before + "` before.")
                << " |\n";
        }
        out << "\n";
    }
    for (const KeyInfo& k : table.keys)
        if (is_table(k)) add_markdown(k, below(path, k), seen, out);
}

}  // namespace

std::string key_markdown(const std::vector<KeyInfo>& kinds) {
    PlainText out;
    out << "# Keys of all files\n\nMade by `palpate keys --markdown` from what the loader itself declares. `palpate "
           "keys "
           "TABLE` prints a part of it; `palpate keys --json-schema` is a schema with which editors complete and check "
           "scenes (taplo, Even Better TOML: `#:schema scene.schema.json` in the first line of a scene).\n\n"
           "A vector's bounds hold for each of its components. Vectors, ranges and defaults are in the unit of the "
           "file.\n\n";
    for (const KeyInfo& kind : kinds) {
        out << "## " << kind.name << "\n\n" << kind.sentence << "\n\n";
        std::vector<std::pair<const KeyInfo*, std::string>> seen;
        add_markdown(kind, "", seen, out);
    }
    std::string text = out.str();
    text.pop_back();
    return text;
}

}  // namespace palpate
