#include "scenes/load/load_devices.h"

#include <toml++/toml.h>
#include <algorithm>

#include "devices/kinds/chain.h"
#include "devices/matching/platform_force.h"
#include "meshes/input_error.h"

namespace palpate {

namespace {

const std::vector<std::string> driver_names = [] {
    std::vector<std::string> names;
    for (const NamedDriver& d : drivers()) names.emplace_back(d.name);
    return names;
}();
const std::vector<std::string> method_words{"constrained", "unconstrained", "plane", "force"};  // as MatchingMethod
const std::vector<std::string> solver_words{"slsqp", "least-squares", "multistart"};            // as MatchingSolver
const std::vector<std::string> norm_words{"squares", "sum"};                                    // as ForceNorm

/// Torque limits, as its maker gives the stall torque: STS3215, 1.9 N m at 1,000 per mille.
constexpr ServoCalibration feetech_calibration{2048, 651.9, 1024, 3072, 526, 1000};

/// What a file says of a thimble's controller, whichever driver it names.
struct DriverKeys {
    DriverSpec spec;
    std::string calibration;
};

DriverKeys read_driver_keys(Section& s) {
    DriverKeys k;
    s.choice(
        "driver", k.spec.driver, driver_names,
        "What drives its servos once armed: a Pololu Maestro on USB (\"maestro-dry\" writes a file instead), one on "
        "a tty, a bus of Dynamixel or Feetech servos, a board of your own that speaks lines of text; or simulated "
        "ones.");
    s.text("serial", k.spec.serial, "USB serial number of its Maestro; without it, the only one there is.");
    s.text("port", k.spec.port, "Serial port of its controller, for example /dev/ttyUSB0.");
    s.integers("channels", k.spec.channels, {0, max_channels - 1},
               "Channel (or bus id) of each joint's servo, in the order of the joints.");
    s.text(
        "calibration", k.calibration,
        "File that says how its servos sit (`palpate calibrate-thimble` writes it), relative to the scene's folder.");
    return k;
}

std::string list_of(const std::vector<int>& channels) {
    std::vector<std::string> words;
    for (int c : channels) words.push_back(std::to_string(c));
    return joined(words);
}

/// The servos' calibrations, from the file or as their maker builds them.
void calibrate_servos(Section& s, const std::string& file, const DeviceModel& model,
                      const std::filesystem::path& folder, DriverSpec& d) {
    const bool bus = counts_ticks(d);
    const int joints = model.kind->joint_count;
    d.servos.assign(std::size_t(joints), d.driver == "dynamixel" ? dynamixel_calibration
                                         : bus                   ? feetech_calibration
                                                                 : ServoCalibration{});
    if (!s.sound("calibration")) return;
    if (file.empty()) return;
    try {
        ThimbleCalibration c = read_calibration((folder / file).lexically_normal());
        if (c.ticks != bus)
            return s.complain("calibration", "it is in " + std::string(c.ticks ? "ticks" : "microseconds") +
                                                 ", and a " + d.driver + " takes " + (bus ? "ticks" : "microseconds") +
                                                 ": it belongs to another servo");
        if (int(c.servos.size()) != joints)
            return s.complain("calibration", "a thimble of " + std::to_string(joints) +
                                                 " joints needs as many [[servo]], found " +
                                                 std::to_string(c.servos.size()));
        if (s.has("channels") && c.says_channels && s.sound("channels") && c.channels != d.channels)
            return s.complain("calibration", file + " is of channels " + list_of(c.channels) +
                                                 ", and this device says channels " + list_of(d.channels) +
                                                 ", in the order of the joints: it belongs to other servos, or one of "
                                                 "both is wrong");
        if (!s.has("channels")) d.channels = c.channels;
        if (d.serial.empty()) d.serial = c.serial;
        d.servos = std::move(c.servos);
        d.calibrated = true;
        check_ranges(s, file, model, d);
    } catch (const InputError& error) { s.complain_as_found("calibration", error.messages); }
}

/// Complains about what does not fit the driver; nothing is said of a driver that there is not.
DriverSpec make_driver(Section& s, const DriverKeys& k, const DeviceModel& model, const std::filesystem::path& folder) {
    DriverSpec d = k.spec;
    const int joints = model.kind->joint_count;
    if (!s.in_file() || !s.sound("driver")) return d;
    if (d.driver == "simulated") {
        for (const char* key : {"serial", "port", "channels", "calibration"})
            if (s.has(key)) s.complain(key, "a simulated thimble has no controller; say driver = \"maestro\"");
        return d;
    }
    const bool on_port = counts_ticks(d) || d.driver == "maestro-serial" || d.driver == "text";
    if (on_port && d.port.empty()) s.complain("port", "a " + d.driver + " needs its port, for example /dev/ttyUSB0");
    if (on_port && s.has("serial")) s.complain("serial", "a " + d.driver + " is chosen by its port");
    if (!on_port && s.has("port")) s.complain("port", "a " + d.driver + " is on USB; choose it by serial");
    calibrate_servos(s, k.calibration, model, folder, d);
    if (!s.sound("calibration") || !s.sound("channels")) return d;
    if (int(d.channels.size()) != joints)
        s.complain("channels", "a thimble of " + std::to_string(joints) + " joints needs as many channels, found " +
                                   std::to_string(d.channels.size()));
    std::vector<int> sorted = d.channels;
    std::sort(sorted.begin(), sorted.end());
    if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end()); twice != sorted.end())
        s.complain("channels", "channel " + std::to_string(*twice) + " would drive two joints");
    return d;
}

