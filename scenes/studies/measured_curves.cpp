#include "scenes/studies/measured_curves.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include "devices/device.h"
#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

enum class Quantity { force, displacement, area, angle };
struct Column {
    const char* name;
    Quantity quantity;
    double factor;  ///< to SI
};
constexpr Column known_columns[] = {
    {"force_N", Quantity::force, 1},
    {"force_mN", Quantity::force, 1e-3},
    {"force_gf", Quantity::force, 9.80665e-3},
    {"displacement_mm", Quantity::displacement, 1e-3},
    {"displacement_um", Quantity::displacement, 1e-6},
    {"displacement_m", Quantity::displacement, 1},
    {"area_mm2", Quantity::area, 1e-6},
    {"area_cm2", Quantity::area, 1e-4},
    {"area_m2", Quantity::area, 1},
    {"angle_deg", Quantity::angle, degree},
    {"angle_rad", Quantity::angle, 1},
};

std::vector<std::string> split(const std::string& line) {
    std::vector<std::string> cells;
    std::stringstream in(line);
    for (std::string cell; std::getline(in, cell, ',');) {
        const auto first = cell.find_first_not_of(" \t\r\""), last = cell.find_last_not_of(" \t\r\"");
        cells.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
    }
    if (!line.empty() && line.back() == ',') cells.emplace_back();
    return cells;
}

struct Reader {
    std::string file;
    std::vector<std::string> problems;
    std::vector<int> quantity_of;         ///< per column: index into known_columns, -1 where unknown
    int column_of[4] = {-1, -1, -1, -1};  ///< per quantity

    void complain(int line, const std::string& message) {
        if (problems.size() == 20) problems.push_back(file + ": further problems are not listed");
        if (problems.size() < 20) problems.push_back(file + ":" + std::to_string(line) + ": " + message);
    }
    bool has(Quantity q) const { return column_of[int(q)] >= 0; }

    void read_header(int line, const std::vector<std::string>& cells) {
        for (std::size_t c = 0; c < cells.size(); ++c) {
            int found = -1;
            for (int k = 0; k < int(std::size(known_columns)); ++k)
                if (cells[c] == known_columns[k].name) found = k;
            quantity_of.push_back(found);
            if (found < 0) continue;  // a table may say more than is needed
            int& column = column_of[int(known_columns[found].quantity)];
            if (column >= 0) complain(line, "column '" + cells[c] + "' gives again what another column gives");
            column = int(c);
        }
        std::string names;
        for (const Column& k : known_columns) names += (names.empty() ? "" : ", ") + std::string(k.name);
        if (!has(Quantity::force)) complain(line, "no column of forces; columns that are known: " + names);
        if (!has(Quantity::displacement) && !has(Quantity::area))
            complain(line, "neither displacements nor areas; columns that are known: " + names);
    }

    /// A cell in SI units; NaN where its column is absent or the cell is empty.
    double value(int line, const std::vector<std::string>& cells, Quantity q) {
        const double nothing = std::numeric_limits<double>::quiet_NaN();
        const int c = column_of[int(q)];
        if (c < 0 || (cells[std::size_t(c)].empty() && q != Quantity::force)) return nothing;
        const Column& column = known_columns[quantity_of[std::size_t(c)]];
        const std::string& cell = cells[std::size_t(c)];
        char* end = nullptr;
        const double v = plain_strtod(cell.c_str(), &end);
        if (cell.empty() || *end || !std::isfinite(v)) {
            complain(line, std::string(column.name) + ": expected a number, found '" + cell + "'");
            return nothing;
        }
        if (v < 0 && q != Quantity::angle)
            complain(line, std::string(column.name) + ": expected at least 0, found " + cell);
        return v * column.factor;
    }
};

/// Values that no fingertip can have are mostly a matter of units.
void check_plausible(Reader& r, int line, double force, double displacement, double area) {
    auto suspect = [&](Quantity q, double most, const char* says) {
        const double v = q == Quantity::force ? force : q == Quantity::displacement ? displacement : area;
        if (v > most) {
            const Column& c = known_columns[r.quantity_of[std::size_t(r.column_of[int(q)])]];
            char text[160];
            plain_snprintf(text, sizeof text, "%s: %g is more than any fingertip: %s?", c.name, v / c.factor, says);
            r.complain(line, text);
        }
    };
    suspect(Quantity::force, 100, "is the column in grams-force (force_gf) or millinewtons (force_mN)");
    suspect(Quantity::displacement, 0.012, "is the column in micrometres (displacement_um), or not from first touch");
    suspect(Quantity::area, 1.5e-3, "is the column in other units (area_mm2, area_cm2, area_m2)");
}

