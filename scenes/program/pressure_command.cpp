#include <algorithm>
#include <cmath>
#include <cstdio>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/program/commands.h"
#include "scenes/program/finger_source.h"
#include "scenes/program/interruption.h"
#include "scenes/program/pressure_output.h"
#include "scenes/run/series.h"
#include "scenes/run/wrapped.h"

namespace palpate {

namespace {

struct PressureArguments {
    std::vector<std::string> files;
    FingerSource source{"index-median", "", 0};
    std::vector<double> angles_deg{0, 10, 20, 30};
    int elements = 0;
    std::vector<int> first_cell{1, 1};
    double cell_mm = 3.75, kPa_per_count = 0.32446, clipped = 255;
    int cells = 4;
    std::string out = "results/pressure";
    bool json = false;
};

/// A share, or a dash where there is none.
std::string share_text(double share) {
    char text[24];
    std::snprintf(text, sizeof text, "%.2f", share);
    return std::isfinite(share) ? text : "-";
}

int run_pressure(const PressureArguments& a) {
    SensorMat mat;
    mat.first_row = a.first_cell[0], mat.first_column = a.first_cell[1];
    mat.rows = mat.columns = a.cells;
    mat.cell = 1e-3 * a.cell_mm, mat.per_count = 1e3 * a.kPa_per_count, mat.clipped = a.clipped;
    std::vector<PressureMap> maps;
    std::vector<std::string> problems;
    for (const std::string& file : a.files) {
        try {
            maps.push_back(read_pressure_map(file, mat));
        } catch (const InputError& error) {
            problems.insert(problems.end(), error.messages.begin(), error.messages.end());
        }
    }
    if (!problems.empty()) throw InputError(problems);
    double most = 0;
    for (const PressureMap& m : maps) most = std::max(most, m.clipped ? 0 : m.force);
    if (!(most > 0)) throw InputError("no map presses on anything without being clipped: nothing can be compared");
    const EndsAtOnce interruptible;
    FingerModel model = load_finger(a.source);
    if (a.elements > 0) model.mesh.elements = a.elements;
    FingerTemplates templates;
    std::string note;
    const FingerSpec finger = build_finger(model, templates, note);
    Threads threads;
    MapFit best;
    double angle_deg = 0;
    for (const double angle : a.angles_deg) {
        const PressedMaps pressed = press_for_maps({finger, angle * degree, 0, 5e-3}, 3 * most, 150, threads);
        const MapFit fit = fit_maps(pressed, maps, mat);
        if (!best.maps.empty() && fit.pose.misfit >= best.pose.misfit) continue;
        best = fit, angle_deg = angle;
    }
    const MapErrors errors = errors_of(best);
    if (!a.out.empty()) {
        std::filesystem::create_directories(a.out);
        write_file(std::filesystem::path(a.out) / "pressure.svg", map_picture(best, mat));
    }
    if (a.json) {
        std::printf("%s\n", json_text(best, angle_deg, errors).c_str());
        return 0;
    }
    std::printf("%s", wrapped(note).c_str());
    std::printf(
        "\nfitted: %g degrees, the mat's middle %.2f mm distal and %.2f mm radial of the bone's origin, its %s row\n"
        "towards the tip, forces %.2f times the mat's\n\n",
        angle_deg, 1e3 * best.pose.along, 1e3 * best.pose.across, best.pose.tip_first ? "first" : "last",
        best.pose.force_scale);
    std::printf(
        "%-24s %8s %8s   middle cells' share      peak over mean\n%-24s %8s %8s   measured simulated   measured "
        "simulated\n",
        "map", "mat", "finger", "", "[N]", "[N]");
    for (const MapComparison& m : best.maps)
        std::printf("%-24s %8.2f %8.2f   %7s  %8s    %8.2f  %8.2f\n", m.name.c_str(), m.nominal, m.force,
                    share_text(m.of_measured.middle).c_str(), share_text(m.of_simulated.middle).c_str(),
                    m.of_measured.peak, m.of_simulated.peak);
    std::printf("\n%s", text_of(errors).c_str());
    if (!a.out.empty()) std::printf("written: %s/pressure.svg\n", a.out.c_str());
    return 0;
}

}  // namespace

Action add_pressure_command(const Command& program) {
    const Command c =
        program.subcommand("pressure", "compare a finger with maps of pressure that a sensor mat measured");
    auto a = std::make_shared<PressureArguments>();
    c.option("maps", a->files,
             "frames of the mat, one finger pressed to rising forces (CSV, as Tekscan's programs write)")
        .required();
    add_finger_options(c, "--finger", "which finger (default: index-median)", a->source);
    c.option("--first-cell", a->first_cell, "row,column of the first cell under the finger, counted from 1")
        .comma_separated();
    c.option("--cells", a->cells, "rows, and columns, under the finger").range(2, 100);
    c.option("--cell-mm", a->cell_mm, "from cell to cell").range(0.1, 50.0);
    c.option("--kPa-per-count", a->kPa_per_count, "of the frames' numbers").range(1e-6, 1e6);
    c.option("--clipped", a->clipped, "frames with counts of this or more are not fitted").range(1.0, 1e9);
    c.option("--angle", a->angles_deg, "between mat and finger axis [degrees]; of several the one that fits best")
        .comma_separated()
        .range(-30.0, 90.0);
    c.option("--elements", a->elements, "wanted number of tetrahedra (default: as the finger says)").range(20, 200000);
    c.option("--out", a->out, "folder of pressure.svg, measured and simulated side by side; empty: none");
    c.flag("--json", a->json, "print the result as JSON");
    return [a] { return run_pressure(*a); };
}

}  // namespace palpate
