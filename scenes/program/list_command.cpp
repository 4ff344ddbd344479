// What there is: scenes, presets, kinds of device, drivers, sources of hands.

#include <toml++/toml.h>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "meshes/input_error.h"
#include "scenes/load/find_scene.h"
#include "scenes/load/finger_model.h"
#include "scenes/load/key.h"
#include "scenes/load/load_devices.h"
#include "scenes/load/presets.h"
#include "scenes/program/commands.h"
#include "scenes/program/scene_templates.h"
#include "scenes/trackers/hand_source.h"

namespace palpate {

namespace {

namespace fs = std::filesystem;

/// Where the scenes lie that come with the program, of all folders that are searched. Empty: nowhere.
fs::path scene_folder() {
    std::error_code ignored;
    for (const fs::path& folder : scene_folders())
        if (!folder.empty() && fs::is_regular_file(folder / "hand.toml", ignored)) return folder;
    return {};
}

void print_row(const std::string& name, const std::string& about) {
    std::printf("  %-20s %s\n", name.c_str(), about.c_str());
}

void list_scenes() {
    const fs::path folder = scene_folder();
    if (folder.empty()) {
        std::printf("scenes: none beside this program\n");
    } else {
        std::printf("scenes, in %s (run by name: palpate run hand):\n", folder.c_str());
        std::vector<fs::path> files;
        for (const auto& entry : fs::directory_iterator(folder))
            if (entry.path().extension() == ".toml") files.push_back(entry.path());
        std::sort(files.begin(), files.end());
        for (const fs::path& file : files) {
            try {
                print_row(file.stem(), toml::parse_file(file.string())["title"].value_or(std::string()));
            } catch (const toml::parse_error& error) {
                print_row(file.stem(), "cannot be read: " + std::string(error.description()));
            }
        }
    }
    std::printf("templates, for palpate new --from:\n");
    for (const SceneTemplate& t : scene_templates())
        print_row(std::string(t.name), toml::parse(t.text)["title"].value_or(std::string()));
}

void list_presets() {
    std::printf("presets of a finger (finger = \"NAME\" in [[finger]]):\n");
    for (const std::string& name : finger_preset_names()) {
        FingerModel m;
        Problems problems{name, {}};
        read_named_finger(name, "", m, problems);
        print_row(name, m.title);
    }
    std::printf("presets of the solver (preset = \"NAME\" in [solver]), from fast to accurate:\n");
    for (int preset = 0; preset < int(preset_names().size()); ++preset) {
        SolverSettings settings;
        apply_preset(preset, settings);
        print_row(preset_names()[std::size_t(preset)],
                  "at most " + std::to_string(settings.newton_iterations) +
                      (settings.newton_iterations == 1 ? " Newton iteration a step" : " Newton iterations a step"));
    }
}

void list_kinds() {
    std::printf("kinds of device (kind = \"NAME\" in a finger's device):\n");
    for (const std::string& name : kind_names()) {
        const DeviceKind& kind = *find_kind(name);
        const DeviceModel model = kind.defaults();
        std::string about = joined(kind.configuration_names) + "; " + std::to_string(kind.joint_count) + " joints";
        for (std::size_t i = 0; i < kind.geometry_names.size(); ++i) {
            char length[80];
            std::snprintf(length, sizeof length, "%s%s = %g",
                          i ? ", " : "; geometry_mm: ", kind.geometry_names[i].c_str(), 1e3 * model.geometry[i]);
            about += length;
        }
        print_row(name, about);
    }
    print_row("chain", "joints in the scene file");
}

void list_drivers() {
    std::printf("drivers (driver = \"NAME\" in a finger's device):\n");
    for (const NamedDriver& d : drivers()) print_row(d.name, d.about);
}

void list_sources() {
    std::printf("sources of live hands (source = \"NAME\" in [tracker], or --tracker NAME):\n");
    for (const TrackerSource& s : tracker_sources()) print_row(s.form, s.about);
}

struct Listing {
    const char* name;
    void (*print)();
};
constexpr Listing listings[] = {{"scenes", list_scenes},
                                {"presets", list_presets},
                                {"kinds", list_kinds},
                                {"drivers", list_drivers},
                                {"sources", list_sources}};

}  // namespace

Action add_list_command(const Command& program) {
    const Command c = program.subcommand("list", "show what there is: scenes, presets, kinds, drivers, sources");
    auto what = std::make_shared<std::string>();
    std::vector<std::string> names;
    for (const Listing& l : listings) names.emplace_back(l.name);
    c.option("what", *what, "only these (default: all)").among(names);
    return [what] {
        for (const Listing& l : listings)
            if (what->empty() || *what == l.name) l.print();
        return 0;
    };
}

}  // namespace palpate