/// A joint's name is that of its column in results.
void check_joint_name(Section& s, const std::string& name, const std::vector<ChainJoint>& others) {
    if (has_controls(name) || name.find_first_of("\",") != std::string::npos || name.empty() || name.size() > 80)
        s.complain("name",
                   "a joint's name is that of a column of results: not empty, no quotes, commas or control characters, "
                   "and at most 80 letters");
    for (const ChainJoint& other : others)
        if (other.name == name) s.complain("name", "two joints are called '" + name + "'");
    for (const char* column : {"q", "sent", "servo"})
        for (int j = 1; j <= max_device_dimension; ++j)
            if (name == column + std::to_string(j))
                s.complain("name", "'" + name + "' is what results call an angle of joint " + std::to_string(j) +
                                       ": choose another name");
}

/// kind = "chain": joints from the mount to the platform.
Chain read_chain(Section& s) {
    Chain chain;
    s.number("height_mm", chain.height, unit::mm, {-199, 199},
             "Of a chain: height of the platform's centre above the mount when all joints are at zero.");
    for (Section& j : s.tables("joint", "Of a chain: its joints, from the mount to the platform.")) {
        ChainJoint joint;
        joint.name = "joint " + std::to_string(chain.joints.size() + 1);
        j.text("name", joint.name, "What it is called, in results, too.");
        check_joint_name(j, joint.name, chain.joints);
        j.boolean("slides", joint.slides, "It slides along its axis instead of turning about it.");
        Vec3<double> axis{0, 0, 1}, point{0, 0, 0};
        j.vector("axis", axis, unit::one, 1e3, "Its axis, in the device's frame.");
        j.vector("point_mm", point, unit::mm, 500, "A point on the axis of a joint that turns.");
        joint.axis = Eigen::Vector3d(axis.x, axis.y, axis.z).normalized();
        joint.point = Eigen::Vector3d(point.x, point.y, point.z);
        j.number("mm_per_rad", joint.lead, unit::mm_per_rad, {0.01, 500},
                 "Way of a joint that slides per turn of its servo.");
        if (!joint.slides && j.has("mm_per_rad")) j.complain("mm_per_rad", "only a joint that slides has it");
        j.number("min_deg", joint.min, unit::deg, {-229, 229}, "Lower limit of its servo.");
        j.number("max_deg", joint.max, unit::deg, {-229, 229}, "Upper limit of its servo.");
        j.number("rest_deg", joint.rest, unit::deg, {-229, 229}, "Where it is when nothing touches.");
        j.finish();
        chain.joints.push_back(joint);
    }
    return chain;
}

DeviceModel chain_model(Section& s, const Chain& chain) {
    const auto wrong = validate(chain);
    if (!wrong.empty()) {
        s.complain_as_found("joint", wrong);
        return find_kind("serial-3dof")->defaults();  // nothing is built of it
    }
    const auto kind = std::make_shared<const DeviceKind>(make_chain_kind("chain", chain));
    DeviceModel model = make_chain_model(*kind, 0.010);
    model.own_kind = kind;
    return model;
}

