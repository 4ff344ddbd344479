#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/load/key_reference.h"
#include "scenes/program/commands.h"

namespace palpate {

Action add_keys_command(const Command& program) {
    const Command c = program.subcommand("keys", "show what may stand in a scene, a finger file, a calibration");
    struct Arguments {
        std::string table;
        bool schema = false, markdown = false;
    };
    auto a = std::make_shared<Arguments>();
    c.option("table", a->table,
             "a table by its path, for example solver, finger.device, object; finger-file and calibration are files of "
             "their own (default: the scene's own keys)");
    c.flag("--json-schema", a->schema, "a JSON schema (draft-07) of a scene, or of the file named, for editors");
    c.flag("--markdown", a->markdown, "all keys of all files as Markdown: scenes/KEYS.md");
    return [a] {
        const std::vector<KeyInfo> kinds = file_kinds();
        if (a->markdown) {
            if (a->schema) throw InputError("give --markdown or --json-schema, not both");
            if (!a->table.empty()) throw InputError("--markdown writes all tables: leave '" + a->table + "' out");
            std::printf("%s", key_markdown(kinds).c_str());
        } else if (a->schema) {
            const KeyInfo& table = find_table(kinds, a->table);
            if (std::none_of(kinds.begin(), kinds.end(), [&](const KeyInfo& k) { return &k == &table; }))
                throw InputError("a schema is of a whole file: scene, finger-file or calibration");
            std::printf("%s\n", key_schema(table).dump(2).c_str());
        } else {
            std::printf("%s", key_listing(kinds, a->table).c_str());
        }
        return 0;
    };
}

}  // namespace palpate
