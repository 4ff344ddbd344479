#pragma once
// What an object feels in one step.

#include "engine/world.h"

namespace palpate {

struct ObjectOutput {
    Vec3<double> force{0, 0,
                       0};  ///< on it, world [N]: of all contacts on a body or tissue; on others of what is tissue
    Vec3<double> torque{0, 0, 0};  ///< on a body about its centre of mass, on tissue about its pose's origin [N m]
    double area = 0;               ///< of tissue: that is touched [m^2]
    int touching = 0;              ///< of tissue: samples that are pushed
};
ObjectOutput object_output(const World& world, std::size_t object);

}  // namespace palpate
