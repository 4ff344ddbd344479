#pragma once
// Where the colour scales of a run end: as its scene fixes them, or where 19 of 20 moments with contact have their
// peak, so that single spikes do not wash out the rest. Pictures and reports of a run share them.

#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

/// A number that reads well, not below x: 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten.
double round_up(double x);

/// Peaks of pressure over a run, of each finger.
class PressureScales {
  public:
    explicit PressureScales(double rate = 30) : rate_(rate) {}
    /// Call after every step; it looks at most `rate` times per simulated second.
    void record(const Simulation& simulation);
    /// End of the scale of all fingers together, and of one's own pad [Pa]; not below 1 kPa.
    double most() const;
    double most(std::size_t finger) const;

  private:
    double rate_, next_ = 0;
    std::vector<std::vector<double>> peaks_;  ///< per finger [Pa]
};

/// Of those fixed by the scene, or recorded; 0: neither, a picture of its own.
struct PictureScales {
    double most = 0;           ///< [Pa]
    std::vector<double> pads;  ///< per finger [Pa]
};
PictureScales scales_of(const Simulation& simulation, const PressureScales* recorded);

}  // namespace palpate
