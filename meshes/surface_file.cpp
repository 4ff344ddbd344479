// Surface files through OpenMesh, guarded: its readers report success for truncated and empty files,
// drop faces with bad indices, replace NaN and allocate what a header claims.

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/Utils/GenProg.hh>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/surface.h"

namespace palpate {

namespace {

struct DoubleTraits : OpenMesh::DefaultTraits {
    typedef OpenMesh::Vec3d Point;
    typedef OpenMesh::Vec3d Normal;
};
using FileMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

[[noreturn]] void refuse(const std::filesystem::path& path, const std::string& what) {
    throw InputError(path.string() + ": " + what);
}

std::string lower_extension(const std::filesystem::path& path) {
    std::string e = path.extension().string();
    std::transform(e.begin(), e.end(), e.begin(), [](unsigned char c) { return std::tolower(c); });
    return e;
}

/// Faces a text file declares or lists, to be compared with what the reader returns.
struct Expected {
    long faces = -1;  ///< -1: unknown
};

Expected scan_obj(const std::filesystem::path& path, std::istream& in) {
    Expected e{0};
    long vertices = 0, line_number = 0;
    std::string line, word;
    while (std::getline(in, line)) {
        ++line_number;
        std::istringstream words(line);
        if (!(words >> word)) continue;
        const std::string where = "line " + std::to_string(line_number) + ": ";
        if (word == "v") {
            ++vertices;
            for (int k = 0; k < 3; ++k) {
                if (!(words >> word)) refuse(path, where + "a vertex needs three numbers");
                char* end = nullptr;
                const double x = std::strtod(word.c_str(), &end);
                if (*end || !std::isfinite(x))
                    refuse(path, where + "expected a finite coordinate, found '" + word + "'");
            }
        } else if (word == "f") {
            long corners = 0;
            while (words >> word) {
                const long index = std::strtol(word.c_str(), nullptr, 10);
                if (index == 0 || std::abs(index) > vertices)
                    refuse(path, where + "a face names vertex " + word + ", but only " + std::to_string(vertices) +
                                     " are defined before it");
                ++corners;
            }
            if (corners < 3) refuse(path, where + "a face needs at least three vertices (is the file truncated?)");
            e.faces += corners - 2;
        }
    }
    return e;
}

Expected scan_stl(const std::filesystem::path& path, std::istream& in, std::uintmax_t size) {
    char head[84] = {};
    in.read(head, sizeof head);
    std::uint32_t count = 0;
    std::memcpy(&count, head + 80, 4);
    if (size >= 84 && size == 84 + 50ull * count) return {long(count)};
    if (std::strncmp(head, "solid", 5) != 0)
        refuse(path, "a binary STL of " + std::to_string(count) + " triangles has " +
                         std::to_string(84 + 50ull * count) + " bytes, this file has " + std::to_string(size) +
                         " (truncated?)");
    in.clear();
    in.seekg(0);
    std::string word, last;
    Expected e{0};
    while (in >> word) {
        if (word == "endfacet") ++e.faces;
        if (word == "endsolid") last = word;
        if (word == "nan" || word == "NaN" || word == "-nan" || word == "inf")
            refuse(path, "it holds '" + word + "' where a number is expected");
    }
    if (last.empty()) refuse(path, "'endsolid' is missing (truncated?)");
    return e;
}

Expected scan_counts(const std::filesystem::path& path, std::istream& in, std::uintmax_t size,
                     const std::string& kind) {
    std::string word;
    long vertices = -1, faces = -1;
    if (kind == ".off") {
        in >> word;
        if (word.find("OFF") == std::string::npos) refuse(path, "expected 'OFF' at the start, found '" + word + "'");
        auto next = [&](long& n) {
            while (in >> word && word[0] == '#') std::getline(in, word);
            n = std::strtol(word.c_str(), nullptr, 10);
        };
        next(vertices);
        next(faces);
    } else {
        std::string line;
        while (std::getline(in, line) && line.substr(0, 10) != "end_header") {
            std::istringstream words(line);
            std::string a, b;
            long n;
            if (words >> a >> b >> n && a == "element") (b == "vertex" ? vertices : b == "face" ? faces : n) = n;
        }
    }
    if (vertices <= 0 || faces <= 0) refuse(path, "the header declares no vertices or no faces");
    // The shortest vertex has six characters or twelve bytes, the shortest face eight characters or bytes.
    if (std::uintmax_t(vertices) * 6 + std::uintmax_t(faces) * 7 > size)
        refuse(path, "the header declares " + std::to_string(vertices) + " vertices and " + std::to_string(faces) +
                         " faces, more than its " + std::to_string(size) + " bytes can hold (truncated?)");
    return {faces};
}

Expected scan(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) refuse(path, "no such file");
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (size == 0) refuse(path, "the file is empty");
    if (size > (1ull << 30)) refuse(path, "the file has more than 1 GiB; decimate the surface first");
    std::ifstream in(path, std::ios::binary);
    if (!in) refuse(path, "cannot be read (permissions?)");
    const std::string kind = lower_extension(path);
    if (kind == ".obj") return scan_obj(path, in);
    if (kind == ".stl") return scan_stl(path, in, size);
    if (kind == ".ply" || kind == ".off") return scan_counts(path, in, size, kind);
    refuse(path, "unknown kind '" + kind + "'; expected .obj, .stl, .ply or .off");
}

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

}  // namespace

