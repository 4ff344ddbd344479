// Writes a scene to begin with.

#include <cstdio>
#include <filesystem>
#include <memory>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/program/commands.h"
#include "scenes/program/scene_templates.h"

namespace palpate {

namespace {

struct NewArguments {
    std::string file, from = "press";
    bool force = false;
};

/// A template whose comments name this file, as one types it, instead of its own.
std::string named(const SceneTemplate& scene, const std::string& file) {
    std::string text(scene.text);
    const std::string own = std::string(scene.name) + ".toml";
    for (auto at = text.find(" " + own); at != std::string::npos; at = text.find(" " + own, at + 1 + file.size()))
        text.replace(at + 1, own.size(), file);
    return text;
}

int write_scene(const NewArguments& a) {
    const std::filesystem::path path = a.file;
    if (path.extension() != ".toml" || a.file.find_first_of("\n\r") != std::string::npos)
        throw InputError("expected the name of a scene file, for example mine.toml, found \"" + a.file + "\"");
    if (std::filesystem::is_directory(path)) throw InputError(a.file + ": is a folder");
    if (!a.force && std::filesystem::exists(std::filesystem::symlink_status(path)))
        throw InputError(a.file + ": exists already; --force overwrites it");
    for (const SceneTemplate& scene : scene_templates())
        if (scene.name == a.from) write_file(path, named(scene, a.file));
    std::printf("written: %s\npalpate run %s simulates it, palpate view %s shows it in a browser\n", a.file.c_str(),
                a.file.c_str(), a.file.c_str());
    return 0;
}

}  // namespace

Action add_new_command(const Command& program) {
    const Command c = program.subcommand("new", "write a commented scene that runs, to begin with");
    auto a = std::make_shared<NewArguments>();
    std::vector<std::string> names;
    for (const SceneTemplate& scene : scene_templates()) names.emplace_back(scene.name);
    c.option("file", a->file, "scene file to write (.toml)").required();
    c.option("--from", a->from, "what it is about (default: press)").among(names);
    c.flag("--force", a->force, "overwrite a file that exists");
    return [a] { return write_scene(*a); };
}

}  // namespace palpate
