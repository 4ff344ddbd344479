#include "meshes/surface_scan.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <vector>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

void refuse_file(const std::filesystem::path& path, const std::string& what) {
    throw InputError(path.string() + ": " + what);
}

namespace {

long scan_obj(const std::filesystem::path& path, std::istream& in) {
    long faces = 0;
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
                if (!(words >> word)) refuse_file(path, where + "a vertex needs three numbers");
                char* end = nullptr;
                const double x = plain_strtod(word.c_str(), &end);
                if (*end || !std::isfinite(x))
                    refuse_file(path, where + "expected a finite coordinate, found '" + word + "'");
            }
        } else if (word == "f") {
            std::vector<long> corners;
            while (words >> word) {
                const long index = std::strtol(word.c_str(), nullptr, 10);
                if (index == 0 || std::abs(index) > vertices)
                    refuse_file(path, where + "a face names vertex " + word + ", but only " + std::to_string(vertices) +
                                          " are defined before it");
                corners.push_back(index > 0 ? index : vertices + 1 + index);
                if (std::count(corners.begin(), corners.end(), corners.back()) > 1)
                    refuse_file(path, where + "a face has vertex " + word + " twice: it has no area there");
            }
            if (corners.size() < 3)
                refuse_file(path, where + "a face needs at least three vertices (is the file truncated?)");
            faces += long(corners.size()) - 2;
        }
    }
    return faces;
}

long scan_binary_stl(const std::filesystem::path& path, std::istream& in, std::uintmax_t size) {
    const long faces = long((size - 84) / 50);
    in.clear();
    in.seekg(84);
    for (long f = 0; f < faces; ++f) {
        char facet[50];
        float corners[9];
        if (!in.read(facet, sizeof facet)) break;
        std::memcpy(corners, facet + 12, sizeof corners);
        for (float x : corners)
            if (!std::isfinite(x))
                refuse_file(path, "triangle " + std::to_string(f + 1) + " of " + std::to_string(faces) +
                                      " has a corner that is no finite number (nan or inf)");
    }
    return faces;
}

long scan_stl(const std::filesystem::path& path, std::istream& in, std::uintmax_t size) {
    if (is_binary_stl(in, size)) return scan_binary_stl(path, in, size);
    char head[84] = {};
    in.clear();
    in.seekg(0);
    in.read(head, sizeof head);
    std::uint32_t count = 0;
    std::memcpy(&count, head + 80, 4);
    if (std::strncmp(head, "solid", 5) != 0)
        refuse_file(path, "a binary STL of " + std::to_string(count) + " triangles has " +
                              std::to_string(84 + 50ull * count) + " bytes, this file has " + std::to_string(size) +
                              " (truncated?)");
    in.clear();
    in.seekg(0);
    std::string word, last;
    long faces = 0;
    while (in >> word) {
        if (word == "endfacet") ++faces;
        if (word == "endsolid") last = word;
        if (word == "nan" || word == "NaN" || word == "-nan" || word == "inf")
            refuse_file(path, "it holds '" + word + "' where a number is expected");
    }
    if (last.empty()) refuse_file(path, "'endsolid' is missing (truncated?)");
    return faces;
}

constexpr long most_corners = 1000;  ///< of one face

/// Whether a file of this size can hold what its header declares: the shortest vertex has six characters or twelve
/// bytes, the shortest face seven.
void check_counts(const std::filesystem::path& path, long vertices, long faces, std::uintmax_t size) {
    if (vertices <= 0 || faces <= 0) refuse_file(path, "the header declares no vertices or no faces");
    if (double(vertices) * 6 + double(faces) * 7 > double(size))
        refuse_file(path, "the header declares " + std::to_string(vertices) + " vertices and " + std::to_string(faces) +
                              " faces, more than its " + std::to_string(size) + " bytes can hold (truncated?)");
}

/// Numbers of a text file, one after the other, with the line they stand in.
class Numbers {
  public:
    Numbers(const std::filesystem::path& path, std::istream& in, long line) : path_(path), in_(in), line_(line) {}
    /// The next line that holds something; comments (#) are none.
    void next_line() {
        std::string text;
        while (std::getline(in_, text)) {
            ++line_;
            words_.clear();
            words_.str(text);
            const auto first = text.find_first_not_of(" \t\r");
            if (first != std::string::npos && text[first] != '#') return;
        }
        refuse_file(path_, "it ends in line " + std::to_string(line_) + ", before all that its header declares");
    }
    double number(const char* what) {
        std::string word;
        words_ >> word;
        char* end = nullptr;
        const double x = plain_strtod(word.c_str(), &end);
        if (word.empty() || *end || !std::isfinite(x)) complain(what, word);
        return x;
    }
    long count(const char* what, long low, long high) {
        std::string word;
        words_ >> word;
        char* end = nullptr;
        const long n = std::strtol(word.c_str(), &end, 10);
        if (word.empty() || *end || n < low || n > high) complain(what, word);
        return n;
    }
    /// Everything in the line has been read.
    bool at_end() { return (words_ >> std::ws).eof(); }
    [[noreturn]] void complain(const std::string& what, const std::string& found) const {
        refuse_file(path_,
                    "line " + std::to_string(line_) + ": expected " + what + ", found '" + found.substr(0, 40) + "'");
    }

