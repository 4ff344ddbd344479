#pragma once
// How far a finger is off measured maps of pressure, as numbers, text, JSON and a picture.

#include <string>

#include "scenes/studies/pressure_maps.h"

namespace palpate {

/// Of those that are compared: between a half and seven newtons. NaN where nothing was, or has no middle cells.
struct MapErrors {
    double middle = 0, peak = 0;
    int maps = 0;
};

MapErrors errors_of(const MapFit& fit);

std::string text_of(const MapErrors& errors);
std::string json_text(const MapFit& fit, double angle_deg, const MapErrors& errors);
/// Measured and simulated cells side by side, as grey as they are pressed (SVG).
std::string map_picture(const MapFit& fit, const SensorMat& mat);

}  // namespace palpate
