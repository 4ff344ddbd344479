#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/mesh_quality.h"
#include "scenes/load/finger_mesh.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"

namespace palpate {

namespace {

struct MeshArguments {
    std::string source, out, unit, picture, kind = "uniform";
    int elements = 347;
    std::optional<double> length_mm, width_mm, thickness_mm, pad_bulge, nail;
    bool keep_frame = false, json = false;
    std::vector<double> tip, dorsal;  ///< of the file's axes; empty: guessed
};

std::optional<FingerOrientation> orientation_of(const MeshArguments& a) {
    if (a.tip.empty() && a.dorsal.empty()) return {};
    if (a.tip.size() != 3 || a.dorsal.size() != 3)
        throw InputError("--tip and --dorsal: expected both, three numbers each (--tip 0,0,1 --dorsal 0,1,0)");
    return FingerOrientation{{a.tip[0], a.tip[1], a.tip[2]}, {a.dorsal[0], a.dorsal[1], a.dorsal[2]}};
}

/// Options that would do nothing are a misunderstanding.
void check_together(const MeshArguments& a, bool surface) {
    std::vector<std::string> wrong;
    const auto check = [&](bool given, const char* option, const char* why) {
        if (given) wrong.push_back(std::string(option) + ": " + why);
    };
    const char* const of_shapes = "is of the built-in finger; a surface has its own size (--unit)";
    const char* const of_files = "is of surface files; the built-in finger needs none";
    check(surface && a.length_mm, "--length", of_shapes);
    check(surface && a.width_mm, "--width", of_shapes);
    check(surface && a.thickness_mm, "--thickness", of_shapes);
    check(surface && a.pad_bulge, "--pad-bulge", of_shapes);
    check(!surface && !a.unit.empty(), "--unit", of_files);
    check(!surface && !a.tip.empty(), "--tip", of_files);
    check(!surface && !a.dorsal.empty(), "--dorsal", of_files);
    check(a.keep_frame && !(a.tip.empty() && a.dorsal.empty()), "--keep-frame",
          "a surface keeps its own frame or has --tip and --dorsal, not both");
    if (!wrong.empty()) throw InputError(wrong);
}

FingerMeshRequest request_of(const MeshArguments& a, double& surface_volume) {
    FingerMeshRequest r;
    r.elements = a.elements;
    r.keep_frame = a.keep_frame;
    r.orientation = orientation_of(a);
    r.unit = a.unit;
    r.kind = a.kind == "conforming" ? FingerMeshRequest::Kind::conforming : FingerMeshRequest::Kind::uniform;
    if (a.nail) r.regions.nail = *a.nail;
    const bool surface = a.source.find('.') != std::string::npos || std::filesystem::exists(a.source);
    check_together(a, surface);
    if (surface) {
        r.source = FingerMeshRequest::Source::surface;
        r.file = a.source;
        surface_volume = volume(read_surface(a.source, a.unit).surface);
        return r;
    }
    r.shape = finger_shape(a.source);
    if (a.length_mm) r.shape.length = 1e-3 * *a.length_mm;
    if (a.width_mm) r.shape.width = 1e-3 * *a.width_mm;
    if (a.thickness_mm) r.shape.thickness = 1e-3 * *a.thickness_mm;
    if (a.pad_bulge) r.shape.pad_bulge = *a.pad_bulge;
    if (r.kind == FingerMeshRequest::Kind::conforming) r.shape.crease = usual_crease;
    surface_volume = volume(finger_surface(r.shape));
    return r;
}

/// Before anything is refused: it shows why.
void draw_orientation(const MeshArguments& a, const FingerMeshRequest& r) {
    const Surface surface =
        r.source == FingerMeshRequest::Source::surface ? read_surface(r.file, r.unit).surface : finger_surface(r.shape);
    const bool given = r.keep_frame || r.orientation;
    const OrientationGuess guess = guess_orientation(surface);
    const FingerOrientation shown = r.orientation ? *r.orientation : given ? FingerOrientation{} : guess.orientation;
    write_file(a.picture, orientation_picture(surface, shown,
                                              a.source + (given ? ", orientation as given" : ", " + describe(guess))));
    std::printf("picture           %s (red: tip, blue: nail, green: across; orange: pad)\n", a.picture.c_str());
}

int make_mesh(const MeshArguments& a) {
    const EndsAtOnce interruptible;
    double surface_volume = 0;
    const FingerMeshRequest request = request_of(a, surface_volume);
    if (!a.picture.empty()) draw_orientation(a, request);
    FingerTemplates templates;
    std::string note;
    const TetMesh mesh = make_finger_mesh(request, templates, note);
    const MeshQuality q = measure_quality(mesh, false);
    if (!a.out.empty()) {
        std::vector<double> region(mesh.nodes.size(), 0);
        for (int i : mesh.bone_nodes) region[i] = 1;
        for (int i : mesh.pad_nodes) region[i] = 2;
        write_vtu(a.out, mesh, {{"region", 1, region}}, {});
    }
    if (a.json) {
        const nlohmann::json j{{"note", note},
                               {"elements", mesh.tets.size()},
                               {"fixed_elements", q.fixed},
                               {"nodes", mesh.nodes.size()},
                               {"volume_mm3", 1e9 * q.volume},
                               {"surface_volume_mm3", 1e9 * surface_volume},
                               {"worst_dihedral_deg", q.worst_dihedral_deg},
                               {"median_dihedral_deg", q.median_dihedral_deg},
                               {"worst_radius_ratio", q.worst_radius_ratio},
                               {"median_radius_ratio", q.median_radius_ratio},
                               {"pad_nodes", mesh.pad_nodes.size()},
                               {"bone_nodes", mesh.bone_nodes.size()}};
        std::printf("%s\n", j.dump(2).c_str());
        return 0;
    }
    std::printf("%s\n", note.c_str());
    std::printf(
        "elements          %zu (%d wanted), of which %d lie in the bone and do not deform\nnodes             %zu, of "
        "which %zu pad, %zu bone\n",
        mesh.tets.size(), a.elements, q.fixed, mesh.nodes.size(), mesh.pad_nodes.size(), mesh.bone_nodes.size());
    const double change = 100 * (q.volume / surface_volume - 1);
    std::printf(
        "volume            %.2f mm3 (surface %.2f mm3, %+.3f %%%s)\n", 1e9 * q.volume, 1e9 * surface_volume, change,
        request.kind == FingerMeshRequest::Kind::conforming ? ": the phalanx is left out, and what chords cut off"
                                                            : "");
    std::printf(
        "smallest dihedral worst %.1f, median %.1f degrees, of those that deform\n"
        "radius ratio      worst %.2f, median %.2f (1 = regular)\n",
        q.worst_dihedral_deg, q.median_dihedral_deg, q.worst_radius_ratio, q.median_radius_ratio);
    if (!a.out.empty()) std::printf("written           %s (field region: 0 inside, 1 bone, 2 pad)\n", a.out.c_str());
    return 0;
}

}  // namespace

Action add_mesh_command(const Command& program) {
    const Command c = program.subcommand("mesh", "turn a closed surface, or the built-in finger, into tetrahedra");
    auto a = std::make_shared<MeshArguments>();
    const auto low = [](const shape_bounds::Bounds& b) { return std::round(1e3 * b.low); };
    const auto high = [](const shape_bounds::Bounds& b) { return std::round(1e3 * b.high); };
    c.option("surface", a->source, "OBJ, STL, PLY or OFF file; or thumb, index, middle, ring, little").required();
    c.option("--elements", a->elements, "wanted number of tetrahedra").range(20, 200000);
    c.option("--kind", a->kind,
             "uniform, or conforming: fine on the pad, between skin and a phalanx that is left empty")
        .among({"uniform", "conforming"});
    c.option("--out", a->out, "write the mesh as .vtu");
    c.option("--unit", a->unit, "unit of the file: m, cm or mm (default: guessed from its size)");
    c.option("--length", a->length_mm, "built-in finger: length [mm]")
        .range(low(shape_bounds::length), high(shape_bounds::length));
    c.option("--width", a->width_mm, "built-in finger: width [mm]")
        .range(low(shape_bounds::width), high(shape_bounds::width));
    c.option("--thickness", a->thickness_mm, "built-in finger: thickness [mm]")
        .range(low(shape_bounds::thickness), high(shape_bounds::thickness));
    c.option("--pad-bulge", a->pad_bulge, "built-in finger: swelling of the pad, 0 to 0.5")
        .range(shape_bounds::pad_bulge.low, shape_bounds::pad_bulge.high);
    c.option("--nail", a->nail, "share of the thickness above which nodes belong to nail and back, 0 to 1")
        .range(0.0, 1.0);
    c.flag("--keep-frame", a->keep_frame, "the file's axes are the finger frame (x distal, z to the nail) already");
    c.option("--tip", a->tip, "where the tip points, in the file's axes (x,y,z); with --dorsal").comma_separated();
    c.option("--dorsal", a->dorsal, "where the nail faces, in the file's axes (x,y,z)").comma_separated();
    c.option("--picture", a->picture, "draw the surface with the axes that were guessed or given (.svg)");
    c.flag("--json", a->json, "print the report as JSON");
    return [a] { return make_mesh(*a); };
}

}  // namespace palpate
