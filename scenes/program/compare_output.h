#pragma once
// What a comparison of methods and kinds of device found: series, plots, tables, JSON.

#include <string>
#include <vector>

#include "scenes/recording/svg.h"
#include "scenes/studies/compare.h"

namespace palpate {

extern const std::vector<std::string> method_names;  ///< in the order of MatchingMethod

/// One run of the scene: one kind of device, several methods.
struct Comparison {
    std::string kind;  ///< empty: as the scene has it
    std::vector<MatchingMethod> methods;
    std::vector<std::string> fingers;
    std::vector<std::vector<ComparedStep>> steps;  ///< per finger
    bool interrupted = false;                      ///< steps are those until then
};

struct Distribution {
    double mean = 0, p95 = 0, most = 0;
};

/// What came of one method with one finger.
struct MethodFigures {
    Distribution field;
    double wanted_N = 0, normal_N = 0, shear_N = 0, net_N = 0, torque_Nmm = 0, area_mm2 = 0, centre_mm = 0,
           median_us = 0;
    int unconverged = 0, least_squares = 0;
};

MethodFigures figures_of(const std::vector<ComparedStep>& steps, std::size_t method);
/// On average [N].
double wanted_shear(const std::vector<ComparedStep>& steps);

Series to_series(const Comparison& comparison, std::size_t finger);
/// Of a finger, for each error that is drawn; over roll where the finger rolls by more than five degrees, over time
/// elsewhere.
std::vector<Plot> error_plots(const std::vector<Comparison>& comparisons, std::size_t finger);
/// Within 80 columns: errors of forces, then the others.
void print_table(const Comparison& comparison, std::size_t finger);
std::string json_text(const std::vector<Comparison>& comparisons);

}  // namespace palpate
