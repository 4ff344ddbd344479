#pragma once
// Measured maps of pressure under a finger, as sensor mats see it, and the same finger simulated.

#include <filesystem>
#include <string>
#include <vector>

#include "scenes/studies/indentation.h"

namespace palpate {

/// Where on a frame of a sensor mat a finger is, and what its numbers are.
struct SensorMat {
    int first_row = 1, first_column = 1;  ///< as counted in the file, from 1, below the line of the frame's name
    int rows = 4, columns = 4;
    double cell = 3.75e-3;      ///< [m]
    double per_count = 324.46;  ///< [Pa] of one count: 12 psi at 255
    double clipped = 255;       ///< counts that are this or more are no measurement
};

struct PressureMap {
    std::string name;
    std::vector<double> pressure;  ///< [row][column] [Pa]
    double force = 0;              ///< their sum over the cells' area [N]
    bool clipped = false;
};

/// Reads one frame: a line that names it, then rows of numbers, or B where there is no sensor, separated by commas.
/// Throws InputError with file, line, what was expected and what was found.
PressureMap read_pressure_map(const std::filesystem::path& file, const SensorMat& mat);

/// What does not depend on how a mat was calibrated, of cells [row][column].
struct MapFigures {
    double middle = 0;  ///< share of the force that the middle cells bear (a half of the rows and columns); NaN: none
    double peak = 0;    ///< highest cell over the mean of all
};
MapFigures map_figures(const std::vector<double>& cells, int rows, int columns);

/// How a finger lay on the mat, fitted to all maps of one person.
struct MapPose {
    double along = 0, across = 0;  ///< of the mat's middle from the bone's origin, distal and radial [m]
    bool tip_first = true;         ///< the first row is that of the tip
    double force_scale = 1;        ///< true forces over the mat's
    double misfit = 0;  ///< root of the mean square of differences of the cells' shares, over a cell's mean share
};

struct MapComparison {
    std::string name;
    double nominal = 0, force = 0;            ///< the mat's, and times the scale [N]
    std::vector<double> measured, simulated;  ///< [row][column] [Pa], of the same force
    MapFigures of_measured, of_simulated;
};

struct MapFit {
    MapPose pose;
    std::vector<MapComparison> maps;
};

/// A finger's pressure on a plate at rising forces, for any place of the mat.
struct PressedMaps {
    std::vector<double> force;  ///< [level] [N], rising
    /// [level] sums of force over all cells of a raster before (row, column), 0.25 mm each, 24 mm to each side of the
    /// bone's origin: distal, radial.
    std::vector<std::vector<double>> sums;
};
PressedMaps press_for_maps(const Indentation& finger, double force_limit, int steps, Threads& threads);

/// Cells that bear the given force [Pa], rows by columns.
std::vector<double> simulated_map(const PressedMaps& pressed, double force, const MapPose& pose, const SensorMat& mat);

/// Fits place, direction and scale of forces to those maps that are neither clipped nor empty, by their cells' shares;
/// of scales that fit alike, the one nearer to 1.
MapFit fit_maps(const PressedMaps& pressed, const std::vector<PressureMap>& maps, const SensorMat& mat);

}  // namespace palpate
