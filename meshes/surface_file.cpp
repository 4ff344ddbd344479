// Surface files through OpenMesh, which gets to see sound ones alone (surface_scan.h).

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/Utils/GenProg.hh>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <locale>
#include <map>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "meshes/surface.h"
#include "meshes/surface_scan.h"
#include "meshes/text_surfaces.h"

namespace palpate {

namespace {

struct DoubleTraits : OpenMesh::DefaultTraits {
    typedef OpenMesh::Vec3d Point;
    typedef OpenMesh::Vec3d Normal;
};
using FileMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

/// Plain triangles, coincident vertices merged (STL has no connectivity; OpenMesh splits non-manifold
/// vertices), vertices of no triangle left out.
Surface to_surface(const FileMesh& mesh) {
    Surface s;
    std::map<Point, int> index;
    for (auto f : mesh.faces()) {
        std::array<int, 3> t{};
        int k = 0;
        for (auto v : mesh.fv_range(f)) {
            const auto& p = mesh.point(v);
            const auto [it, is_new] = index.try_emplace({p[0], p[1], p[2]}, int(s.vertices.size()));
            if (is_new) s.vertices.push_back(it->first);
            t[k++] = it->second;
        }
        s.triangles.push_back(t);
    }
    return s;
}

/// Unit of a fingertip from the diagonal of its bounds; empty where none is plausible.
std::string guess_unit(double diagonal) {
    if (diagonal >= 12 && diagonal <= 120) return "mm";
    if (diagonal >= 1.2 && diagonal < 12) return "cm";
    if (diagonal >= 0.012 && diagonal <= 0.12) return "m";
    return "";
}

void add_to(FileMesh& mesh, const TextSurface& s) {
    OpenMesh::IO::ImporterT<FileMesh> importer(mesh);
    std::vector<OpenMesh::VertexHandle> corners;
    for (const auto& v : s.vertices) importer.add_vertex(OpenMesh::Vec3f(v[0], v[1], v[2]));
    for (const auto& f : s.faces) {
        corners.clear();
        for (int v : f) corners.emplace_back(v);
        importer.add_face(corners);
    }
}

/// False where the file cannot be read.
bool read_file_mesh(const std::filesystem::path& path, FileMesh& mesh) {
    std::ifstream in(path, std::ios::binary);
    in.imbue(std::locale::classic());
    const std::string kind = lower_extension(path);
    OpenMesh::IO::Options options;
    if (kind == ".stl") {
        if (is_binary_stl(in, std::filesystem::file_size(path))) options += OpenMesh::IO::Options::Binary;
        in.clear();
        in.seekg(0);
    } else {
        skip_byte_order_mark(in);
    }
    const bool text_stl = kind == ".stl" && !options.check(OpenMesh::IO::Options::Binary);
    if (text_stl || kind == ".obj") return add_to(mesh, text_stl ? read_text_stl(in) : read_obj(in)), true;
    return OpenMesh::IO::read_mesh(mesh, in, kind, options);
}

}  // namespace

SurfaceFile read_surface(const std::filesystem::path& path, const std::string& unit, SurfaceUse use) {
    const long expected = scan_surface_file(path);
    FileMesh mesh;
    omerr().disable();
    const bool ok = read_file_mesh(path, mesh);
    omerr().enable();
    if (!ok)
        refuse_file(path, "cannot be read as " + path.extension().string().substr(1) + " (truncated or malformed?)");
    SurfaceFile file{to_surface(mesh), unit, unit.empty()};
    if (expected >= 0 && long(file.surface.triangles.size()) < expected)
        refuse_file(path, "declares " + std::to_string(expected) + " triangles, but only " +
                              std::to_string(file.surface.triangles.size()) +
                              " could be read (truncated, or faces that share an edge with two others: non-manifold)");
    const auto box = bounds(file.surface.vertices);
    const double diagonal = std::hypot(box[1][0] - box[0][0], box[1][1] - box[0][1], box[1][2] - box[0][2]);
    if (file.unit.empty()) file.unit = guess_unit(diagonal);
    const std::map<std::string, double> factor{{"m", 1.0}, {"cm", 1e-2}, {"mm", 1e-3}};
    if (!file.surface.triangles.empty() && !factor.count(file.unit)) {
        if (unit.empty())
            refuse_file(path, "its bounds measure " + plain_to_string(diagonal) +
                                  " units, which is no fingertip in m, cm or mm; name the unit");
        refuse_file(path, "unknown unit '" + unit + "'; expected m, cm or mm");
    }
    const double scale = file.surface.triangles.empty() ? 1 : factor.at(file.unit);
    for (Point& p : file.surface.vertices)
        for (double& x : p) x *= scale;
    const double low = use == SurfaceUse::finger ? 5e-3 : 1e-3, high = use == SurfaceUse::finger ? 0.2 : 2;
    if (!file.surface.triangles.empty() && (diagonal * scale < low || diagonal * scale > high))
        refuse_file(path, "its bounds measure " + plain_to_string(1e3 * diagonal * scale) + " mm; expected " +
                              std::to_string(int(1e3 * low)) + " to " + std::to_string(int(1e3 * high)) +
                              " mm (is the unit '" + file.unit + "' right?)");
    auto wrong = check_surface(file.surface, use);
    for (auto& w : wrong) w = path.string() + ": " + w;
    if (!wrong.empty()) throw InputError(wrong);
    return file;
}

}  // namespace palpate