  private:
    const std::filesystem::path& path_;
    std::istream& in_;
    std::istringstream words_;
    long line_;
};

long scan_off(const std::filesystem::path& path, std::istream& in, std::uintmax_t size) {
    std::string head;
    std::getline(in, head);
    while (!head.empty() && std::isspace(static_cast<unsigned char>(head.back()))) head.pop_back();
    if (head != "OFF") refuse_file(path, "expected 'OFF' alone in the first line, found '" + head.substr(0, 40) + "'");
    Numbers numbers(path, in, 1);
    numbers.next_line();
    const long vertices = numbers.count("the number of vertices", 0, 1L << 30);
    const long faces = numbers.count("the number of faces", 0, 1L << 30);
    check_counts(path, vertices, faces, size);
    for (long v = 0; v < vertices; ++v) {
        numbers.next_line();
        for (int k = 0; k < 3; ++k) numbers.number("a finite coordinate");
    }
    long triangles = 0;
    for (long f = 0; f < faces; ++f) {
        numbers.next_line();
        const long corners = numbers.count("a face's number of corners, at least three", 3, most_corners);
        for (long k = 0; k < corners; ++k) numbers.count("a vertex that exists", 0, vertices - 1);
        triangles += corners - 2;
    }
    return triangles;
}

struct PlyProperty {
    int bytes = 0;        ///< of a value, or of a list's entries
    int count_bytes = 0;  ///< of a list's length; 0: no list
    bool real = false, indices = false;
};
struct PlyElement {
    std::string name;
    long count = 0;
    std::vector<PlyProperty> properties;
};
struct PlyHeader {
    bool text = true, big_endian = false;
    long lines = 0;
    std::vector<PlyElement> elements;
};

