#include "devices/device.h"
#include "meshes/plain_numbers.h"

namespace palpate {

const DeviceKind& chinello_3rrs();
const DeviceKind& rrs_exact();
const DeviceKind& cable_3();
const DeviceKind& serial_3dof();
const DeviceKind& shear_2dof();
const DeviceKind& serial_5dof();
const DeviceKind& serial_6dof();

namespace {

struct NamedKind {
    const char* name;
    const DeviceKind& (*kind)();
};
/// One line per kind.
constexpr NamedKind kinds[] = {
    {"chinello-3rrs", chinello_3rrs}, {"rrs-exact", rrs_exact},   {"cable-3", cable_3},
    {"serial-3dof", serial_3dof},     {"shear-2dof", shear_2dof}, {"serial-5dof", serial_5dof},
    {"serial-6dof", serial_6dof},
};

}  // namespace

const DeviceKind* find_kind(const std::string& name) {
    for (const NamedKind& k : kinds)
        if (k.name == name) return &k.kind();
    return nullptr;
}

std::vector<std::string> kind_names() {
    std::vector<std::string> names;
    for (const NamedKind& k : kinds) names.emplace_back(k.name);
    return names;
}

Eigen::Isometry3d mount_above_nail() {
    Eigen::Isometry3d mount;
    mount.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
    mount.translation() << 0.0025, 0, 0.0162;
    return mount;
}

Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * max_device_dimension, 1> joint_margins(const DeviceModel& model,
                                                                                       const Coordinates& q) {
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * max_device_dimension, 1> c(2 * q.size());
    c << q - model.joint_min, model.joint_max - q;
    return c;
}

ConfigurationBox search_box(const DeviceModel& model) {
    const DeviceKind& kind = *model.kind;
    if (!kind.open_chain) return {kind.configuration_min, kind.configuration_max};
    return {kind.configuration_min.cwiseMin(model.joint_min), kind.configuration_max.cwiseMax(model.joint_max)};
}

bool at_a_limit(const DeviceModel& model, const Coordinates& q) { return joint_margins(model, q).minCoeff() < 1e-5; }

bool inside_workspace(const DeviceModel& model, const Coordinates& w, double tolerance) {
    if (!w.allFinite()) return false;
    const Joints joints = model.kind->joints(model, w);
    return joints.closed && joints.q.allFinite() && joint_margins(model, joints.q).minCoeff() >= -tolerance;
}

std::vector<std::string> validate(const DeviceModel& model) {
    std::vector<std::string> wrong;
    const DeviceKind& kind = *model.kind;
    char text[240];
    for (std::size_t i = 0; i < kind.geometry_names.size(); ++i)
        if (!(model.geometry[i] > 0 && model.geometry[i] < 0.5)) {
            plain_snprintf(text, sizeof text, "%s = %.6g mm: expected a length between 0 and 500 mm",
                           kind.geometry_names[i].c_str(), 1e3 * model.geometry[i]);
            wrong.emplace_back(text);
        }
    for (int j = 0; j < kind.joint_count; ++j)
        if (!(model.joint_min[j] < model.joint_max[j]) || std::abs(model.joint_min[j]) > 4 ||
            std::abs(model.joint_max[j]) > 4) {
            plain_snprintf(
                text, sizeof text,
                "joint %d: limits %.6g to %.6g degrees; the lower must be below the upper, both within 229 degrees",
                j + 1, model.joint_min[j] * 57.29577951308232, model.joint_max[j] * 57.29577951308232);
            wrong.emplace_back(text);
        }
    if (!(model.disk_radius > 1e-4 && model.disk_radius < 0.1))
        wrong.emplace_back("the platform radius must be between 0.1 and 100 mm");
    if (!(model.clearance >= 0 && model.clearance < 0.01))
        wrong.emplace_back("the clearance must be between 0 and 10 mm");
    if (wrong.empty() && !inside_workspace(model, model.rest, 1e-9)) {
        const Joints joints = kind.joints(model, model.rest);
        std::string q;
        for (int j = 0; j < kind.joint_count; ++j) {
            plain_snprintf(text, sizeof text, "%s%.4g", j ? ", " : "", joints.q[j] * 57.29577951308232);
            q += text;
        }
        wrong.push_back(std::string("the rest configuration cannot be reached: ") +
                        (joints.closed ? "it needs joints at " + q + " degrees, outside their limits"
                                       : "the legs cannot close (their lengths clash with the platform's size)"));
    }
    return wrong;
}

}  // namespace palpate
