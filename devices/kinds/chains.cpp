// Platforms on open chains, from two to six joints. None is a published device: they are what the methods can be
// compared on. Sliding joints are racks on pinions of 8 mm radius; turning ones have their axes through the platform's
// centre, where the pad touches it, so that tilting does not push.

#include "devices/kinds/chain.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

constexpr double height = 0.0246;  // as chinello-3rrs is seated

ChainJoint slide(const char* name, const Vector3d& axis, double range_mm, double rest_mm = 0) {
    const double lead = 0.008;
    return {name,
            true,
            axis,
            Vector3d::Zero(),
            lead,
            -1e-3 * range_mm / lead,
            1e-3 * range_mm / lead,
            1e-3 * rest_mm / lead};
}
ChainJoint turn(const char* name, const Vector3d& axis, double range_deg) {
    return {name, false, axis, Vector3d(0, 0, height), 0, -range_deg * degree, range_deg * degree, 0};
}

const DeviceKind& make(const char* name, std::vector<ChainJoint> joints, DeviceModel (*defaults)()) {
    static std::vector<std::unique_ptr<DeviceKind>> kinds;  // for as long as the program runs
    kinds.push_back(std::make_unique<DeviceKind>(make_chain_kind(name, {std::move(joints), height})));
    kinds.back()->defaults = defaults;
    return *kinds.back();
}

const ChainJoint along_x = slide("x", Vector3d::UnitX(), 6), along_y = slide("y", Vector3d::UnitY(), 6),
                 lift = slide("lift", Vector3d::UnitZ(), 5, 4.5), pitch = turn("pitch", Vector3d::UnitY(), 40),
                 roll = turn("roll", Vector3d::UnitX(), 40), yaw = turn("yaw", Vector3d::UnitZ(), 30);

}  // namespace

/// Lift, pitch and roll: what chinello-3rrs does, without its sideways motions.
const DeviceKind& serial_3dof() {
    static const DeviceKind& kind =
        make("serial-3dof", {lift, pitch, roll}, [] { return make_chain_model(serial_3dof(), 0.020); });
    return kind;
}
/// A stage that moves the pad's contact sideways, at a fixed height.
const DeviceKind& shear_2dof() {
    static const DeviceKind& kind =
        make("shear-2dof", {along_x, along_y}, [] { return make_chain_model(shear_2dof(), 0.0075); });
    return kind;
}
/// All that a disk can do about a finger, but for turning about its own axis: what a full planar match needs.
const DeviceKind& serial_5dof() {
    static const DeviceKind& kind = make("serial-5dof", {along_x, along_y, lift, pitch, roll},
                                         [] { return make_chain_model(serial_5dof(), 0.010); });
    return kind;
}
/// And that, too: the last joint changes nothing that a round platform could show.
const DeviceKind& serial_6dof() {
    static const DeviceKind& kind = make("serial-6dof", {along_x, along_y, lift, pitch, roll, yaw},
                                         [] { return make_chain_model(serial_6dof(), 0.010); });
    return kind;
}

}  // namespace palpate
