#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/program/commands.h"
#include "scenes/program/finger_source.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
#include "scenes/recording/svg.h"
#include "scenes/run/series.h"
#include "scenes/run/wrapped.h"
#include "scenes/studies/indentation.h"

namespace palpate {

namespace {

struct IndentArguments {
    FingerSource source;
    std::vector<double> angles_deg{30};
    std::vector<int> elements{0};  // as the finger says
    double roll_deg = 0, depth_mm = 4, force_N = 6, speed_mm_per_s = 0, friction = 0, shear_friction = 0.8;
    int steps = 120;
    std::string out = "results/indent";
    bool json = false;
};

/// Bands of index fingers pressed flat, as remembered from the literature (meshes/README.md).
struct Band {
    const char* what;
    const char* unit;
    double factor, low, high;
    double FingertipFigures::*value;
};
const Band bands[] = {
    {"displacement at 1 N", "mm", 1e3, 1.2, 2.2, &FingertipFigures::displacement_1N},
    {"displacement at 4 N", "mm", 1e3, 1.8, 3.0, &FingertipFigures::displacement_4N},
    {"stiffness at 4 N over 0.5 N", "", 1, 2.5, HUGE_VAL, &FingertipFigures::stiffening},
    {"contact area at 1 N", "mm2", 1e6, 60, 140, &FingertipFigures::area_1N},
    {"contact area at 5 N", "mm2", 1e6, 120, 240, &FingertipFigures::area_5N},
    {"exponent of area over force", "", 1, -HUGE_VAL, 0.6, &FingertipFigures::area_exponent},
    {"surface strain at 5 N, pressed", "%", 100, -HUGE_VAL, HUGE_VAL, &FingertipFigures::strain_5N},
    {"surface strain at 5 N, sheared", "%", 100, 30, 60, &FingertipFigures::sheared_strain_5N},
    {"tangential stiffness at 1 N", "N/mm", 1e-3, 0.5, 2.5, &FingertipFigures::tangential_stiffness_1N},
};

/// One press and what came of it.
struct Press {
    Indentation how;
    double angle_deg = 0;
    IndentationCurve curve;
    FingertipFigures figures;
    std::string label() const {
        char text[80];
        std::snprintf(text, sizeof text, "%g degrees, %zu tetrahedra", angle_deg, how.finger.mesh.tets.size());
        return text;
    }
};

Series series_of(const std::vector<Press>& presses) {
    Series s;
    s.columns = {"elements", "angle_deg",      "displacement_mm", "force_N",          "area_mm2",
                 "hull_mm2", "surface_strain", "touching",        "limited_elements", "converged"};
    for (const Press& press : presses)
        for (const IndentationPoint& p : press.curve.points)
            s.values.insert(s.values.end(),
                            {double(press.how.finger.mesh.tets.size()), press.angle_deg, 1e3 * p.displacement, p.force,
                             1e6 * p.area, 1e6 * p.hull, p.surface_strain, double(p.touching), double(p.limited),
                             double(p.converged)});
    return s;
}

void draw(const std::filesystem::path& path, const std::string& name, const std::vector<Press>& presses,
          double force_limit) {
    Plot force{name, "displacement [mm]", "force [N]", {}, {}};
    Plot area{"Contact area", "force [N]", "area [mm2]", {}, {}};
    for (const Press& press : presses) {
        Curve f{press.label(), {}, {}}, a = f, h = f;
        h.name += ", hull";
        for (const IndentationPoint& p : press.curve.points) {
            if (p.force > 1.2 * force_limit) break;
            f.x.push_back(1e3 * p.displacement), f.y.push_back(p.force);
            a.x.push_back(p.force), a.y.push_back(1e6 * p.area);
            h.x.push_back(p.force), h.y.push_back(1e6 * p.hull);
        }
        force.curves.push_back(f);
        area.curves.push_back(a);
        if (presses.size() == 1) area.curves.push_back(h);
    }
    write_svg(path, {force, area});
}

nlohmann::json json_of(const std::vector<Press>& presses) {
    nlohmann::json all = nlohmann::json::array();
    for (const Press& press : presses) {
        nlohmann::json row{{"angle_deg", press.angle_deg}, {"elements", press.how.finger.mesh.tets.size()}};
        for (const Band& b : bands) {
            const double v = b.factor * (press.figures.*b.value);
            row[std::string(b.what) + (*b.unit ? std::string(" [") + b.unit + "]" : "")] =
                std::isfinite(v) ? nlohmann::json(v) : nlohmann::json();
        }
        all.push_back(row);
    }
    return all;
}

void print(const Band& b, double v) {
    std::printf("  %-32s ", b.what);
    if (!std::isfinite(v)) {
        std::printf("not reached (--depth-mm, --force-N)\n");
        return;
    }
    std::printf("%7.2f %-4s", v, b.unit);
    if (std::isfinite(b.low) && std::isfinite(b.high))
        std::printf("  %g to %g", b.low, b.high);
    else if (std::isfinite(b.low))
        std::printf("  at least %g", b.low);
    else if (std::isfinite(b.high))
        std::printf("  below %g", b.high);
    std::printf("%s\n", v < b.low || v > b.high ? "   OUTSIDE" : "");
}

void print(const std::vector<Press>& presses) {
    for (const Press& press : presses) {
        std::printf("\n%-47s  index fingers\n", press.label().c_str());
        for (const Band& b : bands) print(b, b.factor * (press.figures.*b.value));
        std::size_t failed = 0;
        for (const IndentationPoint& p : press.curve.points) failed += !p.converged;
        if (failed)
            std::printf("  %zu of %zu steps did not converge: see the CSV\n", failed, press.curve.points.size());
    }
}

/// Steps that figures are read from, so that they do not depend on how many rows were asked for: each of these is
/// pressed in so many, at most 1/30 mm long, between whose forces a wall at the strain limits is found.
int finer(const IndentArguments& a) { return std::max(1, int(std::ceil(a.depth_mm / a.steps / (4.0 / 120) - 1e-9))); }

/// The rows that were asked for, and where the press ended.
IndentationCurve every(const IndentationCurve& curve, int step) {
    IndentationCurve rows = curve;
    rows.points.clear();
    for (std::size_t k = 0; k < curve.points.size(); ++k)
        if (k % std::size_t(step) == 0 || k + 1 == curve.points.size()) rows.points.push_back(curve.points[k]);
    return rows;
}

int run_indent(const IndentArguments& a) {
    const EndsAtOnce interruptible;  // nothing is written before all presses are done
    FingerModel model = load_finger(a.source);
    const std::string title = model.title.empty() ? a.source.name : model.title;
    FingerTemplates templates;
    std::string note;
    Threads threads;
    std::vector<Press> presses;
    std::vector<Indentation> all;
    for (const int elements : a.elements) {
        if (elements > 0) model.mesh.elements = elements;
        FingerSpec finger = build_finger(model, templates, note);
        if (const std::string wrong = too_stiff_a_layer(model, finger); !wrong.empty())
            throw InputError(a.source.name + ": layer: " + wrong);
        for (const double angle : a.angles_deg) {
            finger.name = std::to_string(all.size());
            all.push_back({finger, angle * degree, a.roll_deg * degree, 1e-3 * a.depth_mm});
            presses.push_back({all.back(), angle, {}, {}});
        }
    }
    IndentationSettings settings{.steps = finer(a) * a.steps,
                                 .force_limit = a.force_N,
                                 .speed = 1e-3 * a.speed_mm_per_s,
                                 .friction = a.friction};
    Progress progress("indent", a.json);
    settings.progress = [&](double share) { progress.show(0.5 * share); };
    const auto curves = indent(all, settings, threads);
    for (std::size_t i = 0; i < presses.size(); ++i) {
        presses[i].curve = every(curves[i], finer(a));
        progress.show(0.5 + 0.5 * double(i) / double(presses.size()));
        presses[i].figures = fingertip_figures(presses[i].how, curves[i], a.shear_friction, threads);
    }
    progress.clear();
    if (!a.out.empty()) {
        std::filesystem::create_directories(a.out);
        write_csv(std::filesystem::path(a.out) / "indent.csv", series_of(presses));
        draw(std::filesystem::path(a.out) / "indent.svg", title, presses, a.force_N);
    }
    if (a.json) {
        std::printf("%s\n", json_of(presses).dump(2).c_str());
        return 0;
    }
    std::printf("%s%s", wrapped(title).c_str(), wrapped(note).c_str());
    print(presses);
    if (!a.out.empty()) std::printf("\nwritten: %s/indent.csv, indent.svg\n", a.out.c_str());
    return 0;
}

}  // namespace

Action add_indent_command(const Command& program) {
    const Command c = program.subcommand("indent", "press a flat plate on a finger: force, displacement, contact area");
    auto a = std::make_shared<IndentArguments>();
    add_finger_options(c, "finger", "which finger", a->source).required();
    c.option("--elements", a->elements,
             "wanted number of tetrahedra (default: as the finger says); several, separated by commas")
        .comma_separated()
        .range(20, 200000);
    c.option("--angle", a->angles_deg, "between plate and finger axis [degrees]; several, separated by commas")
        .comma_separated()
        .range(-30.0, 90.0);
    c.option("--roll", a->roll_deg, "of the finger about its axis [degrees]").range(-180.0, 180.0);
    c.option("--depth-mm", a->depth_mm, "displacement at the end, from first touch").range(0.01, 20.0);
    c.option("--force-N", a->force_N, "end at this force").range(0.01, 1000.0);
    c.option("--steps", a->steps, "rows up to the depth; figures do not depend on them").range(2, 10000);
    c.option("--speed-mm-per-s", a->speed_mm_per_s,
             "of the plate; 0: quasi-static. Tissue has inertia but no viscosity")
        .range(0.0, 1000.0);
    c.option("--friction", a->friction, "of the plate while it presses").range(0.0, 10.0);
    c.option("--shear-friction", a->shear_friction, "of the plate in the presses that are moved across")
        .range(0.05, 10.0);
    c.option("--out", a->out, "folder of indent.csv and indent.svg; empty: none");
    c.flag("--json", a->json, "print the figures as JSON");
    return [a] { return run_indent(*a); };
}

}  // namespace palpate