/// Lengths of a kind, by the names that `palpate kinematics KIND` shows; every kind has its own.
void read_geometry(Section s, DeviceModel& model) {
    std::vector<std::string> known;
    for (const std::string& name : kind_names()) {
        const DeviceKind& kind = *find_kind(name);
        const DeviceModel defaults = kind.defaults();
        for (std::size_t i = 0; i < kind.geometry_names.size(); ++i) {
            const std::string& length = kind.geometry_names[i];
            if (std::find(known.begin(), known.end(), length) != known.end()) continue;
            known.push_back(length);
            double value = defaults.geometry[i];
            s.number(length, value, unit::mm, {0.01, 499},
                     "A length of the kinds that have it; see `palpate kinematics KIND`.");
            const auto& own = model.kind->geometry_names;
            const auto it = std::find(own.begin(), own.end(), length);
            if (!s.has(length)) continue;
            if (it == own.end())
                s.complain(length, "a " + model.kind->name + " has no such length; it has " +
                                       (own.empty() ? "none" : joined(own)));
            else
                model.geometry[std::size_t(it - own.begin())] = value;
        }
    }
    s.finish();
}

void read_matching(Section& s, ThimbleSpec& t) {
    MatchingSettings& m = t.settings;
    s.choice(
        "method", t.method, method_words,
        "How contact is rendered: contact surface matching inside the joints' limits, the same without them and then "
        "projected, a plane fitted to the contact, or matching of forces.");
    s.number("period_ms", t.period, unit::ms, {1, 1000}, "Time from one match to the next.");
    s.number("tolerance", m.tolerance, unit::one, {1e-12, 0.1},
             "Change of the scaled configuration at which the search stops.");
    s.integer("evaluations", m.evaluations, {3, 100000}, "Most evaluations of the objective.");
    s.number("smoothing", m.smoothing, unit::one, {0, 1e6},
             "Weight of the distance from the last configuration [mm^2].");
    s.choice("solver", m.solver, solver_words,
             "What searches; \"multistart\" is slow, and the reference for the others.");
    s.integer("force_rounds", m.force_rounds, {1, 100},
              "Of \"force\": solves of the pad, in all lanes at once, per match.");
    s.integer("force_iterations", m.force_iterations, {1, 1000}, "Of \"force\": most Newton iterations of each.");
    s.choice("force_norm", m.force_norm, norm_words,
             "Of \"force\": squares of the nodes' force errors, or their sum, which forgives what no pose can render.");
    s.number("normal_weight", m.normal_weight, unit::one, {0, 1e6},
             "Of \"force\": weight of errors along the wanted net force.");
    s.number("tangential_weight", m.tangential_weight, unit::one, {0, 1e6},
             "Of \"force\": weight of errors across it.");
    s.number("net_weight", m.net_weight, unit::one, {0, 1e6}, "Of \"force\": weight of the net force's error.");
    s.number("area_weight", m.area_weight, unit::one, {0, 1e6},
             "Of \"force\": weight of the touching area's error [N^2/mm^4].");
    std::optional<double> speed;
    s.number("joint_speed_deg_per_s", speed, unit::deg_per_s, {1, 1e5},
             "Fastest that a joint may move from one match to the next; without it, as it likes.");
    if (speed) m.joint_speed = *speed;
    s.integer("sideways_starts", m.sideways_starts, {0, 1000},
              "Searches beside the contact, of platforms that can slide along themselves.");
    s.boolean("non_contact", m.non_contact,
              "Keep the platform away from samples that do not touch (Eq. 3's second sum).");
}

