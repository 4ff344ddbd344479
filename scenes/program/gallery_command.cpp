// A still of every scene, as scenes/README.md shows them.

#include <algorithm>
#include <cstdio>

#include "meshes/input_error.h"
#include "scenes/load/find_scene.h"
#include "scenes/picture/still.h"
#include "scenes/program/commands.h"
#include "scenes/program/paper_figures.h"
#include "scenes/program/progress.h"
#include "scenes/run/simulation.h"

namespace palpate {

namespace {

namespace fs = std::filesystem;

struct GalleryArguments {
    std::vector<std::string> scenes;
    std::string out = "results/gallery";
    int threads = 0, width = 0, height = 380;
    bool no_hand = false, dark = false, paper = false;
};

std::vector<std::string> shipped_scenes() {
    std::vector<std::string> out;
    std::error_code ignored;
    for (const fs::path& folder : scene_folders()) {
        if (folder.empty() || !fs::is_regular_file(folder / "hand.toml", ignored)) continue;
        for (const auto& entry : fs::directory_iterator(folder))
            if (entry.path().extension() == ".toml") out.push_back(entry.path().string());
        break;
    }
    std::sort(out.begin(), out.end());
    if (out.empty()) throw InputError("no scenes beside this program; expected names: palpate gallery mine.toml");
    return out;
}

/// The last of twelve moments in which the most fingers touch.
bool paint_best(Simulation& s, const PictureSettings& settings, const fs::path& file, const std::atomic<bool>& stop,
                const std::function<void(double)>& show) {
    Painter painter(s, settings);
    int most = -1, moment = 1;
    constexpr int moments = 12;
    run(s, stop, [&](const StepInputs&, double share) {
        show(share);
        if (share * moments + 1e-9 < moment) return;
        ++moment;
        int touching = 0;
        for (const ContactSurface& c : s.world.contact_surfaces) touching += c.normal_force > 0.01;
        if (touching < most) return;
        most = touching;
        write_png(file, fewer_colours(painter.paint(s)));
    });
    return !stop;
}

int make_paper_figures(const GalleryArguments& a, const std::atomic<bool>& stop) {
    if (!a.scenes.empty()) throw InputError("--paper: its figures are of scenes that come with it; expected no names");
    fs::create_directories(a.out);
    Progress progress("gallery");
    const auto files = paint_paper_figures(a.out, a.threads, stop, [&](double share) { progress.show(share, 0, 0); });
    progress.clear();
    for (const fs::path& file : files) std::printf("%s\n", file.c_str());
    return stop ? 130 : 0;
}

int make_gallery(const GalleryArguments& a, const std::atomic<bool>& stop) {
    if (a.paper) return make_paper_figures(a, stop);
    const std::vector<std::string> scenes = a.scenes.empty() ? shipped_scenes() : a.scenes;
    fs::create_directories(a.out);
    PictureSettings settings;
    settings.height = a.height, settings.hand = !a.no_hand, settings.dark = a.dark;
    Progress progress("gallery");
    for (std::size_t k = 0; k < scenes.size() && !stop; ++k) {
        const fs::path scene = find_scene(scenes[k]), file = fs::path(a.out) / (scene.stem().string() + ".png");
        Simulation s = make_simulation(load_scene(scene), a.threads, false);
        settings.width = a.width > 0            ? a.width
                         : s.fingers.size() > 6 ? 720
                                                : 460;  // pads with their names beside each other
        if (!paint_best(s, settings, file, stop, [&](double share) {
                progress.show((double(k) + share) / double(scenes.size()), s.world.step, s.world.time);
            }))
            return 130;
        progress.clear();
        std::printf("%s: %s\n", file.c_str(), s.scene.title.c_str());
        std::fflush(stdout);
    }
    return stop ? 130 : 0;
}

}  // namespace

Action add_gallery_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("gallery", "a picture of every scene that comes with it, or of these");
    auto a = std::make_shared<GalleryArguments>();
    c.option("scenes", a->scenes, "scene files or names (default: all that come with it)");
    c.option("--out", a->out, "folder for pictures (default: results/gallery)");
    c.option("--width", a->width, "of a picture, pixels (default: 460, of more than six fingers 720)").range(200, 4000);
    c.option("--height", a->height, "of a picture, pixels (default: 380)").range(200, 4000);
    c.flag("--no-hand", a->no_hand, "without the hand around the fingertips");
    c.flag("--dark", a->dark, "on a dark ground");
    c.flag("--paper", a->paper, "instead, Figs. 1, 5 and 6 of Perez et al. 2017: what is touched, and what is felt");
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    return [a, &stop] { return make_gallery(*a, stop); };
}

}  // namespace palpate
