#pragma once
// A recorded run, run again from what went in.

#include <functional>
#include <memory>

#include "scenes/recording/run_file.h"

namespace palpate {

/// Where a run came out otherwise, for the first time.
struct Difference {
    std::size_t step;    ///< row
    std::string array;   ///< its name
    double force_N = 0;  ///< largest difference of a contact force in that step
};

struct Replay {
    std::unique_ptr<Simulation> simulation;  ///< as it is in the end
    std::size_t steps = 0;                   ///< run; fewer than recorded where bytes between them are damaged
    std::optional<Difference> difference;
};

/// Runs it until its end, the first gap, or `stop`; calls after_step after each step. Throws InputError where the scene
/// is not what it was.
Replay replay_run(const RecordedRun& run, const std::filesystem::path& file, int threads, const std::atomic<bool>& stop,
                  const std::function<void(const Simulation&)>& after_step);

/// Prints what is missing in a recording. Returns whether anything is.
bool report_losses(const Recording& recording, const std::filesystem::path& file);

/// Folder (or file name) of one of several runs; `base` itself where there is one.
std::filesystem::path folder_of_run(const std::filesystem::path& base, const Recording& recording, std::size_t run);

}  // namespace palpate
