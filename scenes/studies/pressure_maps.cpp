#include "scenes/studies/pressure_maps.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>

#include "meshes/byte_order_mark.h"
#include "meshes/input_error.h"
#include "scenes/run/pressure_points.h"

namespace palpate {

namespace {

constexpr double bin = 0.25e-3, half_width = 24e-3;
constexpr int bins = int(2 * half_width / bin + 0.5);

std::vector<std::string> cells_of(const std::string& line) {
    std::vector<std::string> out(1);
    for (char c : line) {
        if (c == ',')
            out.emplace_back();
        else if (c != ' ' && c != '\r')
            out.back() += c;
    }
    return out;
}

double sum_before(const std::vector<double>& sums, double along, double across) {
    const auto at = [](double x) { return std::clamp(int(std::lround((x + half_width) / bin)), 0, bins); };
    return sums[std::size_t(at(along) * (bins + 1) + at(across))];
}

/// Shares of the force, rows by columns.
void shares(const PressedMaps& p, double force, const MapPose& pose, const SensorMat& mat, std::vector<double>& out) {
    out.assign(std::size_t(mat.rows * mat.columns), 0.0);
    const auto above = std::upper_bound(p.force.begin(), p.force.end(), force) - p.force.begin();
    const auto high = std::size_t(std::clamp<std::ptrdiff_t>(above, 1, std::ptrdiff_t(p.force.size()) - 1));
    const double t = std::clamp((force - p.force[high - 1]) / (p.force[high] - p.force[high - 1]), 0.0, 1.0);
    double all = 0;
    for (int r = 0; r < mat.rows; ++r)
        for (int c = 0; c < mat.columns; ++c) {
            const double row = r - 0.5 * mat.rows, column = c - 0.5 * mat.columns;
            // The first row is the most distal one, or the least.
            const double low_x = pose.along + mat.cell * (pose.tip_first ? -(row + 1) : row);
            const double low_y = pose.across + mat.cell * column;
            double sum = 0;
            for (const auto& [level, weight] : {std::pair{high - 1, 1 - t}, std::pair{high, t}}) {
                const std::vector<double>& s = p.sums[level];
                sum += weight *
                       (sum_before(s, low_x + mat.cell, low_y + mat.cell) - sum_before(s, low_x, low_y + mat.cell) -
                        sum_before(s, low_x + mat.cell, low_y) + sum_before(s, low_x, low_y));
            }
            out[std::size_t(r * mat.columns + c)] = sum;
            all += sum;
        }
    if (all > 0)
        for (double& s : out) s /= all;
}

}  // namespace

PressureMap read_pressure_map(const std::filesystem::path& file, const SensorMat& mat) {
    std::ifstream in(file);
    if (!in) throw InputError(file.string() + ": no such file, or it cannot be read");
    skip_byte_order_mark(in);
    PressureMap out{file.stem().string(), {}, 0, false};
    std::string line;
    for (int row = 0; std::getline(in, line); ++row) {
        if (row < mat.first_row || row >= mat.first_row + mat.rows) continue;
        const std::vector<std::string> cells = cells_of(line);
        for (int c = mat.first_column; c < mat.first_column + mat.columns; ++c) {
            const std::string found = c <= int(cells.size()) ? cells[std::size_t(c - 1)] : "nothing";
            double count = 0;
            const auto end = std::from_chars(found.data(), found.data() + found.size(), count);
            if (end.ec != std::errc() || end.ptr != found.data() + found.size() || !(count >= 0))
                throw InputError(file.string() + ":" + std::to_string(row + 1) + ": column " + std::to_string(c) +
                                 ": expected a count, 0 or more, found " + found);
            out.pressure.push_back(count * mat.per_count);
            out.clipped |= count >= mat.clipped;
            out.force += out.pressure.back() * mat.cell * mat.cell;
        }
    }
    const int wanted = mat.rows * mat.columns;
    if (int(out.pressure.size()) != wanted)
        throw InputError(file.string() + ": expected rows " + std::to_string(mat.first_row) + " to " +
                         std::to_string(mat.first_row + mat.rows - 1) + ", found " +
                         std::to_string(int(out.pressure.size()) / mat.columns) + " of them");
    return out;
}

MapFigures map_figures(const std::vector<double>& cells, int rows, int columns) {
    MapFigures f;
    double all = 0, middle = 0, peak = 0;
    bool has_middle = false;
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c) {
            const double p = cells[std::size_t(r * columns + c)];
            const bool within =
                4 * r >= rows && 4 * (r + 1) <= 3 * rows && 4 * c >= columns && 4 * (c + 1) <= 3 * columns;
            all += p;
            if (within) middle += p, has_middle = true;
            peak = std::max(peak, p);
        }
    if (all > 0) f = {middle / all, peak * rows * columns / all};
    if (!has_middle) f.middle = NAN;
    return f;
}

