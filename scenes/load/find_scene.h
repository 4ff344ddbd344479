#pragma once
// Where a scene lies that is named on a command line.

#include <filesystem>
#include <vector>

namespace palpate {

/// Folders of scenes, in the order in which they are searched: here, `scenes` here, the one installed beside the
/// program, that of the checkout in which it was built, the one installed by default. They need not exist.
std::vector<std::filesystem::path> scene_folders();

/// Files that a name may stand for, in the order in which they are tried: the name itself; for a bare one ("hand")
/// hand.toml in each of the folders.
std::vector<std::filesystem::path> scene_candidates(const std::filesystem::path& name);

/// The first of them that is a file; the name itself where none is.
std::filesystem::path find_scene(const std::filesystem::path& name);

}  // namespace palpate
