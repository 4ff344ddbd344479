#include "scenes/load/find_scene.h"

namespace palpate {

std::vector<std::filesystem::path> scene_folders() {
    std::error_code error;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
    const auto folder = program.parent_path();
    return {"", "scenes", folder.parent_path() / "share/palpate/scenes",
            folder.parent_path().parent_path() / "scenes",  // of build/release in a checkout
            PALPATE_SCENES_DIR};
}

std::vector<std::filesystem::path> scene_candidates(const std::filesystem::path& name) {
    std::vector<std::filesystem::path> candidates{name};
    if (name.empty() || name.has_parent_path() || name.has_extension()) return candidates;
    std::filesystem::path file = name;
    file += ".toml";
    for (const auto& folder : scene_folders()) candidates.push_back(folder / file);
    return candidates;
}

std::filesystem::path find_scene(const std::filesystem::path& name) {
    std::error_code error;
    for (const auto& candidate : scene_candidates(name))
        if (std::filesystem::is_regular_file(candidate, error)) return candidate;
    return name;
}

}  // namespace palpate