/// Numbers of the device itself, over those of its kind. Returns the height of its mount where the file says it.
std::optional<Vec3<double>> read_device_numbers(Section& s, DeviceModel& model) {
    s.number("max_force_N", model.max_force, unit::N, {0.01, 100},
             "Most force of the platform on the finger, in the mode \"force\".");
    s.number("platform_radius_mm", model.disk_radius, unit::mm, {0.11, 99}, "Radius of the platform.");
    s.number("clearance_mm", model.clearance, unit::mm, {0, 9.9},
             "Distance kept from skin that does not touch (eps of Eq. 3).");
    std::optional<double> low, high;
    s.number("joint_min_deg", low, unit::deg, {-180, 180}, "Lower limit of every joint; by default the kind's.");
    s.number("joint_max_deg", high, unit::deg, {-180, 180}, "Upper limit of every joint; by default the kind's.");
    if (high && *high > 0 && *high < 3.2 * unit::deg.si && model.joint_max[0] > 8 * unit::deg.si)
        s.doubt("joint_max_deg", number_text(*high / unit::deg.si) + " looks like radians; degrees are expected");
    if (low) model.joint_min.setConstant(*low);
    if (high) model.joint_max.setConstant(*high);
    if (Section geometry = s.table("geometry_mm", "Lengths of the kind, where yours differs."))
        read_geometry(geometry, model);
    std::optional<Vec3<double>> mount;
    s.vector("mount_mm", mount, unit::mm, 200,
             "Where the device's origin sits in the finger's frame; by default so that the undeformed pad touches the "
             "level platform near the middle of its range.");
    return mount;
}

/// Seated so that the undeformed pad touches the level platform near the middle of its range (chinello-3rrs: dz = 24.6
/// mm): pressing, and then rolling, passes the height at which the device rolls farthest.
void seat(const TetMesh& mesh, DeviceModel& model) {
    double lowest = 0;
    for (const Point& p : mesh.nodes) lowest = std::min(lowest, p[2]);
    model.mount.translation().z() = lowest + model.kind->seat_height;
}

/// Force mode needs a mechanism that can push, and servos whose torque can be limited.
void check_force_mode(Section& s, const ThimbleSpec& t, const DriverSpec& driver) {
    if (!t.force_mode || !s.sound("kind") || !s.sound("joint")) return;
    if (!(torques_for_force(t.model, t.model.rest, 1).norm() > 1e-9))
        return s.complain("mode",
                          "the joints of a " + t.model.kind->name + " cannot push its platform along its normal");
    const bool limits_torque = std::all_of(driver.servos.begin(), driver.servos.end(),
                                           [](const ServoCalibration& c) { return c.torque_per_Nm > 0; });
    if (s.sound("driver") && s.sound("calibration") &&
        (driver.driver.starts_with("maestro") || driver.driver == "text" || !limits_torque))
        s.complain("mode",
                   "a " + driver.driver +
                       " moves its servos to places and cannot limit their force; \"force\" needs a dynamixel or "
                       "feetech bus, calibrated with torque_per_Nm, or a simulated thimble");
}

}  // namespace

const std::vector<NamedDriver>& drivers() {
    static const std::vector<NamedDriver> all{
        {"simulated", "a servo per joint: pulse steps, delay, slew rate (the default)"},
        {"maestro", "Pololu Maestro on USB, 6 to 24 channels; serial, where there are several"},
        {"maestro-dry", "writes the exact USB transfers to maestro_SERIAL.csv in the results"},
        {"maestro-serial", "Pololu Maestro on a tty, by its compact protocol; port"},
        {"dynamixel", "bus servos, protocol 2.0, with measured positions; port"},
        {"feetech", "STS bus servos, with measured positions; port"},
        {"text", "a board of your own (Arduino, ESP32) that speaks lines of text; port"},
    };
    return all;
}

bool counts_ticks(const DriverSpec& d) { return d.driver == "dynamixel" || d.driver == "feetech"; }

void read_device(Section s, int finger, const TetMesh& mesh, const std::filesystem::path& folder, Scene& scene) {
    if (!s) return;
    ThimbleSpec t;
    t.finger = finger;
    std::vector<std::string> kinds = kind_names();
    kinds.emplace_back("chain");
    std::string kind = "chinello-3rrs";
    s.choice("kind", kind, kinds, "Type of device; a chain's joints are stated here.");
    const Chain chain = read_chain(s);
    if (kind != "chain" && s.sound("kind"))
        for (const char* key : {"height_mm", "joint"})
            if (s.has(key)) s.complain(key, "only a chain has it");
    t.model = kind == "chain" ? chain_model(s, chain) : find_kind(kind)->defaults();
    read_matching(s, t);
    int mode = 0;
    s.choice("mode", mode, {"position", "force"},
             "The platform goes to a place, or is pushed with the contact's force (torques of the servos).");
    t.force_mode = mode == 1;
    const auto mount = read_device_numbers(s, t.model);
    if (mount)
        t.model.mount.translation() << mount->x, mount->y, mount->z;
    else
        seat(mesh, t.model);
    if (s.sound("kind") && s.sound("joint"))
        if (const auto wrong = validate(t.model); !wrong.empty()) s.complain_as_found("kind", wrong);
    const DriverKeys driver = read_driver_keys(s);
    scene.drivers.push_back(make_driver(s, driver, t.model, folder));
    check_force_mode(s, t, scene.drivers.back());
    s.finish();
    scene.spec.thimbles.push_back(t);
}

