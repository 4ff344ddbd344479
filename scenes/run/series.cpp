#include "scenes/run/series.h"

#include <algorithm>
#include <sstream>
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

void write_csv(const std::filesystem::path& path, const Series& series) {
    std::ostringstream out;
    out.precision(12);
    for (std::size_t c = 0; c < series.columns.size(); ++c) out << (c ? "," : "") << series.columns[c];
    out << '\n';
    for (std::size_t r = 0; r < series.rows(); ++r)
        for (std::size_t c = 0; c < series.columns.size(); ++c)
            out << series.at(r, c) << (c + 1 < series.columns.size() ? ',' : '\n');
    write_file(path, out.str());
}

}  // namespace palpate
