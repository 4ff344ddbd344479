#include "devices/kinds/chain.h"

#include <cmath>

#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

/// Product of exponentials: each joint moves all that comes after it.
Platform chain_platform(const DeviceModel& model, const Coordinates& q) {
    const Chain& chain = *model.kind->chain;
    const auto n = std::ptrdiff_t(chain.joints.size());
    Platform p;
    p.dcentre.resize(3, n);
    p.dnormal.resize(3, n);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    std::array<Vector3d, max_device_dimension> axis, point;
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const ChainJoint& j = chain.joints[std::size_t(k)];
        axis[std::size_t(k)] = T.linear() * j.axis;
        point[std::size_t(k)] = T * j.point;
        if (j.slides)
            T.translate(j.lead * q[k] * j.axis);
        else
            T.translate(j.point).rotate(Eigen::AngleAxisd(q[k], j.axis)).translate(-j.point);
    }
    p.rotation = T.linear();
    p.centre = T * Vector3d(0, 0, chain.height);
    p.normal = -p.rotation.col(2);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const ChainJoint& j = chain.joints[std::size_t(k)];
        const Vector3d& a = axis[std::size_t(k)];
        p.dcentre.col(k) = j.slides ? Vector3d(j.lead * a) : Vector3d(a.cross(p.centre - point[std::size_t(k)]));
        p.dnormal.col(k) = j.slides ? Vector3d(Vector3d::Zero()) : Vector3d(a.cross(p.normal));
    }
    return p;
}

Joints chain_joints(const DeviceModel&, const Coordinates& q) {
    return {q, DeviceJacobian::Identity(q.size(), q.size()), true};
}

/// From the mount from joint to joint to the platform; a joint that slides is drawn as its way, one that turns as its
/// axis.
Skeleton chain_skeleton(const DeviceModel& model, const Coordinates& q) {
    const Chain& chain = *model.kind->chain;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    Skeleton lines{{Vector3d::Zero()}};
    for (std::size_t k = 0; k < chain.joints.size(); ++k) {
        const ChainJoint& j = chain.joints[k];
        const Vector3d before = T * Vector3d::Zero();
        if (j.slides) {
            T.translate(j.lead * q[std::ptrdiff_t(k)] * j.axis);
            lines.push_back({before, T * Vector3d::Zero()});
            lines[0].push_back(T * Vector3d::Zero());
        } else {
            const Vector3d at = T * j.point, along = 0.006 * (T.linear() * j.axis);
            lines.push_back({at - along, at + along});
            lines[0].push_back(at);
            T.translate(j.point).rotate(Eigen::AngleAxisd(q[std::ptrdiff_t(k)], j.axis)).translate(-j.point);
        }
    }
    lines[0].push_back(T * Vector3d(0, 0, chain.height));
    return lines;
}

}  // namespace

std::vector<std::string> validate(const Chain& chain) {
    std::vector<std::string> wrong;
    char text[200];
    if (chain.joints.empty() || chain.joints.size() > std::size_t(max_device_dimension)) {
        plain_snprintf(text, sizeof text, "a chain has 1 to %d joints, found %zu", max_device_dimension,
                       chain.joints.size());
        wrong.emplace_back(text);
    }
    for (const ChainJoint& j : chain.joints) {
        auto say = [&](const char* what, double a, double b) {
            plain_snprintf(text, sizeof text, "joint '%s': %s, found %.6g and %.6g", j.name.c_str(), what, a, b);
            wrong.emplace_back(text);
        };
        if (!(std::abs(j.axis.norm() - 1) < 1e-9)) say("its axis must have a direction", j.axis.norm(), 0);
        if (!(j.min < j.max)) say("its lower limit must be below its upper", j.min, j.max);
        if (!(j.rest >= j.min && j.rest <= j.max)) say("its rest must lie inside its limits", j.rest, j.min);
        if (j.slides && !(j.lead > 1e-5 && j.lead < 0.5))
            say("it slides by 0.01 to 500 mm per radian", 1e3 * j.lead, 0);
    }
    if (!(chain.height > -0.2 && chain.height < 0.2)) wrong.emplace_back("the platform's height must be below 200 mm");
    return wrong;
}

DeviceKind make_chain_kind(const std::string& name, const Chain& chain) {
    DeviceKind kind;
    kind.name = name;
    const auto n = std::ptrdiff_t(chain.joints.size());
    kind.joint_count = int(n);
    kind.open_chain = true;
    kind.chain = std::make_shared<const Chain>(chain);
    kind.seat_height = chain.height;
    kind.configuration_min.resize(n);
    kind.configuration_max.resize(n);
    kind.configuration_scale = Coordinates::Constant(n, 0.3);
    for (std::ptrdiff_t k = 0; k < n; ++k) {
        const ChainJoint& j = chain.joints[std::size_t(k)];
        kind.configuration_names.push_back(j.name);
        kind.configuration_is_length.push_back(false);
        kind.configuration_min[k] = j.min;
        kind.configuration_max[k] = j.max;
    }
    kind.platform = chain_platform;
    kind.joints = chain_joints;
    kind.skeleton = chain_skeleton;
    return kind;
}

DeviceModel make_chain_model(const DeviceKind& kind, double disk_radius) {
    DeviceModel m;
    m.kind = &kind;
    m.joint_min = kind.configuration_min;
    m.joint_max = kind.configuration_max;
    m.rest.resize(kind.joint_count);
    for (int k = 0; k < kind.joint_count; ++k) m.rest[k] = kind.chain->joints[std::size_t(k)].rest;
    m.disk_radius = disk_radius;
    m.mount = mount_above_nail();
    return m;
}

}  // namespace palpate