PlyHeader read_ply_header(const std::filesystem::path& path, std::istream& in) {
    static const std::map<std::string, int> bytes_of{{"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},
                                                     {"short", 2}, {"ushort", 2},  {"int16", 2},  {"uint16", 2},
                                                     {"int", 4},   {"uint", 4},    {"int32", 4},  {"uint32", 4},
                                                     {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
    PlyHeader h;
    std::string line;
    while (h.lines < 1000 && std::getline(in, line)) {
        ++h.lines;
        if (!line.empty() && line.back() == '\r') line.pop_back();
        std::istringstream words(line);
        std::string key, a, b, c, d;
        words >> key >> a >> b >> c >> d;
        bool known = key == "comment" || key == "obj_info";
        if (h.lines == 1) known = line == "ply";
        if (h.lines == 2) {
            known = key == "format" && b == "1.0" &&
                    (a == "ascii" || a == "binary_little_endian" || a == "binary_big_endian");
            h.text = a == "ascii", h.big_endian = a == "binary_big_endian";
        }
        if (h.lines > 2 && line == "end_header") return h;
        if (h.lines > 2 && key == "element") {
            char* end = nullptr;
            const long count = std::strtol(b.c_str(), &end, 10);
            known = !b.empty() && !*end && count >= 0 && count < (1L << 31) && c.empty();
            for (const PlyElement& other : h.elements) known &= other.name != a;
            h.elements.push_back({a, count, {}});
        }
        if (h.lines > 2 && key == "property" && !h.elements.empty()) {
            PlyProperty p;
            const bool list = a == "list";
            const auto type = bytes_of.find(list ? c : a), length = bytes_of.find(b);
            known = type != bytes_of.end() && !(list ? d : b).empty();
            if (known) p.bytes = type->second, p.real = type->first[0] == 'f' || type->first[0] == 'd';
            if (list) {
                known &= length != bytes_of.end() && length->first[0] != 'f' && length->first[0] != 'd';
                if (known) p.count_bytes = length->second;
                p.indices = h.elements.back().name == "face" && (d == "vertex_indices" || d == "vertex_index");
                known &= !(p.indices && p.real);
            }
            h.elements.back().properties.push_back(p);
        }
        if (!known)
            refuse_file(
                path, "line " + std::to_string(h.lines) + " is no line of a PLY header: '" + line.substr(0, 60) + "'");
    }
    refuse_file(path, "'end_header' is missing (truncated?)");
}

/// Values of a PLY's body, text or binary.
class PlyValues {
  public:
    PlyValues(const std::filesystem::path& path, std::istream& in, const PlyHeader& header)
        : path_(path), in_(in), header_(header), numbers_(path, in, header.lines) {}
    void next_row() {
        if (header_.text) numbers_.next_line();
    }
    void end_row() {
        if (header_.text && !numbers_.at_end()) numbers_.complain("the end of the line", "more");
    }
    void real(int bytes) {
        if (header_.text) return void(numbers_.number("a finite number"));
        char raw[8];
        read(raw, bytes);
        float single = 0;
        double value = 0;
        std::memcpy(bytes == 4 ? static_cast<void*>(&single) : &value, raw, std::size_t(bytes));
        if (!std::isfinite(single) || !std::isfinite(value)) refuse_file(path_, "a value of the body is not finite");
    }
    long integer(int bytes, const char* what, long low, long high) {
        if (header_.text) return numbers_.count(what, low, high);
        char raw[8] = {};
        read(raw, bytes);
        std::uint32_t value = 0;
        std::memcpy(&value, raw, std::size_t(bytes));
        if (long(value) < low || long(value) > high)
            refuse_file(path_, std::string("expected ") + what + ", found " + std::to_string(value));
        return long(value);
    }
    void skip(int bytes, bool is_real) {
        if (header_.text) return void(numbers_.number("a finite number"));
        if (is_real) return real(bytes);
        char raw[8];
        read(raw, bytes);
    }

  private:
    void read(char* to, int bytes) {
        if (!in_.read(to, bytes)) refuse_file(path_, "it ends before all that its header declares (truncated?)");
        if (header_.big_endian) std::reverse(to, to + bytes);
    }
    const std::filesystem::path& path_;
    std::istream& in_;
    const PlyHeader& header_;
    Numbers numbers_;
};

long scan_ply(const std::filesystem::path& path, std::istream& in, std::uintmax_t size) {
    static_assert(std::endian::native == std::endian::little);
    const PlyHeader header = read_ply_header(path, in);
    long vertices = -1, faces = -1, triangles = 0;
    bool indices = false;
    for (const PlyElement& e : header.elements) {
        if (e.name == "vertex") vertices = e.count;
        if (e.name == "face") faces = e.count;
        if (double(e.count) > double(size))
            refuse_file(path, "it cannot hold all that its header declares (truncated?)");
        for (const PlyProperty& p : e.properties) indices |= p.indices;
    }
    check_counts(path, vertices, faces, size);
    if (!indices) refuse_file(path, "its faces have no list 'vertex_indices'");
    PlyValues values(path, in, header);
    for (const PlyElement& e : header.elements)
        for (long row = 0; row < e.count && !e.properties.empty(); ++row) {
            values.next_row();
            for (const PlyProperty& p : e.properties) {
                if (p.count_bytes == 0) {
                    values.skip(p.bytes, p.real);
                    continue;
                }
                const long entries =
                    p.indices
                        ? values.integer(p.count_bytes, "a face's number of corners, at least three", 3, most_corners)
                        : values.integer(p.count_bytes, "the length of a list", 0, 1000000);
                for (long k = 0; k < entries; ++k) {
                    if (p.indices)
                        values.integer(p.bytes, "a vertex that exists", 0, vertices - 1);
                    else
                        values.skip(p.bytes, p.real);
                }
                if (p.indices) triangles += entries - 2;
            }
            values.end_row();
        }
    return triangles;
}

}  // namespace

std::string lower_extension(const std::filesystem::path& path) {
    std::string e = path.extension().string();
    for (char& c : e)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return e;
}

bool is_binary_stl(std::istream& in, std::uintmax_t size) {
    char head[84] = {};
    in.read(head, sizeof head);
    std::uint32_t count = 0;
    std::memcpy(&count, head + 80, 4);
    return size >= 84 && size == 84 + 50ull * count;
}

long scan_surface_file(const std::filesystem::path& path) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error)) refuse_file(path, "no such file");
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (size == 0) refuse_file(path, "the file is empty");
    if (size > (1ull << 30)) refuse_file(path, "the file has more than 1 GiB; decimate the surface first");
    std::ifstream in(path, std::ios::binary);
    if (!in) refuse_file(path, "cannot be read (permissions?)");
    const std::string kind = lower_extension(path);
    if (kind != ".stl") skip_byte_order_mark(in);
    if (kind == ".obj") return scan_obj(path, in);
    if (kind == ".stl") return scan_stl(path, in, size);
    if (kind == ".ply") return scan_ply(path, in, size);
    if (kind == ".off") return scan_off(path, in, size);
    refuse_file(path, "unknown kind '" + kind + "'; expected .obj, .stl, .ply or .off");
}

}  // namespace palpate
