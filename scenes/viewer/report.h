#pragma once
// A run as one self-contained HTML file: 3-D playback, plots, summary and scene.

#include <filesystem>

#include "scenes/run/summary.h"
#include "scenes/viewer/page_model.h"

namespace palpate {

/// Collects frames of a run, `rate` per simulated second where steps are no longer than that.
class ReportRecorder {
  public:
    explicit ReportRecorder(double rate = 30) : rate_(rate) {}
    /// Call after every step.
    void record(const Simulation& simulation);
    /// The page of all frames so far.
    std::string page(const Simulation& simulation, const Summary& summary, const PictureScales& scales = {}) const;
    /// Throws InputError where the file cannot be written.
    void write(const std::filesystem::path& path, const Simulation& simulation, const Summary& summary,
               const PictureScales& scales = {}) const;

  private:
    double rate_, next_ = 0;
    SinceFrame since_;
    std::vector<std::uint8_t> frames_;
    std::unique_ptr<RenderedPads> rendered_pads_;
    std::unique_ptr<DrawnHands> hands_;
    int count_ = 0;
};

/// The page with its data filled in.
std::string page_with(const nlohmann::json& data);

}  // namespace palpate
