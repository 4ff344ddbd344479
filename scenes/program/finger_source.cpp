#include "scenes/program/finger_source.h"

#include <toml++/toml.h>
#include <algorithm>

#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "scenes/load/section.h"

namespace palpate {

namespace {

/// A scene has fingers; a finger file is one.
bool is_scene(const std::filesystem::path& path) {
    try {
        return toml::parse_file(path.string()).contains("finger");
    } catch (const toml::parse_error&) {
        return false;  // reading it as a finger file says what is wrong
    }
}

FingerModel finger_of_scene(const std::filesystem::path& path, const std::string& name) {
    const Scene scene = load_scene(path);
    std::string all;
    for (const FingerModel& m : scene.finger_models) {
        if (name.empty() || m.spec.name == name) return m;
        all += (all.empty() ? "" : ", ") + m.spec.name;
    }
    throw InputError("--finger-of-scene: expected one of " + all + ", found \"" + name + "\"");
}

}  // namespace

Option add_finger_options(const Command& command, const std::string& option, const std::string& description,
                          FingerSource& source) {
    const Option finger =
        command.option(option, source.name,
                       description +
                           ": a preset (index-median), a finger file or scene (.toml), a surface (.obj, .stl, "
                           ".ply, .off) or a mesh (.msh, .vtu, .ele)");
    command.option("--finger-of-scene", source.finger, "which finger of the scene (default: its first)");
    return finger;
}

FingerModel load_finger(const FingerSource& source) {
    FingerModel m;
    m.mesh.shape = finger_shape("index");
    const std::filesystem::path path = source.name;
    const std::string ending = path.extension();
    const bool scene = ending == ".toml" && is_scene(path);
    Problems problems{path, {}};
    if (ending == ".obj" || ending == ".stl" || ending == ".ply" || ending == ".off") {
        m.mesh.source = FingerMeshRequest::Source::surface;
        m.mesh.file = source.name;
        m.spec.has_limits = true;
    } else if (ending == ".msh" || ending == ".vtu" || ending == ".ele" || ending == ".node") {
        m.mesh.source = FingerMeshRequest::Source::tets;
        m.mesh.file = source.name;
        m.spec.has_limits = true;
    } else if (scene) {
        m = finger_of_scene(path, source.finger);
    } else {
        const auto shapes = finger_shape_names();
        const bool median = std::find(shapes.begin(), shapes.end(), source.name) != shapes.end();
        read_named_finger(source.name + (median ? "-median" : ""), "", m, problems);
    }
    if (!problems.messages.empty()) throw InputError(problems.messages);
    if (!source.finger.empty() && !scene) throw InputError("--finger-of-scene: " + source.name + " is no scene");
    if (source.elements > 0) m.mesh.elements = source.elements;
    return m;
}

}  // namespace palpate
