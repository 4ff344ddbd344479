#pragma once
// What a sweep found: rows of a table that another run reads again, plots, text, JSON.

#include <map>
#include <string>
#include <vector>

#include "scenes/recording/svg.h"
#include "scenes/studies/sweep.h"

namespace palpate {

/// Names of a row's columns, but for those of the settings, which come first.
extern const char* const sweep_columns;
std::string row_of(const SweepPoint& point);
/// Rows by their settings, of which there are `axes`; one that was not finished is left out.
void read_rows(const std::string& text, std::size_t axes, std::map<std::vector<std::string>, SweepPoint>& rows);

/// Error over a time, that of a simulated second or the longest of a step; points below three times the reference's own
/// uncertainty apart.
Plot work_precision(const std::vector<SweepPoint>& points, const SweepPlan& plan, const ReferenceRun& reference,
                    bool of_a_step);
void print_results(const std::vector<SweepPoint>& points, const SweepPlan& plan, const ReferenceRun& reference);

/// All points that are held against one reference.
struct SweptPoints {
    SweepReference kind;
    const ReferenceRun& reference;
    const std::vector<SweepPoint>& points;
};
/// With what they were set to; what is not finite is null.
std::string json_text(const std::vector<SweptPoints>& swept, const SweepPlan& plan);

}  // namespace palpate
