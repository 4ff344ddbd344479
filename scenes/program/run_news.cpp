#include "scenes/program/run_news.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "scenes/load/finger_mesh.h"
#include "scenes/run/hardware.h"
#include "scenes/run/wrapped.h"

namespace palpate {

void tell_of_scene(const RunArguments& a, const Scene& scene) {
    print_warnings(scene);
    if (a.quiet || a.json) return;
    // What is true of several fingers is said once.
    for (std::size_t i = 0; i < scene.mesh_notes.size(); ++i) {
        std::string names;
        for (std::size_t k = 0; k < scene.mesh_notes.size(); ++k)
            if (scene.mesh_notes[k] == scene.mesh_notes[i])
                names += (names.empty() ? "" : ", ") + scene.spec.fingers[k].name;
        const auto first = std::find(scene.mesh_notes.begin(), scene.mesh_notes.end(), scene.mesh_notes[i]);
        if (first == scene.mesh_notes.begin() + std::ptrdiff_t(i))
            std::printf("%s", wrapped(names + ": " + scene.mesh_notes[i]).c_str());
    }
    for (const auto& recording : scene.recordings)
        if (recording && !recording->note.empty()) std::printf("recorded hand: %s\n", recording->note.c_str());
}

void tell_news(DeadMan& dead_man, Progress& progress) {
    const std::string news = take_news(dead_man);
    if (news.empty()) return;
    progress.clear();
    std::fprintf(stderr, "%s\n", news.c_str());
}

void tell_doubts(DoubtTeller& doubts, const Simulation& simulation, Progress& progress) {
    if (!simulation.live) return;
    for (const std::string& text : doubts.news(simulation.live->mailbox)) {
        progress.clear();
        std::fprintf(stderr, "warning: live hand: %s\n", text.c_str());
    }
}

bool tell_of_thimbles(const RunArguments& a, const Simulation& simulation, const DeadMan* dead_man, bool stopped) {
    if (!simulation.hardware) return true;
    if (!a.quiet && !a.json) std::printf("%s", hardware_report(simulation).c_str());
    if (dead_man && dead_man->counts.held == 0)
        std::fprintf(stderr, "%s", hold_report(*dead_man).c_str());  // the run was for nothing: that is always said
    else if (dead_man && !a.quiet && !a.json)
        std::printf("%s", hold_report(*dead_man).c_str());
    bool at_rest = true;
    const std::string rest = rest_report(simulation, at_rest);
    if (!at_rest || stopped || !a.quiet) std::fprintf(stderr, "%s", rest.c_str());
    return at_rest;
}

void tell_results(const RunArguments& a, const Summary& summary, const ResultsFolder& results,
                  const std::filesystem::path& folder, const std::vector<std::string>& replaced) {
    if (a.json) std::printf("%s\n", to_json(summary).dump(2).c_str());
    if (a.json || a.quiet) return;
    std::printf("\n%s\n%s", to_text(summary).c_str(),
                wrapped(std::to_string(results.files()) + " files in " + folder.string() +
                        (a.no_picture ? " (" : " (picture.png, ") +
                        "plots.svg, summary.json, per finger .csv, _nodes.csv and .vtu)")
                    .c_str());
    for (const std::string& sentence : replaced) std::printf("%s: %s\n", folder.string().c_str(), sentence.c_str());
}

}  // namespace palpate
