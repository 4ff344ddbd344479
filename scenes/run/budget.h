#pragma once
// The most accurate preset whose steps end in time on this machine.

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

namespace palpate {

/// p99 of a step by preset, where it has been measured.
struct PresetTime {
    std::string preset;
    double p99_ms = 0;
    bool cached = false;  ///< of an earlier calibration of the same scene, settings, program, machine and threads
};
struct BudgetChoice {
    std::string preset;             ///< empty: none keeps the budget
    std::vector<PresetTime> tried;  ///< most accurate first
};

/// Runs half of the scene, and a second of it at least, with each preset from the most accurate on until one keeps the
/// budget. What that measures is kept in $XDG_CACHE_HOME/palpate (or ~/.cache/palpate), one small file per calibration.
BudgetChoice preset_within(double budget_ms, const std::filesystem::path& scene,
                           const std::vector<std::string>& overrides, int threads, const std::atomic<bool>& stop,
                           const std::function<void(double)>& progress = {});

/// The processor's name, for people and for keys.
std::string processor();

}  // namespace palpate
