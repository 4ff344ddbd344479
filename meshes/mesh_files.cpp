#include "meshes/mesh_files.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "meshes/mesh_quality.h"
#include "meshes/plain_numbers.h"
#include "meshes/surface.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {

/// Whitespace-separated words of a file, with line numbers for messages.
class Words {
  public:
    Words(const fs::path& path, bool hash_comments) : path_(path) {
        std::ifstream in(path);
        if (!in) throw InputError(path.string() + ": no such file, or it cannot be read");
        skip_byte_order_mark(in);
        std::string line;
        for (int number = 1; std::getline(in, line); ++number) {
            if (hash_comments) line = line.substr(0, line.find('#'));
            std::istringstream words(line);
            for (std::string w; words >> w;) words_.push_back({w, number});
        }
        if (words_.empty()) throw InputError(path.string() + ": the file is empty");
    }
    bool done() const { return next_ >= words_.size(); }
    [[noreturn]] void refuse(const std::string& what) const {
        const int line = words_.empty() ? 0 : words_[std::min(next_, words_.size()) - (next_ > 0 ? 1 : 0)].line;
        throw InputError(path_.string() + ":" + std::to_string(line) + ": " + what);
    }
    std::string word(const char* expected) {
        if (done()) refuse(std::string("expected ") + expected + ", found the end of the file (truncated?)");
        return words_[next_++].text;
    }
    double number(const char* expected) {
        const std::string w = word(expected);
        char* end = nullptr;
        const double x = plain_strtod(w.c_str(), &end);
        if (*end || end == w.c_str() || !std::isfinite(x))
            refuse(std::string("expected ") + expected + ", found '" + w + "'");
        return x;
    }
    long integer(const char* expected, long low, long high) {
        const double x = number(expected);
        if (x != std::floor(x) || x < low || x > high)
            refuse(std::string("expected ") + expected + " between " + std::to_string(low) + " and " +
                   std::to_string(high));
        return long(x);
    }
    /// Skips to just behind the word, or says that it is missing.
    void seek(const std::string& text) {
        while (!done())
            if (words_[next_++].text == text) return;
        refuse("'" + text + "' is missing (truncated?)");
    }
    void rewind() { next_ = 0; }
    long remaining() const { return long(words_.size() - next_); }

  private:
    struct Word {
        std::string text;
        int line;
    };
    fs::path path_;
    std::vector<Word> words_;
    std::size_t next_ = 0;
};

constexpr long many = 50000000;

int node_index(Words& in, const std::map<long, int>& index) {
    const long tag = in.integer("a node number", 0, many);
    const auto it = index.find(tag);
    if (it == index.end()) in.refuse("an element names node " + std::to_string(tag) + ", which is not defined");
    return it->second;
}

void read_nodes(Words& in, long count, int extra, TetMesh& mesh, std::map<long, int>& index) {
    if (count * 4 > in.remaining() + 3)
        in.refuse("the file declares " + std::to_string(count) + " nodes but ends early (truncated?)");
    for (long i = 0; i < count; ++i) {
        index[in.integer("a node number", 0, many)] = int(mesh.nodes.size());
        Point p{in.number("x"), in.number("y"), in.number("z")};
        mesh.nodes.push_back(p);
        for (int k = 0; k < extra; ++k) in.number("an attribute");
    }
}

TetMesh read_tetgen(fs::path path) {
    TetMesh mesh;
    std::map<long, int> index;
    Words nodes(path.replace_extension(".node"), true);
    const long count = nodes.integer("the node count", 1, many);
    nodes.integer("the dimension 3", 3, 3);
    const long attributes = nodes.integer("the attribute count", 0, 100),
               markers = nodes.integer("0 or 1 markers", 0, 1);
    read_nodes(nodes, count, int(attributes + markers), mesh, index);
    Words elements(path.replace_extension(".ele"), true);
    const long tets = elements.integer("the element count", 1, many);
    const long corners = elements.integer("the nodes per element, 4 or 10", 4, 10),
               regions = elements.integer("the attribute count", 0, 100);
    for (long e = 0; e < tets; ++e) {
        elements.integer("an element number", 0, many);
        std::array<int, 4> t{};
        for (int& i : t) i = node_index(elements, index);
        for (long k = 4; k < corners + regions; ++k) elements.number("a value");
        mesh.tets.push_back(t);
    }
    return mesh;
}

