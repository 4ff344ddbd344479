// Maps of pressure that a sensor mat measured, and the finger that is simulated beside them.

#include "scenes/studies/pressure_maps.h"

#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <numbers>

#include "meshes/input_error.h"
#include "scenes/load/finger_model.h"
#include "scenes/load/section.h"
#include "tests/scenes/named_finger.h"
#include "tests/support.h"

namespace palpate {
namespace {

PressedMaps press(const std::string& name, double most, double angle_deg = 0) {
    Threads threads(2);
    return press_for_maps({testing::built(testing::named(name)), angle_deg * std::numbers::pi / 180, 0, 5e-3}, most,
                          100, threads);
}

TEST(PressureMaps, FiguresAreOfTheMiddleAndThePeak) {
    std::vector<double> cells(16, 1.0);
    EXPECT_NEAR(map_figures(cells, 4, 4).middle, 0.25, 1e-15);
    EXPECT_NEAR(map_figures(cells, 4, 4).peak, 1, 1e-15);
    cells[5] = 5;
    EXPECT_NEAR(map_figures(cells, 4, 4).middle, 8.0 / 20, 1e-15);
    EXPECT_NEAR(map_figures(cells, 4, 4).peak, 16 * 5.0 / 20, 1e-15);
    EXPECT_EQ(map_figures(std::vector<double>(16, 0.0), 4, 4).peak, 0);
    EXPECT_TRUE(std::isnan(map_figures({1, 1, 1, 1}, 2, 2).middle)) << "two by two have none";
}

/// Maps that were made from a finger in a known place, with forces a third lower than they are.
TEST(PressureMaps, AKnownPoseIsFound) {
    const PressedMaps pressed = press("index-median", 8);
    const SensorMat mat;
    for (const bool tip_first : {true, false}) {
        MapPose truth;
        truth.along = 1.5e-3, truth.across = -0.75e-3, truth.tip_first = tip_first;
        std::vector<PressureMap> maps;
        for (const double force : {0.5, 1.0, 2.0, 4.0}) {
            PressureMap m{"made", simulated_map(pressed, force, truth, mat), 0, false};
            for (double& p : m.pressure) p /= 1.5, m.force += p * mat.cell * mat.cell;
            EXPECT_NEAR(m.force, force / 1.5, 1e-9) << "cells bear what the finger bears";
            maps.push_back(m);
        }
        const MapFit fit = fit_maps(pressed, maps, mat);
        EXPECT_EQ(fit.pose.tip_first, tip_first);
        EXPECT_NEAR(fit.pose.along, truth.along, 0.3e-3);
        EXPECT_NEAR(fit.pose.across, truth.across, 0.3e-3);
        EXPECT_NEAR(fit.pose.force_scale, 1.5, 0.2);
        EXPECT_LT(fit.pose.misfit, 0.1);
        for (const MapComparison& m : fit.maps) EXPECT_NEAR(m.of_simulated.middle, m.of_measured.middle, 0.04);
    }
}

TEST(PressureMaps, WhatIsNoMapIsRefused) {
    const std::string path = ::testing::TempDir() + "mat.csv";
    SensorMat mat;
    mat.rows = mat.columns = 2;
    auto message = [&](const std::string& text) -> std::string {
        std::ofstream(path) << text;
        try {
            read_pressure_map(path, mat);
        } catch (const InputError& error) { return error.what(); }
        return "";
    };
    EXPECT_EQ(message("Frame 1\n0,3,B\n255,4,B\n"), "");
    EXPECT_TRUE(read_pressure_map(path, mat).clipped);
    EXPECT_NEAR(read_pressure_map(path, mat).pressure[1], 3 * mat.per_count, 1e-9);
    EXPECT_NE(message("Frame 1\n0,3\nB,4\n").find(":3: column 1: expected a count, 0 or more, found B"),
              std::string::npos);
    EXPECT_NE(message("Frame 1\n0,3\n1\n").find(":3: column 2: expected a count, 0 or more, found nothing"),
              std::string::npos);
    EXPECT_NE(message("Frame 1\n0,-3\n1,2\n").find("found -3"), std::string::npos);
    EXPECT_NE(message("Frame 1\n0,3\n").find("expected rows 1 to 2, found 1 of them"), std::string::npos);
    EXPECT_NE(message("").find("found 0 of them"), std::string::npos);
    EXPECT_THROW(read_pressure_map(path + ".missing", mat), InputError);
}

/// Two people's fingers (S. Andrews 2013), each on a mat that was not calibrated against a balance.
TEST(PressureMaps, PresetsPressAsMeasuredFingersDo) {
    PALPATE_NEED_SHARED_DATA(data);
    const std::filesystem::path folder = data / "pressure_fingers";
    // As meshes/README.md says it, at the angle of some that fits best.
    const std::tuple<const char*, const char*, int, std::vector<double>> people[] = {
        {"index", "index-median", 12, {0, 10, 20, 30}}, {"ring", "ring-median", 17, {0}}};
    for (const auto& [person, finger, column, angles] : people) {
        SensorMat mat;
        mat.first_column = column;
        std::vector<std::filesystem::path> files;
        for (const auto& entry : std::filesystem::directory_iterator(folder / person)) files.push_back(entry.path());
        std::sort(files.begin(), files.end());
        std::vector<PressureMap> maps;
        for (const auto& file : files) maps.push_back(read_pressure_map(file, mat));
        MapFit fit = fit_maps(press(finger, 25, angles[0]), maps, mat);
        for (std::size_t k = 1; k < angles.size(); ++k)
            if (MapFit other = fit_maps(press(finger, 25, angles[k]), maps, mat); other.pose.misfit < fit.pose.misfit)
                fit = std::move(other);
        double middle = 0, peak = 0, count = 0;
        for (const MapComparison& m : fit.maps) {
            if (m.nominal < 0.5 || m.nominal > 7) continue;
            middle += std::abs(m.of_simulated.middle / m.of_measured.middle - 1);
            peak += std::abs(m.of_simulated.peak / m.of_measured.peak - 1);
            ++count;
        }
        EXPECT_GE(count, 6);
        EXPECT_LT(middle / count, 0.15) << person;
        EXPECT_LT(peak / count, 0.15) << person;
    }
}

}  // namespace
}  // namespace palpate
