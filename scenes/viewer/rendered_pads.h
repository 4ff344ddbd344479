#pragma once
// What a user's finger undergoes: its pad, simulated again against the thimble's platform (Perez et al. 2017, Fig. 1).

#include <condition_variable>
#include <mutex>
#include <thread>

#include "scenes/studies/compare.h"

namespace palpate {

/// One finger's pad on its platform.
struct RenderedPad {
    std::vector<Point> position;      ///< [node], bone frame [m]
    std::vector<Vec3<double>> force;  ///< [sample], finger frame [N]
    std::vector<char> touches;        ///< [sample]
    double normal_force = 0;          ///< [N]
    bool rendered = false;            ///< false: the thimble waits, without contact
};

/// Pads on platforms of all thimbles of a run, one after the other.
class RenderedPads {
  public:
    explicit RenderedPads(const Simulation& simulation);
    /// Solves every thimble's pad in the configuration that its last match gave.
    const std::vector<RenderedPad>& solve(const Simulation& simulation);
    /// The same where only the configurations are known; `rendered` as RenderedPad has it.
    const std::vector<RenderedPad>& solve(const std::vector<Coordinates>& w, const std::vector<char>& rendered);
    /// A thimble's pad as it was solved last: a world of its own.
    const PadOnPlatform& pad(std::size_t thimble) const { return pads_[thimble]; }

  private:
    std::vector<DeviceModel> models_;
    std::vector<PadOnPlatform> pads_;
    std::vector<RenderedPad> rendered_pads_;
    Threads threads_{1};
};

/// Does it on a thread of low priority, so that a live run waits for nothing: what comes back is a little old.
class RenderedPadsThread {
  public:
    explicit RenderedPadsThread(const Simulation& simulation);
    ~RenderedPadsThread();
    /// Asks for the pads as they are now, and returns the newest that are ready.
    const std::vector<RenderedPad>& ask(const Simulation& simulation);

  private:
    void serve();
    RenderedPads pads_;
    std::vector<RenderedPad> newest_, ready_;
    std::vector<Coordinates> wanted_;
    std::vector<char> rendered_;
    bool asked_ = false, fresh_ = false, ending_ = false;
    std::mutex mutex_;
    std::condition_variable changed_;
    std::thread thread_;
};

}  // namespace palpate
