#pragma once
// Time series of a run, sized beforehand so that recording does not allocate.

#include <filesystem>
#include <span>
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

/// Comma-separated values with a header line; 12 digits.
void write_csv(const std::filesystem::path& path, const Series& series);
/// Pieces of such a file: its first line, and lines of rows.
void append_header(std::string& out, const Series& series);
void append_rows(std::string& out, std::span<const double> values, std::size_t columns);

/// The unit that a column's name ends with ("mm" of "bone_x_mm"), as HDF5 readers know it; "1" where it has none.
std::string unit_of(const std::string& column);

}  // namespace palpate
