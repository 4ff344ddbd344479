#pragma once
// Measured against commanded positions of one servo.

#include "devices/drivers/fault.h"
#include "devices/drivers/servo.h"

namespace palpate {

/// A servo lags behind what it is told, by up to a quarter of a second; farther than `bound` from everything that it
/// was told in that time, for 0.1 s, it does not follow. It is blocked if it stands, off its course if it moves.
class FollowingError {
  public:
    static constexpr double lag = 0.125, patience = 0.1;  ///< [s]; commands are remembered for lag to twice that
    /// Begins anew, from where the servo is.
    void start(WireValue position, double now);
    /// What it was told at time `now` [s].
    void told(WireValue value, double now);
    /// Where it was found at `now` [s]; `bound` in wire values, 0: none. Says what is wrong once patience is over.
    FaultKind measured(WireValue position, double bound, double now);

  private:
    void advance(double now);
    WireValue low_[2]{}, high_[2]{}, last_ = no_pulse;  ///< of what it was told in this span and in the one before
    double span_began_ = 0, astray_since_ = -1;
    WireValue astray_from_ = no_pulse;
};

}  // namespace palpate