SurfaceFile read_surface(const std::filesystem::path& path, const std::string& unit, SurfaceUse use) {
    const Expected expected = scan(path);
    FileMesh mesh;
    OpenMesh::IO::Options options;
    omerr().disable();
    const bool ok = OpenMesh::IO::read_mesh(mesh, path.string(), options);
    omerr().enable();
    if (!ok) refuse(path, "cannot be read as " + lower_extension(path).substr(1) + " (truncated or malformed?)");
    SurfaceFile file{to_surface(mesh), unit, unit.empty()};
    if (expected.faces >= 0 && long(file.surface.triangles.size()) < expected.faces)
        refuse(path, "declares " + std::to_string(expected.faces) + " triangles, but only " +
                         std::to_string(file.surface.triangles.size()) +
                         " could be read (truncated, or faces that share an edge with two others: non-manifold)");
    const auto box = bounds(file.surface.vertices);
    const double diagonal = std::hypot(box[1][0] - box[0][0], box[1][1] - box[0][1], box[1][2] - box[0][2]);
    if (file.unit.empty()) file.unit = guess_unit(diagonal);
    const std::map<std::string, double> factor{{"m", 1.0}, {"cm", 1e-2}, {"mm", 1e-3}};
    if (!file.surface.triangles.empty() && !factor.count(file.unit)) {
        if (unit.empty())
            refuse(path, "its bounds measure " + std::to_string(diagonal) +
                             " units, which is no fingertip in m, cm or mm; name the unit");
        refuse(path, "unknown unit '" + unit + "'; expected m, cm or mm");
    }
    const double scale = file.surface.triangles.empty() ? 1 : factor.at(file.unit);
    for (Point& p : file.surface.vertices)
        for (double& x : p) x *= scale;
    const double low = use == SurfaceUse::finger ? 5e-3 : 1e-3, high = use == SurfaceUse::finger ? 0.2 : 2;
    if (!file.surface.triangles.empty() && (diagonal * scale < low || diagonal * scale > high))
        refuse(path, "its bounds measure " + std::to_string(1e3 * diagonal * scale) + " mm; expected " +
                         std::to_string(int(1e3 * low)) + " to " + std::to_string(int(1e3 * high)) +
                         " mm (is the unit '" + file.unit + "' right?)");
    auto wrong = check_surface(file.surface, use);
    for (auto& w : wrong) w = path.string() + ": " + w;
    if (!wrong.empty()) throw InputError(wrong);
    return file;
}

}  // namespace palpate
