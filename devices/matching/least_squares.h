#pragma once
// Least squares over a device's workspace: a damped Gauss-Newton step that keeps to the joint limits.

#include "devices/device.h"

namespace palpate {

/// Minimises 1/2 d' H d + g' d over steps d whose joints, to first order, stay inside their limits. H must be positive
/// definite, w inside. Hildreth's method on the dual: few constraints, most of them far away.
Coordinates step_inside_limits(const DeviceModel& model, const Coordinates& w, const DeviceJacobian& H,
                               const Coordinates& g);

/// Configuration whose joint angles are q, from a guess, by Newton. Returns whether it was found.
bool configuration_of(const DeviceModel& model, const Coordinates& q, Coordinates& w);

/// w + d, brought inside the joint limits: joints that it takes beyond one stop there. Where that is no configuration,
/// the step is halved, in the end to nothing.
Coordinates move_inside_limits(const DeviceModel& model, const Coordinates& w, Coordinates d);

}  // namespace palpate
