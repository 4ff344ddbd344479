#pragma once
// What the files of results are called: one place for whoever writes them, and for the refusal of names with which one
// file would be written over another.

#include <string>
#include <vector>

#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

namespace result_file {
inline constexpr const char* steps = "steps.csv";
std::string finger_table(const std::string& finger);
std::string finger_nodes(const std::string& finger);
std::string finger_mesh(const std::string& finger);
/// One of its pads over time, and the file that lists them all.
std::string finger_pad(const std::string& finger, std::size_t number);
std::string finger_pads(const std::string& finger);
std::string object_table(const std::string& object);
std::string object_mesh(const std::string& object);
}  // namespace result_file

/// Refuses names with which one file of a run's results would be written over another. `table`: the scene's own, for
/// the places of names.
void check_result_files(const Scene& scene, const toml::table& table, Problems& problems);

/// The same of pads over time, which few runs write: asked for where they are. Throws InputError.
void refuse_colliding_pads(const Scene& scene);

}  // namespace palpate
