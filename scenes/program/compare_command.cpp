// `palpate compare`: what methods and kinds of device render of a scene, in forces.

#include <cmath>
#include <cstdio>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/compare_output.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"

namespace palpate {

namespace {

struct CompareArguments {
    std::string scene, out;
    std::vector<std::string> overrides, kinds, methods;
    int threads = 0;
    bool quiet = false, json = false, through_servo = false;
};

Comparison compare_kind(const CompareArguments& a, const std::string& kind, const std::atomic<bool>& stop) {
    Comparison c;
    c.kind = kind;
    CompareOptions options;
    options.through_servo = a.through_servo;
    if (!a.methods.empty()) options.methods.clear();
    for (const std::string& name : a.methods) parse_method(name, options.methods.emplace_back());
    c.methods = options.methods;
    std::vector<std::string> overrides = a.overrides;
    std::optional<EndsAtOnce> loading(std::in_place);
    Scene scene = load_scene(a.scene, overrides);
    if (scene.spec.thimbles.empty() || scene.spec.objects.empty())
        throw InputError(a.scene +
                         ": no finger has a device and something to touch; compare needs both (device = { kind = "
                         "\"chinello-3rrs\" })");
    if (!kind.empty()) {
        for (const ThimbleSpec& t : scene.spec.thimbles)
            overrides.push_back("finger." + scene.spec.fingers[std::size_t(t.finger)].name + ".device.kind=" + kind);
        scene = load_scene(a.scene, overrides);
    }
    for (const ThimbleSpec& t : scene.spec.thimbles)
        c.fingers.push_back(scene.spec.fingers[std::size_t(t.finger)].name);
    Simulation simulation = make_simulation(std::move(scene), a.threads);
    loading.reset();
    Progress progress("compare", a.quiet);
    c.steps = compare(simulation, options, stop, [&](double share) { progress.show(share); });
    progress.clear();
    c.interrupted = stop;
    return c;
}

int compare_scene(const CompareArguments& a, const std::atomic<bool>& stop) {
    const std::filesystem::path folder =
        a.out.empty() ? std::filesystem::path("results") / (std::filesystem::path(a.scene).stem().string() + "-compare")
                      : std::filesystem::path(a.out);
    std::vector<Comparison> comparisons;
    for (const std::string& kind : a.kinds.empty() ? std::vector<std::string>{""} : a.kinds)
        if (!stop) comparisons.push_back(compare_kind(a, kind, stop));
    if (comparisons.empty()) return 130;
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throw InputError(folder.string() + ": cannot be created: " + error.message());
    std::vector<Plot> plots;
    for (std::size_t f = 0; f < comparisons[0].fingers.size(); ++f) {
        const std::string& finger = comparisons[0].fingers[f];
        for (const Comparison& c : comparisons) {
            write_csv(folder / (finger + (c.kind.empty() ? "" : "-" + c.kind) + "-errors.csv"), to_series(c, f));
            if (a.json) continue;
            if (c.steps[f].empty())
                std::printf("%s: never in contact\n", finger.c_str());
            else if (!a.quiet)
                print_table(c, f);
        }
        if (!comparisons[0].steps[f].empty())
            for (Plot& plot : error_plots(comparisons, f)) plots.push_back(std::move(plot));
    }
    write_svg(folder / "errors.svg", plots);
    if (a.json)
        std::printf("%s\n", json_text(comparisons).c_str());
    else if (!a.quiet)
        std::printf("written to %s (errors.svg, one -errors.csv per finger)\n", folder.string().c_str());
    if (!stop) return 0;
    const bool lacks_kinds = comparisons.size() < a.kinds.size();
    std::fprintf(stderr, "interrupted: what was compared ends there%s\n",
                 lacks_kinds ? ", and kinds of devices are missing" : "");
    return 130;
}

}  // namespace

Action add_compare_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c =
        program.subcommand("compare", "error analysis of rendering methods and devices (Perez et al. 2017, Fig. 7)");
    auto a = std::make_shared<CompareArguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--out", a->out, "folder for results (default: results/SCENE-compare)");
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.option("--methods", a->methods, "constrained, unconstrained, plane, force (default: all)")
        .comma_separated()
        .among(method_names);
    c.option("--kinds", a->kinds, "device kinds to compare (default: the scene's)")
        .comma_separated()
        .among(kind_names());
    c.flag("--servo", a->through_servo, "through the simulated servo: quantised and delayed");
    c.option("--threads", a->threads, "threads (default: all cores)").range(1, 1024);
    c.flag("--quiet", a->quiet, "print nothing but errors");
    c.flag("--json", a->json, "print the figures as JSON");
    return [a, &stop] { return compare_scene(*a, stop); };
}

}  // namespace palpate
