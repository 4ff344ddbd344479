#include "scenes/recording/svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

constexpr double width = 800, height = 380, left = 74, right = 230, top = 44, bottom = 54;
// Okabe and Ito's colours, told apart with any colour vision; then some of Paul Tol's.
const char* const colours[] = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9",
                               "#000000", "#999999", "#882255", "#44AA99", "#DDCC77"};

/// Step of 1, 2 or 5 times a power of ten that gives about n ticks.
double tick_step(double range, int n) {
    const double raw = range / n, power = std::pow(10, std::floor(std::log10(raw))), m = raw / power;
    return power * (m < 1.5 ? 1 : m < 3.5 ? 2 : m < 7.5 ? 5 : 10);
}

std::string tick_text(double value, double step) {
    char text[32];
    plain_snprintf(text, sizeof text, "%.*f", std::max(0, int(std::ceil(-std::log10(step) - 1e-9))),
                   std::abs(value) < step * 1e-6 ? 0.0 : value);
    return text;
}

struct AxisRange {
    double low = HUGE_VAL, high = -HUGE_VAL;
};

/// Where a value stands on an axis: itself, or its power of ten.
double on_axis(bool log, double v) { return !log ? v : v > 0 ? std::log10(v) : std::nan(""); }

/// Text of a tick: of a decade, its number.
std::string decade_text(double power) { return tick_text(std::pow(10, power), std::pow(10, std::min(power, 0.0))); }

AxisRange range_of(const Plot& plot, bool x) {
    AxisRange r;
    for (const Curve& c : plot.curves)
        for (double number : x ? c.x : c.y)
            if (const double v = on_axis(x ? plot.log_x : plot.log_y, number); std::isfinite(v))
                r.low = std::min(r.low, v), r.high = std::max(r.high, v);
    if (!(r.low <= r.high)) r = {0, 1};
    if (x ? plot.log_x : plot.log_y) return {std::floor(r.low), std::max(std::ceil(r.high), std::floor(r.low) + 1)};
    if (!x && r.low > 0 && r.low < 0.6 * r.high) r.low = 0;
    if (r.high - r.low < 1e-12 * std::max(1.0, std::abs(r.high))) r.high = r.low + 1;
    if (!x) r.high += 0.05 * (r.high - r.low);
    return r;
}

/// What a curve of many points looks like: of each part of its width the first and last point, the lowest and the
/// highest.
Curve thinned(const Curve& c, std::size_t parts) {
    const std::size_t count = std::min(c.x.size(), c.y.size());
    if (c.points || count <= 4 * parts || !std::is_sorted(c.x.begin(), c.x.end())) return c;
    Curve out{c.name, {}, {}};
    for (std::size_t part = 0; part < parts; ++part) {
        const std::size_t begin = part * count / parts, end = (part + 1) * count / parts;
        const auto [low, high] =
            std::minmax_element(c.y.begin() + std::ptrdiff_t(begin), c.y.begin() + std::ptrdiff_t(end));
        std::array<std::size_t, 4> kept{begin, std::size_t(low - c.y.begin()), std::size_t(high - c.y.begin()),
                                        end - 1};
        std::sort(kept.begin(), kept.end());
        for (std::size_t k = 0; k < 4; ++k)
            if (k == 0 || kept[k] != kept[k - 1]) out.x.push_back(c.x[kept[k]]), out.y.push_back(c.y[kept[k]]);
    }
    return out;
}

