#pragma once
// The pictures of Perez et al. 2017 (its Figs. 1, 5 and 6), from the scenes that come with it: what a finger touches,
// and beside it what its thimble makes the finger feel.

#include <atomic>
#include <filesystem>
#include <functional>
#include <vector>

namespace palpate {

/// Writes paper-fig1.png, paper-fig5.png and paper-fig6.png into a folder that exists; `show` is told how far it is.
/// Returns the files; none where it was stopped.
std::vector<std::filesystem::path> paint_paper_figures(const std::filesystem::path& folder, int threads,
                                                       const std::atomic<bool>& stop,
                                                       const std::function<void(double)>& show);

}  // namespace palpate
