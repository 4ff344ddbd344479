#include "scenes/load/result_files.h"

#include <toml++/toml.h>
#include <cstdio>

#include "meshes/input_error.h"

namespace palpate {

namespace result_file {
std::string finger_table(const std::string& finger) { return finger + ".csv"; }
std::string finger_nodes(const std::string& finger) { return finger + "_nodes.csv"; }
std::string finger_mesh(const std::string& finger) { return finger + ".vtu"; }
std::string finger_pad(const std::string& finger, std::size_t number) {
    char text[32];
    std::snprintf(text, sizeof text, "_%04zu.vtu", number);
    return finger + text;
}
std::string finger_pads(const std::string& finger) { return finger + ".pvd"; }
std::string object_table(const std::string& object) { return "object_" + object + ".csv"; }
std::string object_mesh(const std::string& object) { return "object_" + object + ".vtu"; }
}  // namespace result_file

namespace {

/// A file, and whose it is.
struct ResultFile {
    std::string file;
    const char* what;  ///< "table"
    const char* list;  ///< "finger": [[finger]], "object": [[object]]; "": it is there in every run
    std::size_t place = 0;
};

std::vector<ResultFile> result_files(const SceneSpec& spec) {
    using namespace result_file;
    std::vector<ResultFile> files{{steps, "table", ""}};
    for (std::size_t o = 0; o < spec.objects.size(); ++o) {
        const ObjectSpec& object = spec.objects[o];
        if (object.body || object.tissue) files.push_back({object_table(object.name), "table", "object", o});
        if (object.tissue) files.push_back({object_mesh(object.name), "mesh", "object", o});
    }
    for (std::size_t f = 0; f < spec.fingers.size(); ++f) {
        const std::string& name = spec.fingers[f].name;
        files.push_back({finger_table(name), "table", "finger", f});
        files.push_back({finger_nodes(name), "table of nodes", "finger", f});
        files.push_back({finger_mesh(name), "mesh", "finger", f});
    }
    return files;
}

std::string owner_of(const ResultFile& file, const SceneSpec& spec) {
    if (!*file.list) return "steps";
    const bool finger = file.list == std::string("finger");
    const std::string& name = finger ? spec.fingers[file.place].name : spec.objects[file.place].name;
    return std::string(file.list) + " \"" + name + "\"";
}

/// Whether a file is one of a finger's pads over time, however many there are.
bool is_pad(const std::string& file, const std::string& finger) {
    const std::string ending = ".vtu";
    if (!file.starts_with(finger + "_") || !file.ends_with(ending)) return false;
    const std::size_t from = finger.size() + 1;
    if (file.size() < from + ending.size() + 4) return false;
    const std::string digits = file.substr(from, file.size() - from - ending.size());
    return digits.find_first_not_of("0123456789") == std::string::npos;
}

}  // namespace

void check_result_files(const Scene& scene, const toml::table& table, Problems& problems) {
    const std::vector<ResultFile> files = result_files(scene.spec);
    std::string told;  // of each name, one collision is said
    for (std::size_t k = 0; k < files.size(); ++k)
        for (std::size_t before = 0; before < k; ++before) {
            const ResultFile &mine = files[k], &other = files[before];
            if (mine.file != other.file) continue;
            const std::string owner = owner_of(mine, scene.spec);
            if (owner == told) continue;
            told = owner;
            const auto entry = table[mine.list][mine.place];
            const toml::node* name = entry["name"].node();
            problems.add(name ? name : entry.node(), owner + ".name: its " + mine.what + " would be " + mine.file +
                                                         ", which is the " + other.what + " of " +
                                                         owner_of(other, scene.spec) + ": rename it");
        }
}

void refuse_colliding_pads(const Scene& scene) {
    for (const ResultFile& file : result_files(scene.spec))
        for (const FingerSpec& finger : scene.spec.fingers)
            if (is_pad(file.file, finger.name))
                throw InputError(scene.file.string() + ": the " + file.what + " of " + owner_of(file, scene.spec) +
                                 " would be " + file.file + ", which is one of the pads over time of finger \"" +
                                 finger.name + "\": rename one of the two");
}

}  // namespace palpate
