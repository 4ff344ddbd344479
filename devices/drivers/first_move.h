#pragma once
// The first move of one servo after arming, while its controller's own speed limit is low.

#include "devices/drivers/servo.h"

namespace palpate {

/// How far a servo may have to go to `value` from where it was told to be; its whole range where nobody knows where it
/// was [wire values].
double longest_travel(const Told& before, WireValue value, const WireLimits& limits);

/// It is over once the servo has been told what is wanted, or what is wanted has passed it on its way there, and has
/// arrived: as measured, and after the time that its way takes at the controller's own limit.
class FirstMove {
  public:
    /// It was told to go as far as `way` [wire values] at `now` [s], and is taken there at about `speed` [wire values
    /// per second; 0: at once].
    void told(double travel, double speed, double now);
    struct Place {
        WireValue wanted, sent, measured;  ///< `sent`: surely arrived; no_pulse: nobody knows
        double bound;  ///< on what lies between sent and measured [wire values]; 0: it is not measured
    };
    bool caught_up(const Place& place, double now);

  private:
    int side_ = 0;  ///< of what is wanted, seen from where it was told to be; 0: nothing seen yet
    bool met_ = false, over_ = false;
    double there_at_ = 0;  ///< no earlier than this is it where it was told to be [s]
};

}  // namespace palpate
