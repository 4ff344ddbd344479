#pragma once
// What a fit found: a picture beside the data, lines of text, JSON.

#include <filesystem>
#include <string>
#include <vector>

#include "scenes/studies/calibration.h"

namespace palpate {

void draw_fit(const std::filesystem::path& path, const Calibration& c, const std::vector<MeasuredCurve>& data);
std::vector<std::string> fit_report(const Calibration& c);
std::string json_text(const Calibration& c, bool interrupted);

}  // namespace palpate
