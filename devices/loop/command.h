#pragma once
// What passes from the step to a thimble's loop.

#include "devices/device.h"
#include "devices/loop/mailbox.h"

namespace palpate {

struct ThimbleCommand {
    double time = 0;          ///< simulation time of the solve [s]
    Coordinates q;            ///< joint angles wanted [rad]
    bool valid = false;       ///< false: the solve failed; counts as no solve
    double sampled_at = 0;    ///< when the tracked poses behind it were read [s of device_clock]; 0 in simulated time
    Coordinates torque = {};  ///< most that each joint may push with [N m]; empty in position mode
};
using ThimbleMailbox = Mailbox<ThimbleCommand>;

}  // namespace palpate