void read_gmsh_2(Words& in, TetMesh& mesh) {
    std::map<long, int> index;
    in.seek("$Nodes");
    read_nodes(in, in.integer("the node count", 1, many), 0, mesh, index);
    in.seek("$Elements");
    const long count = in.integer("the element count", 1, many);
    const std::map<long, int> corner_count{{1, 2}, {2, 3}, {3, 4}, {4, 4},   {5, 8}, {6, 6},
                                           {7, 5}, {8, 3}, {9, 6}, {11, 10}, {15, 1}};
    for (long e = 0; e < count; ++e) {
        in.integer("an element number", 0, many);
        const long type = in.integer("an element type", 1, 200), tags = in.integer("a tag count", 0, 20);
        if (!corner_count.count(type))
            in.refuse("element type " + std::to_string(type) + " is not supported; export linear tetrahedra");
        for (long k = 0; k < tags; ++k) in.number("a tag");
        std::array<int, 4> t{};
        for (int k = 0; k < corner_count.at(type); ++k) {
            const int node = node_index(in, index);
            if (k < 4) t[k] = node;
        }
        if (type == 4) mesh.tets.push_back(t);
    }
}

void read_gmsh_4(Words& in, TetMesh& mesh) {
    std::map<long, int> index;
    in.seek("$Nodes");
    const long node_blocks = in.integer("the block count", 1, many);
    for (int k = 0; k < 3; ++k) in.number("a count");
    for (long b = 0; b < node_blocks; ++b) {
        for (int k = 0; k < 3; ++k) in.number("an entity");
        const long count = in.integer("the node count", 0, many);
        if (count * 4 > in.remaining())
            in.refuse("a block declares " + std::to_string(count) + " nodes but the file ends early");
        for (long i = 0; i < count; ++i) index[in.integer("a node number", 0, many)] = int(mesh.nodes.size() + i);
        for (long i = 0; i < count; ++i) mesh.nodes.push_back({in.number("x"), in.number("y"), in.number("z")});
    }
    in.seek("$Elements");
    const long blocks = in.integer("the block count", 1, many);
    for (int k = 0; k < 3; ++k) in.number("a count");
    const std::map<long, int> corner_count{{1, 2}, {2, 3}, {3, 4}, {4, 4}, {5, 8}, {6, 6}, {7, 5}, {15, 1}};
    for (long b = 0; b < blocks; ++b) {
        in.number("an entity"), in.number("an entity");
        const long type = in.integer("an element type", 1, 200), count = in.integer("the element count", 0, many);
        if (!corner_count.count(type))
            in.refuse("element type " + std::to_string(type) + " is not supported; export linear tetrahedra");
        for (long e = 0; e < count; ++e) {
            in.integer("an element number", 0, many);
            std::array<int, 4> t{};
            for (int k = 0; k < corner_count.at(type); ++k) {
                const int node = node_index(in, index);
                if (k < 4) t[k] = node;
            }
            if (type == 4) mesh.tets.push_back(t);
        }
    }
}

TetMesh read_gmsh(const fs::path& path) {
    Words in(path, false);
    TetMesh mesh;
    in.seek("$MeshFormat");
    const double version = in.number("the format version");
    if (in.integer("the file type 0 (ASCII)", 0, 1) == 1) in.refuse("binary Gmsh files are not read; save as ASCII");
    in.rewind();
    if (version < 4)
        read_gmsh_2(in, mesh);
    else if (version > 4.05)
        read_gmsh_4(in, mesh);
    else
        in.refuse("Gmsh format 4.0 is not read; save as 4.1 or 2.2");
    return mesh;
}

