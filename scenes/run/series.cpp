#include "scenes/run/series.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <stdexcept>

#include "meshes/mesh_files.h"

namespace palpate {

std::vector<double> Series::column(const std::string& name) const {
    const auto it = std::find(columns.begin(), columns.end(), name);
    if (it == columns.end()) throw std::out_of_range("no column " + name);
    std::vector<double> out;
    for (std::size_t r = 0; r < rows(); ++r) out.push_back(at(r, std::size_t(it - columns.begin())));
    return out;
}

void append_header(std::string& out, const Series& series) {
    for (std::size_t c = 0; c < series.columns.size(); ++c) (out += c ? "," : "") += series.columns[c];
    out += '\n';
}

void append_rows(std::string& out, std::span<const double> values, std::size_t columns) {
    char text[40];
    for (std::size_t k = 0; k < values.size(); ++k) {
        out.append(text, std::to_chars(text, text + sizeof text, values[k], std::chars_format::general, 12).ptr);
        out += (k + 1) % columns ? ',' : '\n';
    }
}

void write_csv(const std::filesystem::path& path, const Series& series) {
    std::string text;
    append_header(text, series);
    append_rows(text, series.values, series.columns.size());
    write_file(path, text);
}

std::string unit_of(const std::string& column) {
    static const std::map<std::string, std::string> units{{"s", "s"},     {"ms", "ms"},  {"us", "us"}, {"N", "N"},
                                                          {"Nm", "N m"},  {"mm", "mm"},  {"um", "um"}, {"mm2", "mm2"},
                                                          {"deg", "deg"}, {"kPa", "kPa"}};
    const std::size_t at = column.rfind('_');
    if (at == std::string::npos) return "1";
    for (const auto& [ending, unit] : {std::pair<std::string, std::string>{"_mm_per_s", "mm/s"},
                                       {"_m_per_s", "m/s"},
                                       {"_rad_per_s", "rad/s"},
                                       {"_deg_per_s", "deg/s"}})
        if (column.ends_with(ending)) return unit;
    const auto found = units.find(column.substr(at + 1));
    return found == units.end() ? "1" : found->second;
}

}  // namespace palpate
