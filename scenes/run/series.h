#pragma once
// Time series of a run, sized beforehand so that recording does not allocate.

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

/// Rows of named columns.
struct Series {
    std::vector<std::string> columns;  ///< with units, for example "force_N"
    std::vector<double> values;        ///< [row][column]
    std::size_t rows() const { return columns.empty() ? 0 : values.size() / columns.size(); }
    double at(std::size_t row, std::size_t column) const { return values[row * columns.size() + column]; }
    std::vector<double> column(const std::string& name) const;
    void reserve(std::size_t rows) { values.reserve(rows * columns.size()); }
};

/// Comma-separated values with a header line; full precision.
void write_csv(const std::filesystem::path& path, const Series& series);

}  // namespace palpate
