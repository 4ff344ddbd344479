#include "scenes/load/find_scene.h"

#include <dlfcn.h>

#include <algorithm>

namespace palpate {

std::vector<std::filesystem::path> scene_folders() {
    std::error_code error;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
    const auto folder = program.parent_path();
    // In libpalpate.so the program is somebody else's: DIR/lib/libpalpate.so, or
    // DIR/lib/x86_64-linux-gnu/libpalpate.so.
    Dl_info info;
    const bool known = dladdr(reinterpret_cast<const void*>(&scene_folders), &info) && info.dli_fname;
    const auto own = known ? std::filesystem::weakly_canonical(info.dli_fname, error).parent_path() : folder;
    return {"",
            "scenes",
            folder.parent_path() / "share/palpate/scenes",
            folder.parent_path().parent_path() / "scenes",  // of build/release in a checkout
            own.parent_path() / "share/palpate/scenes",
            own.parent_path().parent_path() / "share/palpate/scenes",
            own.parent_path().parent_path() / "scenes",
            PALPATE_SCENES_DIR};
}

std::vector<std::filesystem::path> scene_candidates(const std::filesystem::path& name) {
    std::vector<std::filesystem::path> candidates{name};
    if (name.empty() || name.has_parent_path() || name.has_extension()) return candidates;
    std::filesystem::path file = name;
    file += ".toml";
    for (const auto& folder : scene_folders())
        if (std::find(candidates.begin(), candidates.end(), folder / file) == candidates.end())
            candidates.push_back(folder / file);
    return candidates;
}

std::filesystem::path find_scene(const std::filesystem::path& name) {
    std::error_code error;
    for (const auto& candidate : scene_candidates(name))
        if (std::filesystem::is_regular_file(candidate, error)) return candidate;
    return name;
}

}  // namespace palpate
