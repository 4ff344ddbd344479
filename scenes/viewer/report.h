#pragma once
// A run as one self-contained HTML file: 3-D playback, plots, summary and scene.

#include <cstdint>
#include <filesystem>
#include <vector>

#include "scenes/run/summary.h"
#include "scenes/viewer/page_model.h"

namespace palpate {

/// Collects frames of a run, `rate` per simulated second where steps are no longer than that. Browsers open no page of
/// gigabytes: frames that come to more than `most_bytes` are thinned to every second one, and the rate is halved.
class ReportRecorder {
  public:
    explicit ReportRecorder(double rate = 30, std::size_t most_bytes = 64'000'000)
        : rate_(rate), most_bytes_(most_bytes) {}
    /// Call after every step.
    void record(const Simulation& simulation);
    /// The page of all frames so far.
    std::string page(const Simulation& simulation, const Summary& summary, const PictureScales& scales = {}) const;
    /// Throws InputError where the file cannot be written.
    void write(const std::filesystem::path& path, const Simulation& simulation, const Summary& summary,
               const PictureScales& scales = {}) const;

  private:
    void thin(double steps_per_second);
    double rate_, next_ = 0;
    std::size_t most_bytes_;
    SinceFrame since_;
    std::vector<std::uint8_t> frames_;
    std::vector<std::size_t> ends_;  ///< of each frame
    std::size_t fingers_ = 0;
    std::unique_ptr<RenderedPads> rendered_pads_;
    std::unique_ptr<DrawnHands> hands_;
};

/// The page with its data filled in.
std::string page_with(const nlohmann::json& data);

}  // namespace palpate
