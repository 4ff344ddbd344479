#pragma once
// The keys of all files as people and editors read them, made from what the readers declare.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "scenes/load/key.h"

namespace palpate {

/// The kinds of files: "scene", "finger-file", "calibration"; each with its keys.
std::vector<KeyInfo> file_kinds();

/// A table by its path ("finger.device"), of a scene; of another kind of file its name comes first
/// ("calibration.servo"). "scene" or nothing is the scene as a whole. Throws InputError with the names that are there.
const KeyInfo& find_table(const std::vector<KeyInfo>& kinds, const std::string& path);

/// A table's keys for a terminal, and the names of the tables in it. Throws InputError as find_table.
std::string key_listing(const std::vector<KeyInfo>& kinds, const std::string& path);
/// All keys of all kinds of files, as Markdown.
std::string key_markdown(const std::vector<KeyInfo>& kinds);
/// JSON schema (draft-07) of one kind of file.
nlohmann::ordered_json key_schema(const KeyInfo& kind);

}  // namespace palpate
