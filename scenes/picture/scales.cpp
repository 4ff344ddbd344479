#include "scenes/picture/scales.h"

#include <algorithm>
#include <cmath>

#include "scenes/picture/scene_triangles.h"

namespace palpate {

namespace {

constexpr double least = 1000;  // [Pa]

double end_of(std::vector<double> peaks) {
    std::erase_if(peaks, [](double p) { return !(p > least); });
    if (peaks.empty()) return least;
    std::sort(peaks.begin(), peaks.end());
    return round_up(peaks[std::size_t(0.95 * double(peaks.size() - 1))]);
}

}  // namespace

double round_up(double x) {
    if (!(x > 0)) return 1;
    const double power = std::pow(10, std::floor(std::log10(x))), m = x / power;
    for (const double step : {1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0})
        if (m <= step * (1 + 1e-6)) return power * step;
    return 10 * power;
}

void PressureScales::record(const Simulation& s) {
    if (s.world.time + 1e-9 < next_) return;
    next_ = s.world.time + 1 / rate_;
    peaks_.resize(s.fingers.size());
    for (std::size_t k = 0; k < s.fingers.size(); ++k) {
        const std::vector<double> p = node_pressures(s.world, s.fingers[k]);
        if (!p.empty()) peaks_[k].push_back(*std::max_element(p.begin(), p.end()));
    }
}

double PressureScales::most() const {
    std::vector<double> all;
    for (const auto& of_finger : peaks_) all.insert(all.end(), of_finger.begin(), of_finger.end());
    return end_of(std::move(all));
}

double PressureScales::most(std::size_t finger) const {
    return finger < peaks_.size() ? end_of(peaks_[finger]) : least;
}

PictureScales scales_of(const Simulation& s, const PressureScales* recorded) {
    PictureScales out;
    if (s.scene.scale_pressure > 0) {
        out.most = s.scene.scale_pressure;
        out.pads.assign(s.fingers.size(), out.most);
    } else if (recorded) {
        out.most = recorded->most();
        for (std::size_t k = 0; k < s.fingers.size(); ++k) out.pads.push_back(recorded->most(k));
    }
    return out;
}

}  // namespace palpate