void draw(PlainText& out, const Plot& plot, double y0) {
    const AxisRange rx = range_of(plot, true), ry = range_of(plot, false);
    auto px = [&](double x) { return left + (x - rx.low) / (rx.high - rx.low) * (width - left - right); };
    auto py = [&](double y) {
        return y0 + height - bottom - (y - ry.low) / (ry.high - ry.low) * (height - top - bottom);
    };
    out << "<text x=\"" << left << "\" y=\"" << y0 + 26 << "\" font-size=\"16\" font-weight=\"bold\">"
        << escaped(plot.title) << "</text>\n";
    const double sx = plot.log_x ? 1 : tick_step(rx.high - rx.low, 7),
                 sy = plot.log_y ? 1 : tick_step(ry.high - ry.low, 6);
    for (double x = std::ceil(rx.low / sx - 1e-9) * sx; x <= rx.high + 1e-9 * sx; x += sx)
        out << "<path d=\"M" << px(x) << " " << py(ry.low) << "V" << py(ry.high) << "\" stroke=\"#e4e4e4\"/><text x=\""
            << px(x) << "\" y=\"" << py(ry.low) + 18 << "\" text-anchor=\"middle\">"
            << (plot.log_x ? decade_text(x) : tick_text(x, sx)) << "</text>\n";
    for (double y = std::ceil(ry.low / sy - 1e-9) * sy; y <= ry.high + 1e-9 * sy; y += sy)
        out << "<path d=\"M" << px(rx.low) << " " << py(y) << "H" << px(rx.high) << "\" stroke=\"#e4e4e4\"/><text x=\""
            << left - 8 << "\" y=\"" << py(y) + 4 << "\" text-anchor=\"end\">"
            << (plot.log_y ? decade_text(y) : tick_text(y, sy)) << "</text>\n";
    out << "<rect x=\"" << left << "\" y=\"" << py(ry.high) << "\" width=\"" << width - left - right << "\" height=\""
        << height - top - bottom << "\" fill=\"none\" stroke=\"#444\"/>\n<text x=\"" << 0.5 * (left + width - right)
        << "\" y=\"" << y0 + height - 14 << "\" text-anchor=\"middle\">" << escaped(plot.x_label)
        << "</text>\n<text transform=\"translate(20," << y0 + 0.5 * (top + height - bottom)
        << ") rotate(-90)\" text-anchor=\"middle\">" << escaped(plot.y_label) << "</text>\n";
    double legend = y0 + top + 8;
    for (std::size_t i = 0; i < plot.curves.size(); ++i) {
        const Curve c = thinned(plot.curves[i], 600);
        const char* colour = colours[i % std::size(colours)];
        const char* dots = c.points ? "\" stroke-width=\"8\" stroke-linecap=\"round" : "\" stroke-width=\"2";
        out << "<path fill=\"none" << dots << "\" stroke=\"" << colour << "\" d=\"";
        bool pen_down = false;
        for (std::size_t k = 0; k < std::min(c.x.size(), c.y.size()); ++k) {
            const double x = on_axis(plot.log_x, c.x[k]), y = on_axis(plot.log_y, c.y[k]);
            const bool good = std::isfinite(x) && std::isfinite(y);
            if (good) out << (pen_down && !c.points ? "L" : "M") << px(x) << " " << py(y) << (c.points ? "h0" : "");
            pen_down = good;
        }
        out << "\"/>\n<path d=\"M" << width - right + (c.points ? 25 : 14) << " " << legend << (c.points ? "h0" : "h22")
            << dots << "\" stroke=\"" << colour << "\"/><text x=\"" << width - right + 42 << "\" y=\"" << legend + 4
            << "\">" << escaped(c.name) << "</text>\n";
        legend += 20;
    }
    for (const Marker& m : plot.markers) {
        const double x = on_axis(plot.log_x, m.x);
        if (!(x >= rx.low && x <= rx.high)) continue;
        out << "<path d=\"M" << px(x) << " " << py(ry.low) << "V" << py(ry.high)
            << "\" stroke=\"#444\" stroke-dasharray=\"5 4\"/><text x=\"" << px(x) - 5 << "\" y=\"" << py(ry.high) + 16
            << "\" text-anchor=\"end\" fill=\"#444\">" << escaped(m.name) << "</text>\n";
    }
}

}  // namespace

std::string escaped(const std::string& text) {
    std::string out;
    for (char c : text)
        out += c == '<' ? "&lt;" : c == '&' ? "&amp;" : c == '>' ? "&gt;" : c == '"' ? "&quot;" : std::string(1, c);
    return out;
}

void write_svg(const std::filesystem::path& path, const std::vector<Plot>& plots) {
    PlainText out;
    out.precision(6);
    const double total = height * double(plots.size());
    out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " << width << " " << total << "\" width=\"" << width
        << "\" height=\"" << total
        << "\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#111\">\n<rect width=\"100%\" height=\"100%\" "
           "fill=\"white\"/>\n";
    for (std::size_t i = 0; i < plots.size(); ++i) draw(out, plots[i], height * double(i));
    out << "</svg>\n";
    write_file(path, out.str());
}

}  // namespace palpate
