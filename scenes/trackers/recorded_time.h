#pragma once
// Times of frames that are recorded: the tracker's own, for what arrives in bursts was not seen in bursts.

#include <array>
#include <optional>

namespace palpate {

class RecordedTime {
  public:
    /// When a frame of a hand was seen, by the clock that tells arrivals; never before the one that came before it.
    /// `arrival` [s]; `own`: the tracker's time [s], if it has one.
    double of(int hand, double arrival, std::optional<double> own);

  private:
    struct Hand {
        std::optional<double> ahead;  ///< of arrivals, before the tracker's clock
        double last = 0;
    };
    std::array<Hand, 2> hands_;
};

}  // namespace palpate
