#pragma once
// Line plots as SVG: axes with units, ticks, legend.

#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

struct Curve {
    std::string name;
    std::vector<double> x, y;
    bool points = false;  ///< dots rather than a line
};
struct Marker {
    std::string name;
    double x;  ///< a vertical line
};

struct Plot {
    std::string title, x_label, y_label;
    std::vector<Curve> curves;
    std::vector<Marker> markers;
    bool log_y = false;  ///< decades; values that are not positive are left out
    bool log_x = false;
};

/// Text for XML, also between double quotes.
std::string escaped(const std::string& text);

/// Throws InputError where the file cannot be written.
void write_svg(const std::filesystem::path& path, const std::vector<Plot>& plots);

}  // namespace palpate
