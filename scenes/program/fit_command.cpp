#include <unistd.h>

#include <cstdio>
#include <optional>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/finger_source.h"
#include "scenes/program/fit_output.h"
#include "scenes/program/interruption.h"

namespace palpate {

namespace {

struct CalibrateArguments {
    std::string data, out = "finger.toml", plot;
    FingerSource source;
    CalibrationSettings settings;
    int threads = 0;
    bool json = false, quiet = false;
};

int run_calibrate(const CalibrateArguments& a, const std::atomic<bool>& stop) {
    const auto data = read_measured_curves(a.data);
    std::optional<EndsAtOnce> loading(std::in_place);
    const FingerModel start = load_finger(a.source);
    loading.reset();
    Threads threads(a.threads);
    std::function<void(const std::string&)> progress;
    const bool shown = !a.quiet && isatty(STDERR_FILENO) != 0;
    if (shown) progress = [](const std::string& line) { std::fprintf(stderr, "\r%-78s", line.c_str()); };
    const Calibration c = calibrate(start, data, a.settings, threads, stop, progress);
    if (shown) std::fprintf(stderr, "\r%-78s\r", "");
    const bool interrupted = stop;
    auto lines = fit_report(c);
    if (interrupted) lines.insert(lines.begin(), "INTERRUPTED: the best of what had been tried, and no finished fit");
    FingerModel model = c.model;
    model.title =
        (start.title.empty() ? a.source.name : start.title) + (interrupted ? ", fit interrupted" : ", fitted");
    model.source = "palpate fit " + a.data;
    write_finger_file(a.out, model, lines);
    const std::string plot = a.plot.empty() ? std::filesystem::path(a.out).replace_extension(".svg").string() : a.plot;
    draw_fit(plot, c, data);
    if (a.json) {
        std::printf("%s\n", json_text(c, interrupted).c_str());
    } else {
        for (const std::string& line : lines) std::printf("%s\n", line.c_str());
        std::printf("written: %s (in a scene: finger = \"%s\"), %s\n", a.out.c_str(), a.out.c_str(), plot.c_str());
    }
    return interrupted ? 130 : 0;
}

}  // namespace

Action add_fit_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("fit", "fit a finger to measured force, displacement and contact area")
                          .formerly("calibrate");
    auto a = std::make_shared<CalibrateArguments>();
    c.option("data", a->data,
             "CSV: force_N, displacement_mm and/or area_mm2, angle_deg (other units: scenes/README.md)")
        .required();
    a->source.name = "index-median";
    add_finger_options(c, "--finger", "what to start from (default: index-median)", a->source);
    c.option("--elements", a->source.elements, "wanted number of tetrahedra (default: as the finger says)")
        .range(20, 200000);
    c.option("--fit", a->settings.parameters,
             "what to fit, separated by commas: young_kPa, poisson, low, high, length_mm, width_mm, thickness_mm, "
             "pad_bulge, layer_1_young_kPa, ... (default young_kPa,low,width_mm)")
        .comma_separated();
    c.option("--starts", a->settings.starts, "local fits from different places").range(1, 100);
    c.option("--iterations", a->settings.iterations, "most of a local fit").range(1, 1000);
    c.option("--steps", a->settings.steps,
             "displacements simulated per press while searching, where more than twice as many were measured")
        .range(4, 1000);
    c.option("--noise", a->settings.noise, "assumed relative error of forces and areas").range(1e-4, 1.0);
    c.option("--friction", a->settings.friction, "of the plate").range(0.0, 10.0);
    c.option("--threads", a->threads, "0: as many as the machine has").range(0, 256);
    c.option("--out", a->out, "finger file to write");
    c.option("--plot", a->plot, "SVG of fit and data (default: beside the finger file)");
    c.flag("--json", a->json, "print the result as JSON");
    c.flag("--quiet", a->quiet, "no progress");
    return [a, &stop] { return run_calibrate(*a, stop); };
}

}  // namespace palpate
