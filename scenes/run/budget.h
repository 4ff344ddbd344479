#pragma once
// The most accurate preset and mesh whose steps end in time on this machine.

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace palpate {

/// A preset of the solver, a size of fingers' meshes, and p99 of a step with both, where it has been measured.
struct BudgetPoint {
    std::string preset;
    int elements = 0;       ///< of each finger; 0: as the scene says
    double error = 0;       ///< typical of the field of forces, as a share of it
    double p99_ms = 0;      ///< or, where it is clear sooner that steps take longer, a time that p99 exceeds
    bool exceeded = false;  ///< p99_ms is such a time
    bool cached = false;    ///< of an earlier calibration of the same scene, settings, program, machine and threads
};
/// "balanced", or "balanced with 700 tetrahedra a finger".
std::string name_of(const BudgetPoint& point);

struct BudgetChoice {
    bool found = false;
    BudgetPoint chosen;
    std::vector<BudgetPoint> tried;             ///< in the order in which they were
    std::vector<std::string> settings() const;  ///< overrides that make a scene what was chosen
};

/// All that can be chosen from, most accurate first: presets, with meshes of 400 to 2,800 tetrahedra where `meshes`.
std::vector<BudgetPoint> budget_points(bool meshes);

/// Runs half of the scene, and a second of it at least, with the cheapest preset, and then from the most accurate on
/// with what that lets hope to keep the budget, until one does. Meshes are chosen where all fingers are shapes or
/// presets of whose size nobody says anything. What is measured is kept in $XDG_CACHE_HOME/palpate (or
/// ~/.cache/palpate), one small file per calibration.
BudgetChoice choice_within(double budget_ms, const std::filesystem::path& scene,
                           const std::vector<std::string>& overrides, int threads, const std::atomic<bool>& stop,
                           const std::function<void(double)>& progress = {});

/// The processor's name, for people and for keys.
std::string processor();

}  // namespace palpate
