#pragma once
// Open kinematic chains (Perez et al. 2017, Eq. 1): joints one after the other, from the mount to the platform. The
// search is in the joints themselves, with closed-form forward kinematics.

#include "devices/device.h"

namespace palpate {

/// One joint, at its place in the device frame when all joints are at zero. All are driven by servos, and so measured
/// in radians: one that slides moves by `lead` per radian (a rack on a pinion of that radius).
struct ChainJoint {
    std::string name;
    bool slides = false;
    Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();  ///< unit
    Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< on the axis of a joint that turns [m]
    double lead = 0.008;                              ///< of a joint that slides [m/rad]
    double min = -0.6, max = 0.6, rest = 0;           ///< [rad]
};

/// Joints, and where the level platform is when all are at zero.
struct Chain {
    std::vector<ChainJoint> joints;
    double height = 0.0246;  ///< of the platform's centre above the mount, along the device's z [m]
};

/// A kind of its own for a chain of 1 to 6 joints. `origin` says in messages where it comes from.
DeviceKind make_chain_kind(const std::string& name, const Chain& chain);
/// A model of such a kind, with the chain's limits and rest configuration.
DeviceModel make_chain_model(const DeviceKind& kind, double disk_radius);
/// What is wrong with a chain, in sentences.
std::vector<std::string> validate(const Chain& chain);

}  // namespace palpate
