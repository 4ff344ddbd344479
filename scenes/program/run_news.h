#pragma once
// What `palpate run` says: of the scene before it, of hands and thimbles during it, of its results after it.

#include <filesystem>

#include "scenes/program/progress.h"
#include "scenes/program/run_arguments.h"
#include "scenes/recording/results_folder.h"
#include "scenes/run/dead_man.h"
#include "scenes/run/summary.h"
#include "scenes/trackers/hand_doubts.h"

namespace palpate {

void tell_of_scene(const RunArguments& a, const Scene& scene);
void tell_news(DeadMan& dead_man, Progress& progress);
/// What is likely wrong with the hands that come, once each.
void tell_doubts(DoubtTeller& doubts, const Simulation& simulation, Progress& progress);
/// What thimbles went through, and where they are now: whatever becomes of the results. False: of some nobody knows
/// that they are in their rest pose (a fault that latched, a board that is gone).
bool tell_of_thimbles(const RunArguments& a, const Simulation& simulation, const DeadMan* dead_man, bool stopped);
/// What was felt, and which files hold it now.
void tell_results(const RunArguments& a, const Summary& summary, const ResultsFolder& results,
                  const std::filesystem::path& folder, const std::vector<std::string>& replaced);

}  // namespace palpate
