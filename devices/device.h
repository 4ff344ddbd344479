#pragma once
// The contract of a device kind. A kind is one file in kinds/ with a plain descriptor, and one line in
// kinds.cpp. SI units and radians; device frame: z from the fixed to the mobile platform.

#include <Eigen/Geometry>
#include <array>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

namespace palpate {

inline constexpr double degree = std::numbers::pi / 180;  ///< [rad]

inline constexpr int max_device_dimension = 6;
/// Device configuration w (end-effector coordinates) or actuator coordinates q; never allocates.
using Coordinates = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_device_dimension, 1>;
/// Rows = outputs, columns = components of w.
using DeviceJacobian =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, max_device_dimension, max_device_dimension>;
using PointJacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, max_device_dimension>;

struct DeviceKind;
struct Chain;

/// A device: its kind with the numbers that a user may set.
struct DeviceModel {
    const DeviceKind* kind = nullptr;
    std::array<double, 8> geometry{};                         ///< meaning: DeviceKind::geometry_names
    Coordinates joint_min, joint_max;                         ///< actuator limits [rad]
    double disk_radius = 0.020;                               ///< of the platform [m]
    double clearance = 0.0002;                                ///< eps of Perez et al. 2017, Eq. 3 [m]
    Eigen::Isometry3d mount = Eigen::Isometry3d::Identity();  ///< device frame -> finger frame
    Coordinates rest;                                         ///< contact-free configuration w
    double max_force = 4.7;  ///< of the platform on the finger [N]; that of chinello-3rrs, assumed of the others
    std::shared_ptr<const DeviceKind> own_kind = nullptr;  ///< where a scene has defined the kind
};

/// Where the platform is, with derivatives with respect to w.
struct Platform {
    Eigen::Vector3d centre;  ///< p [m]
    Eigen::Matrix3d rotation;
    Eigen::Vector3d normal;          ///< n, unit, points at the finger
    PointJacobian dcentre, dnormal;  ///< [3 x size of w]
};

/// Actuator coordinates of a configuration, with derivatives.
struct Joints {
    Coordinates q;       ///< [rad]
    DeviceJacobian dq;   ///< [joints x size of w]
    bool closed = true;  ///< false where the legs cannot reach; q is then continued past its limits
};

/// What a device looks like: polylines of its links and frames, device frame [m].
using Skeleton = std::vector<std::vector<Eigen::Vector3d>>;

/// Descriptor of a kind. Parallel mechanisms are searched in w with closed-form inverse kinematics, open chains in
/// their joints (w = q).
struct DeviceKind {
    std::string name;
    std::vector<std::string> configuration_names;  ///< one per component of w, for example "theta"
    std::vector<bool> configuration_is_length;     ///< metres rather than radians
    std::vector<std::string> geometry_names;       ///< all lengths [m]
    int joint_count = 0;
    bool open_chain = false;             ///< w is q, and joint limits are its bounds
    std::shared_ptr<const Chain> chain;  ///< of kinds made by make_chain_kind
    double seat_height = 0.0246;         ///< z of the level platform where it is to touch the undeformed pad [m]
    Coordinates configuration_min, configuration_max;  ///< box of w in which the search stays
    Coordinates configuration_scale;                   ///< typical size of each component
    DeviceModel (*defaults)() = nullptr;
    Platform (*platform)(const DeviceModel&, const Coordinates& w) = nullptr;
    Joints (*joints)(const DeviceModel&, const Coordinates& w) = nullptr;
    Skeleton (*skeleton)(const DeviceModel&, const Coordinates& w) = nullptr;  ///< the same polylines for every w
};

/// Mount of a device that sits above the nail, z towards the pad. How high is seen once the finger is known.
Eigen::Isometry3d mount_above_nail();

/// Kind by name; nullptr if there is none.
const DeviceKind* find_kind(const std::string& name);
/// All names, for messages.
std::vector<std::string> kind_names();

/// What is wrong with a device's numbers, in sentences that name the numbers that clash.
std::vector<std::string> validate(const DeviceModel& model);

/// C(q(w)) of Perez et al. 2017, Eq. 2: distances of each joint from its lower and upper limit [rad],
/// [2 x joints], all >= 0 inside the workspace.
Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * max_device_dimension, 1> joint_margins(const DeviceModel& model,
                                                                                       const Coordinates& q);
/// Box of w in which a search without joint limits stays: the kind's, and of an open chain, whose w are its joints, all
/// that the model's joints can do, too.
struct ConfigurationBox {
    Coordinates low, high;
};
ConfigurationBox search_box(const DeviceModel& model);
/// Whether a joint is at one of its limits.
bool at_a_limit(const DeviceModel& model, const Coordinates& q);
/// Whether w can be reached: legs close and all joints are inside their limits.
bool inside_workspace(const DeviceModel& model, const Coordinates& w, double tolerance = 0);

}  // namespace palpate