void check_largest(Reader& r, const std::vector<MeasuredCurve>& curves, int line) {
    double force = 0, displacement = 0, area = 0;
    for (const MeasuredCurve& c : curves)
        for (const MeasuredPoint& p : c.points) {
            force = std::max(force, p.force);
            if (std::isfinite(p.displacement)) displacement = std::max(displacement, p.displacement);
            if (std::isfinite(p.area)) area = std::max(area, p.area);
        }
    auto suspect = [&](bool wrong, Quantity q, const char* says) {
        if (wrong && r.has(q))
            r.complain(line, std::string(known_columns[r.quantity_of[std::size_t(r.column_of[int(q)])]].name) +
                                 ": the largest value is too small for a fingertip that is pressed: " + says);
    };
    suspect(force < 0.02, Quantity::force, "is the column in newtons (force_N)?");
    suspect(displacement < 5e-5, Quantity::displacement,
            "is the column in millimetres (displacement_mm) or metres (displacement_m)?");
    suspect(area < 2e-6, Quantity::area, "is the column in square centimetres (area_cm2) or metres (area_m2)?");
}

}  // namespace

std::vector<MeasuredCurve> read_measured_curves(const std::filesystem::path& path) {
    std::ifstream in(path);
    if (!in || !std::filesystem::is_regular_file(path)) throw InputError(path.string() + ": no such file");
    skip_byte_order_mark(in);
    Reader r{path.string(), {}, {}};
    std::vector<MeasuredCurve> curves;
    std::vector<std::vector<int>> lines;
    std::string text;
    int number = 0, header = 0;
    while (std::getline(in, text)) {
        ++number;
        if (text.size() > 100000)
            throw InputError(r.file + ":" + std::to_string(number) + ": a line of this length is no table");
        if (text.find_first_not_of(" \t\r") == std::string::npos || text[0] == '#') continue;
        const auto cells = split(text);
        if (!header) {
            r.read_header(header = number, cells);
            if (!r.problems.empty()) throw InputError(r.problems);
            continue;
        }
        if (cells.size() != r.quantity_of.size()) {
            r.complain(number, "expected " + std::to_string(r.quantity_of.size()) + " cells as in the header, found " +
                                   std::to_string(cells.size()));
            continue;
        }
        const double angle = r.has(Quantity::angle) ? r.value(number, cells, Quantity::angle) : 0;
        const MeasuredPoint p{r.value(number, cells, Quantity::displacement), r.value(number, cells, Quantity::force),
                              r.value(number, cells, Quantity::area)};
        if (std::abs(angle) > 1.6) r.complain(number, "angles are between -90 and 90 degrees");
        check_plausible(r, number, p.force, p.displacement, p.area);
        auto it = std::find_if(curves.begin(), curves.end(), [&](auto& c) { return c.angle == angle; });
        if (it == curves.end()) {
            curves.push_back({angle, {}});
            lines.emplace_back();
            it = std::prev(curves.end());
        }
        auto& own = lines[std::size_t(it - curves.begin())];
        if (!it->points.empty()) {
            // Forces may waver with noise; what was set, the displacement, may not.
            const MeasuredPoint& last = it->points.back();
            const bool by_force = !std::isfinite(p.displacement);
            const double now = by_force ? p.force : p.displacement, before = by_force ? last.force : last.displacement;
            const std::string what = by_force ? "the force" : "the displacement";
            if (now == before)
                r.complain(number, what + " of line " + std::to_string(own.back()) + " is repeated");
            else if (now < before)
                r.complain(number, what + " is smaller than in line " + std::to_string(own.back()) +
                                       ": rows of one press must rise (one loading, sorted)");
        }
        it->points.push_back(p);
        own.push_back(number);
    }
    if (!header) throw InputError(r.file + ": the file is empty");
    for (std::size_t c = 0; c < curves.size(); ++c)
        if (curves[c].points.size() < 5) {
            char what[120];
            plain_snprintf(what, sizeof what, "the press at %g degrees has %zu rows; at least 5 are needed",
                           curves[c].angle / degree, curves[c].points.size());
            r.complain(lines[c].front(), what);
        }
    if (curves.empty()) r.complain(header, "no row follows the header");
    if (r.problems.empty()) check_largest(r, curves, header);
    if (!r.problems.empty()) throw InputError(r.problems);
    return curves;
}

}  // namespace palpate
