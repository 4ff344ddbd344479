#pragma once
// What a finger feels in one step, as sums over its pad.

#include "engine/world.h"

namespace palpate {

struct FingerOutput {
    Pose<double> bone = Pose<double>::identity();  ///< finger frame -> world
    Vec3<double> force{0, 0, 0};                   ///< on the skin, world [N]
    Vec3<double> torque{0, 0, 0};                  ///< of these forces about the bone's origin, world [N m]
    Vec3<double> centre{0, 0, 0};  ///< of pressure, world [m]: mean of the samples' places by their normal forces;
                                   ///< NaN where nothing pushes
    double normal_force = 0;       ///< sum of normal forces [N]
    double area = 0;               ///< of the touching samples [m^2]
    double pressure_peak = 0;      ///< largest normal force on a sample over its area [Pa]
    int touching = 0;              ///< samples
};
FingerOutput finger_output(const ContactSurface& contact);

/// A sample's place in the world [m].
inline Vec3<double> sample_place(const ContactSurface& contact, std::size_t sample) {
    return transform(contact.bone, contact.position[sample]);
}

}  // namespace palpate