/// Words of the ASCII DataArray that follows `marker` in the text; empty if there is none.
std::vector<double> data_array(const fs::path& path, const std::string& text, std::size_t from,
                               const std::string& what) {
    const std::size_t tag = text.find("<DataArray", from), open = text.find('>', tag),
                      close = text.find("</DataArray>", open);
    if (tag == std::string::npos || open == std::string::npos || close == std::string::npos)
        throw InputError(path.string() + ": the array of " + what + " is missing (truncated?)");
    if (text.substr(tag, open - tag).find("ascii") == std::string::npos)
        throw InputError(path.string() + ": the array of " + what + " is not in ASCII; save the grid with ASCII data");
    std::vector<double> values;
    const char* p = text.c_str() + open + 1;
    const char* end = text.c_str() + close;
    while (p < end) {
        char* next = nullptr;
        const double x = plain_strtod(p, &next);
        if (next == p || next > end) break;
        values.push_back(x);
        p = next;
    }
    return values;
}

TetMesh read_vtu(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    const std::string text((std::istreambuf_iterator<char>(in)), {});
    if (text.empty()) throw InputError(path.string() + ": no such file, or it is empty");
    auto find = [&](const std::string& what, std::size_t from) {
        const std::size_t at = text.find(what, from);
        if (at == std::string::npos)
            throw InputError(path.string() + ": '" + what + "' is missing; expected a VTK unstructured grid");
        return at;
    };
    const std::size_t cells = find("<Cells", 0);
    const auto points = data_array(path, text, find("<Points", 0), "points");
    auto cell_array = [&](const char* name) {
        return data_array(path, text, text.rfind("<DataArray", find(std::string("Name=\"") + name + "\"", cells)),
                          name);
    };
    const auto connectivity = cell_array("connectivity"), offsets = cell_array("offsets"), types = cell_array("types");
    TetMesh mesh;
    for (std::size_t i = 0; i + 2 < points.size(); i += 3)
        mesh.nodes.push_back({points[i], points[i + 1], points[i + 2]});
    double begin = 0;
    for (std::size_t c = 0; c < std::min(offsets.size(), types.size()); begin = offsets[c++]) {
        if (types[c] != 10) continue;
        if (offsets[c] - begin != 4 || offsets[c] > double(connectivity.size()))
            throw InputError(path.string() + ": cell " + std::to_string(c) + " is no tetrahedron of four nodes");
        std::array<int, 4> t{};
        for (int k = 0; k < 4; ++k) t[k] = int(connectivity[std::size_t(begin) + k]);
        mesh.tets.push_back(t);
    }
    return mesh;
}

void keep_used_nodes(TetMesh& mesh) {
    std::vector<int> renumber(mesh.nodes.size(), -1);
    std::vector<Point> kept;
    for (auto& t : mesh.tets)
        for (int& i : t) {
            if (renumber[i] < 0) renumber[i] = int(kept.size()), kept.push_back(mesh.nodes[i]);
            i = renumber[i];
        }
    if (kept.size() != mesh.nodes.size()) {
        mesh.nodes = kept;
    } else {  // nothing unused: keep the file's numbering
        std::vector<int> original(kept.size());
        for (std::size_t i = 0; i < renumber.size(); ++i) original[renumber[i]] = int(i);
        for (auto& t : mesh.tets)
            for (int& i : t) i = original[i];
    }
}

}  // namespace

TetMesh read_tet_mesh(const fs::path& path, const std::string& unit) {
    const std::map<std::string, double> factor{{"m", 1.0}, {"cm", 1e-2}, {"mm", 1e-3}};
    if (!factor.count(unit)) throw InputError(path.string() + ": unknown unit '" + unit + "'; expected m, cm or mm");
    if (!fs::is_regular_file(path)) throw InputError(path.string() + ": no such file");
    const std::string kind = path.extension().string();
    TetMesh mesh;
    if (kind == ".node" || kind == ".ele")
        mesh = read_tetgen(path);
    else if (kind == ".msh")
        mesh = read_gmsh(path);
    else if (kind == ".vtu")
        mesh = read_vtu(path);
    else
        throw InputError(path.string() + ": unknown kind '" + kind + "'; expected .node, .ele, .msh or .vtu");
    if (mesh.tets.empty()) throw InputError(path.string() + ": it holds no tetrahedra");
    for (const auto& t : mesh.tets)
        for (int i : t)
            if (i < 0 || i >= int(mesh.nodes.size()))
                throw InputError(path.string() + ": an element names node " + std::to_string(i) + " of " +
                                 std::to_string(mesh.nodes.size()));
    for (Point& p : mesh.nodes)
        for (double& x : p) x *= factor.at(unit);
    keep_used_nodes(mesh);
    if (measure_quality(mesh).volume < 0)  // the other convention: all turned
        for (auto& t : mesh.tets) std::swap(t[2], t[3]);
    auto wrong = check_tets(mesh);
    const auto box = bounds(mesh.nodes);
    const double size = std::hypot(box[1][0] - box[0][0], box[1][1] - box[0][1], box[1][2] - box[0][2]);
    if (size < 5e-3 || size > 0.2)
        wrong.push_back("its bounds measure " + plain_to_string(1e3 * size) +
                        " mm; expected 5 to 200 mm (is the unit '" + unit + "' right?)");
    for (auto& w : wrong) w = path.string() + ": " + w;
    if (!wrong.empty()) throw InputError(wrong);
    mesh.surface = boundary(mesh.tets);
    return mesh;
}

