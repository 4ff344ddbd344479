#pragma once
// What passes from the step to a thimble's loop.

#include "devices/device.h"
#include "devices/mailbox.h"

namespace palpate {

struct ThimbleCommand {
    double time = 0;     ///< simulation time of the solve [s]
    Coordinates q;       ///< joint angles wanted [rad]
    bool valid = false;  ///< false: the solve failed; counts as no solve
};
using ThimbleMailbox = Mailbox<ThimbleCommand>;

}  // namespace palpate
