#pragma once
// What speaks to a servo controller.

#include <vector>

#include "devices/device.h"

namespace palpate {

enum class DriverStatus { ok, fault };

/// One thimble's servos. Calls must return at once; whatever waits belongs into a thread of the driver.
class Driver {
  public:
    virtual ~Driver() = default;
    /// Commands joint angles [rad] at time `now` [s]. `pose_at`: when the tracked pose behind them arrived; 0: none
    /// did.
    virtual DriverStatus send(const Coordinates& q, double now, double pose_at = 0) = 0;
    /// Has what was sent go out: after all thimbles that may share a controller have sent, so that it is told once.
    virtual void flush() {}
    /// Angles that the servos are at, as far as the driver knows [rad].
    virtual Coordinates actual(double now) = 0;
    /// Most that each joint may push with from the next send() on [N m]. False where the servos cannot limit it.
    virtual bool limit_torque(const Coordinates& /*torque*/) { return false; }
    /// Ends a fault, if its cause is gone; false if it is not.
    virtual bool rearm() { return true; }
    /// How old the tracked pose was as the newest angles had reached the servos [s]; negative where that is not known.
    virtual double command_age() const { return -1; }
    /// All that its next answers depend on, as numbers; none where that lies in the world outside.
    virtual std::vector<double> state() const { return {}; }
    /// As it was; false where `state` is not of this driver.
    virtual bool set_state(const std::vector<double>& state) { return state.empty(); }
};

}  // namespace palpate