PressedMaps press_for_maps(const Indentation& finger, double force_limit, int steps, Threads& threads) {
    PressedMaps out;
    IndentationSettings settings{.steps = steps, .force_limit = force_limit};
    settings.observe = [&](std::size_t, const IndentationPoint& point, const ContactSurface& contact) {
        if (!(point.force > (out.force.empty() ? 0 : out.force.back()))) return;
        std::vector<double> force(std::size_t(bins * bins), 0.0);
        const Mat3<double> turn = rotation_matrix(contact.bone.rotation);
        for (const PressurePoint& p : pressure_points(pressed_pad(contact))) {
            const Vec3<double> arm = turn * p.place, push = turn * p.force;
            const int x = int(std::floor((arm.x + half_width) / bin)), y = int(std::floor((arm.y + half_width) / bin));
            if (x >= 0 && y >= 0 && x < bins && y < bins) force[std::size_t(x * bins + y)] += push.z;
        }
        std::vector<double> sums(std::size_t((bins + 1) * (bins + 1)), 0.0);
        for (int x = 0; x < bins; ++x)
            for (int y = 0; y < bins; ++y) {
                const auto at = [&](int i, int k) { return std::size_t(i * (bins + 1) + k); };
                sums[at(x + 1, y + 1)] =
                    force[std::size_t(x * bins + y)] + sums[at(x, y + 1)] + sums[at(x + 1, y)] - sums[at(x, y)];
            }
        out.force.push_back(point.force);
        out.sums.push_back(std::move(sums));
    };
    indent({finger}, settings, threads);
    return out;
}

std::vector<double> simulated_map(const PressedMaps& pressed, double force, const MapPose& pose, const SensorMat& mat) {
    std::vector<double> cells;
    shares(pressed, force, pose, mat, cells);
    for (double& c : cells) c *= force / (mat.cell * mat.cell);
    return cells;
}

MapFit fit_maps(const PressedMaps& pressed, const std::vector<PressureMap>& maps, const SensorMat& mat) {
    const int cells = mat.rows * mat.columns;
    std::vector<const PressureMap*> used;
    for (const PressureMap& m : maps)
        if (!m.clipped && m.force > 0) used.push_back(&m);
    MapFit fit;
    if (used.empty() || pressed.force.size() < 2) return fit;
    std::vector<double> found;
    const auto misfit = [&](const MapPose& pose) {
        double sum = 0;
        for (const PressureMap* m : used) {
            shares(pressed, pose.force_scale * m->force, pose, mat, found);
            for (std::size_t c = 0; c < found.size(); ++c) {
                const double difference = found[c] - m->pressure[c] * mat.cell * mat.cell / m->force;
                sum += difference * difference;
            }
        }
        return cells * std::sqrt(sum / (double(used.size()) * cells));
    };
    // Scales of force change little in shares: of those that fit alike the one nearer to 1.
    constexpr double towards_one = 0.03;
    const auto cost = [](const MapPose& pose) {
        const double scale = std::log(pose.force_scale);
        return pose.misfit * pose.misfit + towards_one * scale * scale;
    };
    fit.pose.misfit = HUGE_VAL;
    const auto search = [&](const MapPose& around, double reach, double step, double scale_reach, double scale_step) {
        MapPose best = fit.pose;
        for (double x = -reach; x <= reach + 1e-9; x += step)
            for (double y = -reach; y <= reach + 1e-9; y += step)
                for (double s = -scale_reach; s <= scale_reach + 1e-9; s += scale_step) {
                    MapPose pose = around;
                    pose.along += x, pose.across += y, pose.force_scale *= std::exp(s);
                    if (pose.force_scale < 0.4 || pose.force_scale > 3) continue;
                    pose.misfit = misfit(pose);
                    if (cost(pose) < cost(best)) best = pose;
                }
        fit.pose = best;
    };
    for (const bool tip_first : {true, false}) {
        MapPose start;
        start.tip_first = tip_first;
        search(start, 12e-3, 1.5e-3, 0.9, 0.3);
    }
    search(fit.pose, 1.5e-3, 0.5e-3, 0.3, 0.1);
    search(fit.pose, 0.5e-3, 0.25e-3, 0.1, 0.05);
    for (const PressureMap& m : maps) {
        if (!(m.force > 0)) continue;
        MapComparison c{m.name, m.force, fit.pose.force_scale * m.force, m.pressure, {}, {}, {}};
        for (double& p : c.measured) p *= fit.pose.force_scale;
        c.simulated = simulated_map(pressed, c.force, fit.pose, mat);
        c.of_measured = map_figures(c.measured, mat.rows, mat.columns);
        c.of_simulated = map_figures(c.simulated, mat.rows, mat.columns);
        fit.maps.push_back(std::move(c));
    }
    return fit;
}

}  // namespace palpate
