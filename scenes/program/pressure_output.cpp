#include "scenes/program/pressure_output.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>

namespace palpate {

MapErrors errors_of(const MapFit& fit) {
    MapErrors e;
    for (const MapComparison& m : fit.maps) {
        if (m.nominal < 0.5 || m.nominal > 7) continue;
        ++e.maps;
        e.middle += std::abs(m.of_simulated.middle / m.of_measured.middle - 1);
        e.peak += std::abs(m.of_simulated.peak / m.of_measured.peak - 1);
    }
    e.middle /= e.maps, e.peak /= e.maps;
    return e;
}

std::string text_of(const MapErrors& e) {
    if (e.maps == 0) return "no map is from 0.5 to 7 N: nothing was compared\n";
    char text[200];
    std::snprintf(text, sizeof text, "mean difference of %d maps from 0.5 to 7 N: ", e.maps);
    std::string said = text;
    if (std::isfinite(e.middle)) {
        std::snprintf(text, sizeof text, "%.0f %% of the middle cells' share, ", 100 * e.middle);
        said += text;
    }
    std::snprintf(text, sizeof text, "%.0f %% of the peak over the mean\n", 100 * e.peak);
    said += text;
    if (!std::isfinite(e.middle))
        said += "(of the middle cells nothing can be said: there are none, or none measured)\n";
    return said;
}

std::string map_picture(const MapFit& fit, const SensorMat& mat) {
    constexpr int cell = 22, gap = 26, top = 60;
    const int wide = mat.columns * cell, high = mat.rows * cell, column = wide + gap;
    std::ostringstream out;
    out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " << 90 + column * int(fit.maps.size()) << " "
        << top + 2 * high + 70 << "\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#111\">\n"
        << "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"10\" y=\"20\" font-size=\"14\">Share of "
           "the "
           "force that each cell bears: a sensor mat under a finger, and the finger simulated</text>\n"
        << "<text x=\"10\" y=\"" << top + high / 2 << "\">measured</text>\n<text x=\"10\" y=\""
        << top + high + gap + high / 2 << "\">simulated</text>\n";
    for (std::size_t k = 0; k < fit.maps.size(); ++k) {
        const MapComparison& m = fit.maps[k];
        const int left = 80 + column * int(k);
        char text[60];
        std::snprintf(text, sizeof text, "%.2f N", m.force);
        out << "<text x=\"" << left << "\" y=\"" << top - 10 << "\">" << text << "</text>\n";
        for (const bool measured : {true, false}) {
            const std::vector<double>& cells = measured ? m.measured : m.simulated;
            double all = 0;
            for (double p : cells) all += p;
            for (int r = 0; r < mat.rows; ++r)
                for (int c = 0; c < mat.columns; ++c) {
                    const double share = cells[std::size_t(r * mat.columns + c)] / std::max(all, 1e-300);
                    const int shade = int(std::lround(255 * (1 - std::min(1.0, share / 0.25))));
                    out << "<rect x=\"" << left + c * cell << "\" y=\"" << top + r * cell + (measured ? 0 : high + gap)
                        << "\" width=\"" << cell << "\" height=\"" << cell << "\" fill=\"rgb(" << shade << "," << shade
                        << "," << shade << ")\" stroke=\"#bbb\"/>\n";
                }
        }
    }
    out << "<text x=\"10\" y=\"" << top + 2 * high + 54 << "\">black: a quarter of the force or more</text>\n</svg>\n";
    return out.str();
}

std::string json_text(const MapFit& fit, double angle_deg, const MapErrors& errors) {
    nlohmann::json maps = nlohmann::json::array();
    for (const MapComparison& m : fit.maps)
        maps.push_back({{"name", m.name},
                        {"nominal_N", m.nominal},
                        {"force_N", m.force},
                        {"middle_measured", m.of_measured.middle},
                        {"middle_simulated", m.of_simulated.middle},
                        {"peak_over_mean_measured", m.of_measured.peak},
                        {"peak_over_mean_simulated", m.of_simulated.peak},
                        {"measured_Pa", m.measured},
                        {"simulated_Pa", m.simulated}});
    const nlohmann::json j{{"angle_deg", angle_deg},
                           {"along_mm", 1e3 * fit.pose.along},
                           {"across_mm", 1e3 * fit.pose.across},
                           {"tip_first", fit.pose.tip_first},
                           {"force_scale", fit.pose.force_scale},
                           {"misfit", fit.pose.misfit},
                           {"maps_compared", errors.maps},
                           {"middle_error", errors.middle},
                           {"peak_error", errors.peak},
                           {"maps", maps}};
    return j.dump(2);
}

}  // namespace palpate
