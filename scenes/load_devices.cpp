#include "scenes/load_devices.h"

#include <fstream>
#include <numbers>

#include "devices/chain.h"
#include "devices/platform_force.h"
#include "meshes/input_error.h"

namespace palpate {

namespace {

constexpr double mm = 1e-3, ms = 1e-3, degree = std::numbers::pi / 180;

const std::vector<std::string> driver_names{"simulated",      "maestro",   "maestro-dry",
                                            "maestro-serial", "dynamixel", "feetech"};

/// A turn is 4,096 ticks. Torque limits, as their makers give the stall torque: XL330-M288, 0.52 N m at 1,470 mA, and
/// 800 mA at most here; STS3215, 1.9 N m at 1,000 per mille.
constexpr ServoCalibration dynamixel_calibration{2048, 651.9, 1024, 3072, 2827, 800};
constexpr ServoCalibration feetech_calibration{2048, 651.9, 1024, 3072, 526, 1000};

/// Which controller drives a thimble, by which channels.
DriverSpec read_driver(Section& s, int joints, const std::filesystem::path& folder) {
    DriverSpec d;
    d.driver = s.choice("driver", "simulated", driver_names);
    d.serial = s.text("serial", "");
    d.port = s.text("port", "");
    d.channels = s.integers("channels");
    const std::string file = s.text("calibration", "");
    if (d.driver == "simulated") {
        for (const char* key : {"serial", "port", "channels", "calibration"})
            if (s.has(key)) s.complain(key, "a simulated thimble has no controller; say driver = \"maestro\"");
        return d;
    }
    const bool bus = d.driver == "dynamixel" || d.driver == "feetech",
               serial_port = bus || d.driver == "maestro-serial";
    if (serial_port && d.port.empty())
        s.complain("port", "a " + d.driver + " needs its port, for example /dev/ttyUSB0");
    if (!serial_port && s.has("port")) s.complain("port", "a " + d.driver + " is on USB; choose it by serial");
    d.servos.assign(std::size_t(joints), d.driver == "dynamixel" ? dynamixel_calibration
                                         : d.driver == "feetech" ? feetech_calibration
                                                                 : ServoCalibration{});
    if (!file.empty()) try {
            ThimbleCalibration c = read_calibration((folder / file).lexically_normal());
            if (d.channels.empty()) d.channels = c.channels;
            if (d.serial.empty()) d.serial = c.serial;
            d.servos = std::move(c.servos);
        } catch (const InputError& error) {
            for (const auto& m : error.messages) s.complain("calibration", m);
        }
    if (int(d.channels.size()) != joints || int(d.servos.size()) != joints)
        s.complain("channels", "a thimble of " + std::to_string(joints) + " joints needs as many channels, found " +
                                   std::to_string(d.channels.size()) +
                                   (file.empty() ? "" : " and " + std::to_string(d.servos.size()) + " calibrations"));
    for (int c : d.channels)
        if (c < 0 || c >= max_channels)
            s.complain("channels", "a channel lies between 0 and " + std::to_string(max_channels - 1) + ", found " +
                                       std::to_string(c));
    return d;
}

/// kind = "chain": joints from the mount to the platform.
DeviceModel read_chain(Section& s) {
    Chain chain;
    chain.height = s.number("height_mm", chain.height / mm, -199, 199, mm);
    for (Section& j : s.tables("joint")) {
        ChainJoint joint;
        joint.name = j.text("name", "joint " + std::to_string(chain.joints.size() + 1));
        joint.slides = j.boolean("slides", false);
        const Vec3<double> axis = j.vector("axis", {0, 0, 1}, 1e3), point = j.vector("point_mm", {0, 0, 0}, 500, mm);
        joint.axis = Eigen::Vector3d(axis.x, axis.y, axis.z).normalized();
        joint.point = Eigen::Vector3d(point.x, point.y, point.z);
        if (joint.slides)
            joint.lead = j.number("mm_per_rad", joint.lead / mm, 0.01, 500, mm);
        else if (j.has("mm_per_rad"))
            j.complain("mm_per_rad", "only a joint that slides has it");
        joint.min = j.number("min_deg", joint.min / degree, -229, 229, degree);
        joint.max = j.number("max_deg", joint.max / degree, -229, 229, degree);
        joint.rest = j.number("rest_deg", joint.rest / degree, -229, 229, degree);
        j.finish();
        chain.joints.push_back(joint);
    }
    const auto wrong = validate(chain);
    for (const auto& sentence : wrong) s.complain("joint", sentence);
    if (!wrong.empty()) return find_kind("serial-3dof")->defaults();  // nothing is built of it
    const auto kind = std::make_shared<const DeviceKind>(make_chain_kind("chain", chain));
    DeviceModel model = make_chain_model(*kind, 0.010);
    model.own_kind = kind;
    return model;
}

}  // namespace

/// device = { kind, method, ... } of a finger.
void read_device(Section s, int finger, const std::filesystem::path& folder, Scene& scene) {
    if (!s) return;
    ThimbleSpec t;
    t.finger = finger;
    std::vector<std::string> kinds = kind_names();
    kinds.emplace_back("chain");
    const std::string kind = s.choice("kind", "chinello-3rrs", kinds);
    t.model = kind == "chain" ? read_chain(s) : find_kind(kind)->defaults();
    parse_method(s.choice("method", "constrained", {"constrained", "unconstrained", "plane", "force"}), t.method);
    t.period = s.number("period_ms", 20, 1, 1000, ms);
    t.force_mode = s.choice("mode", "position", {"position", "force"}) == "force";
    t.model.max_force = s.number("max_force_N", t.model.max_force, 0.01, 100);
    t.settings.tolerance = s.number("tolerance", t.settings.tolerance, 1e-12, 0.1);
    t.settings.evaluations = s.integer("evaluations", t.settings.evaluations, 3, 100000);
    t.settings.smoothing = s.number("smoothing", 0, 0, 1e6);
    const std::vector<std::string> solvers{"slsqp", "least-squares", "multistart"};  // as MatchingSolver has them
    const std::string solver = s.choice("solver", solvers[0], solvers);
    t.settings.solver = MatchingSolver(std::find(solvers.begin(), solvers.end(), solver) - solvers.begin());
    t.settings.force_rounds = s.integer("force_rounds", t.settings.force_rounds, 1, 100);
    t.settings.force_iterations = s.integer("force_iterations", t.settings.force_iterations, 1, 1000);
    t.settings.force_norm =
        s.choice("force_norm", "squares", {"squares", "sum"}) == "sum" ? ForceNorm::sum : ForceNorm::squares;
    t.settings.normal_weight = s.number("normal_weight", t.settings.normal_weight, 0, 1e6);
    t.settings.tangential_weight = s.number("tangential_weight", t.settings.tangential_weight, 0, 1e6);
    t.settings.net_weight = s.number("net_weight", t.settings.net_weight, 0, 1e6);
    t.settings.area_weight = s.number("area_weight", t.settings.area_weight, 0, 1e6);
    if (s.has("joint_speed_deg_per_s"))
        t.settings.joint_step = t.period * s.number("joint_speed_deg_per_s", 0, 1, 1e5, degree);
    t.settings.sideways_starts = s.integer("sideways_starts", t.settings.sideways_starts, 0, 1000);
    t.settings.non_contact = s.boolean("non_contact", true);
    if (t.force_mode && !(torques_for_force(t.model, t.model.rest, 1).norm() > 1e-9))
        s.complain("mode", "the joints of a " + kind + " cannot push its platform along its normal");
    t.model.disk_radius = s.number("platform_radius_mm", t.model.disk_radius / mm, 0.1, 100, mm);
    t.model.clearance = s.number("clearance_mm", t.model.clearance / mm, 0, 10, mm);
    const double low = s.number("joint_min_deg", t.model.joint_min[0] / degree, -180, 180, degree);
    const double high = s.number("joint_max_deg", t.model.joint_max[0] / degree, -180, 180, degree);
    if (s.has("joint_min_deg")) t.model.joint_min.setConstant(low);
    if (s.has("joint_max_deg")) t.model.joint_max.setConstant(high);
    Section geometry = s.table("geometry_mm");
    for (std::size_t i = 0; i < t.model.kind->geometry_names.size(); ++i)
        t.model.geometry[i] = geometry.number(t.model.kind->geometry_names[i], t.model.geometry[i] / mm, 0.01, 500, mm);
    geometry.finish();
    if (s.has("mount_mm")) {
        const Vec3<double> p = s.vector("mount_mm", {0, 0, 0}, 200, mm);
        t.model.mount.translation() << p.x, p.y, p.z;
    } else {
        // Seated so that the undeformed pad touches the level platform near the middle of its range (chinello-3rrs:
        // dz = 24.6 mm): pressing, and then rolling, passes the height at which the device rolls farthest.
        double lowest = 0;
        for (const Point& p : scene.spec.fingers[finger].mesh.nodes) lowest = std::min(lowest, p[2]);
        t.model.mount.translation().z() = lowest + t.model.kind->seat_height;
    }
    for (const auto& sentence : validate(t.model)) s.complain("kind", sentence);
    scene.drivers.push_back(read_driver(s, t.model.kind->joint_count, folder));
    const DriverSpec& driver = scene.drivers.back();
    const bool limits_torque = std::all_of(driver.servos.begin(), driver.servos.end(),
                                           [](const ServoCalibration& c) { return c.torque_per_Nm > 0; });
    if (t.force_mode && (driver.driver.starts_with("maestro") || !limits_torque))
        s.complain("mode",
                   "a " + driver.driver +
                       " moves its servos to places and cannot limit their force; \"force\" "
                       "needs a dynamixel or feetech bus, calibrated with torque_per_Nm, or a simulated thimble");
    s.finish();
    scene.spec.thimbles.push_back(t);
}

void read_thimble_loop(Section s, Scene& scene) {
    scene.loop.period = s.number("period_ms", scene.loop.period / ms, 1, 1000, ms);
    scene.loop.limits.velocity = s.number("velocity_rad_per_s", scene.loop.limits.velocity, 0.01, 50);
    scene.loop.limits.acceleration = s.number("acceleration_rad_per_s2", scene.loop.limits.acceleration, 0.1, 10000);
    Section servo = s.table("servo");
    scene.servo.pulse_step_us = servo.number("pulse_step_us", scene.servo.pulse_step_us, 0.01, 50);
    scene.servo.calibration.units_per_rad = servo.number("us_per_rad", scene.servo.calibration.units_per_rad, 51, 5000);
    scene.servo.delay_s = servo.number("delay_ms", scene.servo.delay_s / ms, 0, 999, ms);
    scene.servo.slew_rad_per_s = servo.number("slew_rad_per_s", scene.servo.slew_rad_per_s, 0.11, 100);
    servo.finish();
    s.finish();
}

ThimbleCalibration read_calibration(const std::filesystem::path& file) {
    Problems problems{file, {}};
    if (!std::filesystem::is_regular_file(file)) throw InputError(file.string() + ": no such file");
    ThimbleCalibration c;
    toml::table table;
    try {
        table = toml::parse_file(file.string());
    } catch (const toml::parse_error& error) {
        problems.add(nullptr, std::string(error.description()));
        throw InputError(problems.messages);
    }
    Section root(&table, "", problems);
    c.serial = root.text("serial", "");
    const std::string unit = root.choice("unit", "us", {"us", "ticks"});
    for (Section& s : root.tables("servo")) {
        ServoCalibration v;
        c.channels.push_back(s.integer("channel", int(c.channels.size()), 0, max_channels - 1));
        v.zero = s.number("zero_" + unit, unit == "us" ? v.zero : 2048, 0, 16000);
        v.units_per_rad = s.number(unit + "_per_rad", unit == "us" ? v.units_per_rad : 651.9, -5000, 5000);
        v.min = s.number("min_" + unit, unit == "us" ? v.min : 1024, 0, 16000);
        v.max = s.number("max_" + unit, unit == "us" ? v.max : 3072, 0, 16000);
        v.torque_per_Nm = s.number("torque_per_Nm", unit == "us" ? 0 : dynamixel_calibration.torque_per_Nm, 0, 1e5);
        v.torque_max = s.number("torque_max", unit == "us" ? 0 : dynamixel_calibration.torque_max, 0, 32000);
        for (const auto& sentence : v.validate()) s.complain("zero_" + unit, sentence);
        s.finish();
        c.servos.push_back(v);
    }
    root.finish();
    if (!problems.messages.empty()) throw InputError(problems.messages);
    return c;
}

void write_calibration(const std::filesystem::path& file, const ThimbleCalibration& c, const std::string& unit) {
    std::ofstream out(file);
    out << "# Calibration of a thimble's servos, one per joint.\nserial = \"" << c.serial << "\"\nunit = \"" << unit
        << "\"\n";
    for (std::size_t i = 0; i < c.servos.size(); ++i)
        out << "\n[[servo]]\nchannel = " << c.channels[i] << "\nzero_" << unit << " = " << c.servos[i].zero << "\n"
            << unit << "_per_rad = " << c.servos[i].units_per_rad << "\nmin_" << unit << " = " << c.servos[i].min
            << "\nmax_" << unit << " = " << c.servos[i].max << "\ntorque_per_Nm = " << c.servos[i].torque_per_Nm
            << "\ntorque_max = " << c.servos[i].torque_max << "\n";
    if (!out.flush()) throw InputError(file.string() + ": cannot be written");
}

}  // namespace palpate