std::string read_file(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    PlainText text;
    text << in.rdbuf();
    std::error_code none;
    if (!in) throw InputError(path.string() + (fs::exists(path, none) ? ": cannot be read" : ": no such file"));
    return text.str();
}

void throw_unwritable(const fs::path& path, int error) {
    const std::string message = path.string() + ": cannot be written: " + std::strerror(error);
    for (int machine : {ENOSPC, EDQUOT, EFBIG, EIO})
        if (error == machine) throw std::runtime_error(message);
    throw InputError(message);
}

void write_file(const fs::path& path, const std::string& text) {
    // What is no plain file, such as a device or a pipe, and what a link leads to, is written to: never replaced.
    std::error_code none;
    const fs::file_status there = fs::symlink_status(path, none);
    const bool replaces = !fs::exists(there) || fs::is_regular_file(there);
    const fs::path written = replaces ? fs::path(path.string() + ".part") : path;
    std::FILE* file = std::fopen(written.c_str(), "wb");
    if (!file) throw_unwritable(path, errno);
    int error = std::fwrite(text.data(), 1, text.size(), file) == text.size() ? 0 : errno;
    if (std::fclose(file) != 0 && error == 0) error = errno;
    if (replaces && error == 0 && std::rename(written.c_str(), path.c_str()) != 0) error = errno;
    if (error == 0) return;
    if (replaces) std::remove(written.c_str());
    throw_unwritable(path, error);
}

void write_vtu(const fs::path& path, const TetMesh& mesh, const std::vector<VtuField>& node_fields,
               const std::vector<VtuField>& element_fields) {
    PlainText out;
    out.precision(9);
    out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n"
        << "<UnstructuredGrid>\n<Piece NumberOfPoints=\"" << mesh.nodes.size() << "\" NumberOfCells=\""
        << mesh.tets.size() << "\">\n";
    auto fields = [&](const char* kind, const std::vector<VtuField>& list) {
        out << "<" << kind << ">\n";
        for (const VtuField& f : list) {
            out << "<DataArray type=\"Float64\" Name=\"" << f.name << "\" NumberOfComponents=\"" << f.components
                << "\" format=\"ascii\">\n";
            for (std::size_t i = 0; i < f.values.size(); ++i)
                out << f.values[i] << ((i + 1) % f.components ? ' ' : '\n');
            out << "</DataArray>\n";
        }
        out << "</" << kind << ">\n";
    };
    fields("PointData", node_fields);
    fields("CellData", element_fields);
    out << "<Points>\n<DataArray type=\"Float64\" Name=\"position_mm\" NumberOfComponents=\"3\" format=\"ascii\">\n";
    for (const Point& p : mesh.nodes) out << 1e3 * p[0] << ' ' << 1e3 * p[1] << ' ' << 1e3 * p[2] << '\n';
    out << "</DataArray>\n</Points>\n<Cells>\n<DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">\n";
    for (const auto& t : mesh.tets) out << t[0] << ' ' << t[1] << ' ' << t[2] << ' ' << t[3] << '\n';
    out << "</DataArray>\n<DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">\n";
    for (std::size_t e = 1; e <= mesh.tets.size(); ++e) out << 4 * e << '\n';
    out << "</DataArray>\n<DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">\n";
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) out << "10\n";
    out << "</DataArray>\n</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
    write_file(path, out.str());
}

}  // namespace palpate