void read_thimble_loop(Section s, Scene& scene) {
    ThimbleLoopSettings& loop = scene.loop;
    s.number("period_ms", loop.period, unit::ms, {1, 1000}, "Time from one command to the next.",
             Likely{5, 100, "s", ""});
    s.number("velocity_rad_per_s", loop.limits.velocity, unit::rad_per_s, slew_bounds::velocity,
             "Fastest that a joint is ever sent.");
    s.number("acceleration_rad_per_s2", loop.limits.acceleration, unit::rad_per_s2, slew_bounds::acceleration,
             "Largest change of that speed.");
    s.number("touch_velocity_rad_per_s", loop.touch_velocity, unit::rad_per_s, {0, slew_bounds::velocity.high},
             "Fastest that a joint approaches a first contact; 0: as fast as ever.");
    if (Section servo = s.table("servo", "Simulated servos.")) {
        ServoModel& m = scene.servo;
        servo.number("pulse_step_us", m.pulse_step_us, unit::us, servo_model_bounds::pulse_step_us,
                     "Resolution of the pulse.");
        servo.number("us_per_rad", m.us_per_rad, unit::us_per_rad, servo_bounds::units_per_rad, "Pulse per angle.");
        servo.number("delay_ms", m.delay_s, unit::ms, in(unit::ms, servo_model_bounds::delay_s),
                     "The pulse that is read is that old.");
        servo.number("slew_rad_per_s", m.slew_rad_per_s, unit::rad_per_s, servo_model_bounds::slew_rad_per_s,
                     "Its own largest speed.");
        servo.finish();
    }
    s.finish();
}

namespace {

/// What a board is called however it is written: a port by the device that it leads to.
std::string board_of(const DriverSpec& d) {
    if (d.driver == "simulated") return "";
    if (d.port.empty()) return d.driver + " " + d.serial;
    std::error_code none;
    const auto port = std::filesystem::weakly_canonical(d.port, none);
    return none ? d.port : port.string();
}

}  // namespace

void check_boards(const Scene& scene, Problems& problems) {
    const auto& drivers = scene.drivers;
    auto wearer = [&](std::size_t t) {
        return "\"" + scene.spec.fingers[std::size_t(scene.spec.thimbles[t].finger)].name + "\"";
    };
    for (std::size_t b = 0; b < drivers.size(); ++b) {
        if (const DriverSpec& d = drivers[b]; d.driver != "simulated" && d.driver != "maestro-dry" && !d.calibrated)
            problems.warnings.push_back(problems.placed(
                nullptr, "the thimble of finger " + wearer(b) +
                             " has no calibration: its servos are taken to sit as their "
                             "maker built them, and it should not be armed (`palpate calibrate-thimble`)"));
        for (std::size_t a = 0; a < b; ++a) {
            const std::string both = "the thimbles of fingers " + wearer(a) + " and " + wearer(b);
            const DriverSpec &x = drivers[a], &y = drivers[b];
            const std::string board = board_of(y);
            if (board.empty() || board_of(x).empty()) continue;
            if (x.driver == y.driver && x.port.empty() && x.serial.empty() != y.serial.empty())
                problems.add(nullptr, both + " may share a board under two names: one says serial = \"" + x.serial +
                                          y.serial + "\", the other takes whichever there is; give both their serial");
            if (board_of(x) != board) continue;
            if (x.driver != y.driver)
                problems.add(nullptr, both + " speak to one port as " + x.driver + " and as " + y.driver);
            else if (x.port != y.port)
                problems.add(nullptr, both + " name one board in two ways: " + x.port + " and " + y.port);
            for (int c : y.channels)
                if (std::find(x.channels.begin(), x.channels.end(), c) != x.channels.end()) {
                    problems.add(nullptr, both + " both drive channel " + std::to_string(c) + " of one board");
                    break;
                }
        }
    }
}

}  // namespace palpate
