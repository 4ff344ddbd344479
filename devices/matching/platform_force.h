#pragma once
// Force mode of a thimble: servos that can limit their torque push the platform with a force rather than to a place.

#include "devices/device.h"

namespace palpate {

struct ForceModeSettings {
    double press = 0.003;  ///< how far beyond the contact the platform aims, so that its force is what ends it [m]
    double moving_share = 0.25;  ///< of the largest force: what moves a platform that touches nothing
};

/// Joint torques [N m] that push the platform along its normal with `force` [N] at configuration w: virtual work,
/// torque . dq = force n . dcentre for every dw. Not finite where the mechanism is singular.
Coordinates torques_for_force(const DeviceModel& model, const Coordinates& w, double force);

/// Configuration whose platform is `distance` [m] further along its normal with the same tilt, as far as joint limits
/// allow.
Coordinates pressed_on(const DeviceModel& model, const Coordinates& w, double distance);

/// The last function before a torque reaches a driver: finite, not negative, no more than `largest`; what is not finite
/// becomes 0. Empty stays empty.
Coordinates limit_torque(const Coordinates& torque, const Coordinates& largest);

/// Torques that no configuration that the joints can reach exceeds at the device's largest force, by a grid over the
/// workspace [N m].
Coordinates largest_torques(const DeviceModel& model);

}  // namespace palpate
