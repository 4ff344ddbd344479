// Runs a scene for a tenth of a second, with a second finger made from a preset.
#include <palpate/meshes/input_error.h>
#include <palpate/scenes/load/find_scene.h>
#include <palpate/scenes/load/finger_model.h>
#include <palpate/scenes/load/section.h>
#include <palpate/scenes/run/simulation.h>
#include <palpate/scenes/run/summary.h>
#include <cstdio>

namespace {

palpate::FingerSpec finger_from_preset(const char* name) {
    palpate::FingerModel model;
    palpate::Problems problems;
    palpate::read_named_finger(name, "", model, problems);
    if (!problems.messages.empty()) throw palpate::InputError(problems.messages);
    palpate::FingerTemplates templates;
    std::string note;
    palpate::FingerSpec finger = palpate::build_finger(model, templates, note);
    std::printf("%s: %s\n", name, note.c_str());
    return finger;
}

}  // namespace

int main(int argc, char** argv) try {
    palpate::Scene scene = palpate::load_scene(palpate::find_scene(argc > 1 ? argv[1] : "press"));
    scene.duration = 0.1;
    const palpate::FingerSpec preset = finger_from_preset("index-median");
    palpate::Simulation simulation = palpate::make_simulation(std::move(scene), 1);
    palpate::run(simulation, false, {});
    const palpate::Summary summary = palpate::summarise(simulation);
    std::printf("%s", palpate::to_text(summary).c_str());
    return summary.steps > 0 && !preset.mesh.tets.empty() ? 0 : 1;
} catch (const palpate::InputError& error) {
    for (const auto& message : error.messages) std::fprintf(stderr, "%s\n", message.c_str());
    return 2;
}
