// Calibration files: how a thimble's servos sit, and what that leaves of its joints' ranges.

#include <toml++/toml.h>
#include <algorithm>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/load/load_devices.h"

namespace palpate {

namespace {

std::string units_text(const DriverSpec& d, double units) {
    return number_text(std::round(units)) + (counts_ticks(d) ? " ticks" : " us");
}
std::string in_units(const DriverSpec& d, const ServoCalibration& servo, double angle) {
    return units_text(d, servo.zero + servo.units_per_rad * angle);
}
std::string range_of(const DriverSpec& d, const ServoCalibration& servo) {
    return units_text(d, servo.min) + " to " + units_text(d, servo.max);
}
std::string servo_of(const DriverSpec& d, std::size_t j) {
    return "servo " + std::to_string(j + 1) +
           (j < d.channels.size() ? " (channel " + std::to_string(d.channels[j]) + ")" : "");
}

}  // namespace

std::string lost_range(const DriverSpec& d, std::size_t j, const DeviceModel& model) {
    const ServoCalibration& servo = d.servos[j];
    const double low = model.joint_min[std::ptrdiff_t(j)], high = model.joint_max[std::ptrdiff_t(j)];
    const double lost = cut_off(servo, low) + cut_off(servo, high);
    if (!(lost > 0)) return "";
    const bool turned = servo.units_per_rad < 0;
    return servo_of(d, j) + " needs " + in_units(d, servo, turned ? high : low) + " to " +
           in_units(d, servo, turned ? low : high) + " for its joint, and its range is " + range_of(d, servo) + ": " +
           number_text(std::round(lost / std::abs(servo.units_per_rad) / degree * 10) / 10) + " degrees (" +
           units_text(d, lost) + ") are lost";
}

void check_ranges(Section& s, const std::string& file, const DeviceModel& model, const DriverSpec& d) {
    const Coordinates rest = model.kind->joints(model, model.rest).q;
    for (std::size_t j = 0; j < d.servos.size(); ++j) {
        const auto joint = std::ptrdiff_t(j);
        const ServoCalibration& servo = d.servos[j];
        if (cut_off(servo, rest[joint]) > 0)
            return s.complain("calibration", file + ": the rest pose is at " + in_units(d, servo, rest[joint]) +
                                                 " of " + servo_of(d, j) + ", outside of its range, " +
                                                 range_of(d, servo) + ": widen the range, or calibrate it anew");
        if (const std::string lost = lost_range(d, j, model); !lost.empty()) s.doubt("calibration", file + ": " + lost);
    }
}

namespace {

/// The keys of a servo in one unit: zero_us, us_per_rad, ... or zero_ticks, ticks_per_rad, ...
struct ServoKeys {
    ServoCalibration values;
    std::vector<std::string> keys;
};

ServoKeys read_servo_keys(Section& s, bool ticks) {
    ServoKeys k;
    if (ticks) k.values = dynamixel_calibration;
    ServoCalibration& v = k.values;
    const std::string name = ticks ? "ticks" : "us";
    const Unit& one = ticks ? unit::ticks : unit::us;
    const Unit& slope = ticks ? unit::ticks_per_rad : unit::us_per_rad;
    k.keys = {"zero_" + name, name + "_per_rad", "min_" + name, "max_" + name};
    const auto usual = ticks ? std::nullopt : std::optional<Likely>(Likely{0, 2600, "", "ticks"});
    s.number(k.keys[0], v.zero, one, servo_bounds::units, "At joint angle 0.", usual);
    s.number(k.keys[1], v.units_per_rad, slope, {-servo_bounds::units_per_rad.high, servo_bounds::units_per_rad.high},
             "Per joint angle; negative where the servo turns the other way.");
    s.number(k.keys[2], v.min, one, servo_bounds::units, "Least that may ever be sent.");
    s.number(k.keys[3], v.max, one, servo_bounds::units, "Most that may ever be sent.", usual);
    return k;
}

ThimbleCalibration read_calibration_keys(Section& root) {
    ThimbleCalibration c;
    root.text("serial", c.serial, "USB serial number of the Maestro.");
    int unit = 0;
    root.choice("unit", unit, {"us", "ticks"},
                "What its servos count: microseconds of pulse, or ticks of a bus servo.");
    c.ticks = unit == 1;
    for (Section& s : root.tables("servo", "One per joint, in the order of the joints.")) {
        int channel = int(c.channels.size());
        s.integer("channel", channel, {0, max_channels - 1},
                  "Channel, or bus id, as the device's `channels` where that is given; by default the joint's place.");
        c.says_channels |= s.has("channel");
        if (std::find(c.channels.begin(), c.channels.end(), channel) != c.channels.end())
            s.complain("channel", "channel " + std::to_string(channel) + " is that of another [[servo]], too");
        const ServoKeys in_us = read_servo_keys(s, false), in_ticks = read_servo_keys(s, true);
        for (const std::string& key : c.ticks ? in_us.keys : in_ticks.keys)
            if (s.has(key) && root.sound("unit"))
                s.complain(key, std::string("the file's unit is ") + (c.ticks ? "ticks" : "us"));
        ServoCalibration v = c.ticks ? in_ticks.values : in_us.values;
        s.number("torque_per_Nm", v.torque_per_Nm, unit::per_Nm, servo_bounds::torque_per_Nm,
                 "Torque limit of 1 N m, in the servo's units; 0: it has none. By default a Dynamixel's where the unit "
                 "is ticks.");
        s.number("torque_max", v.torque_max, unit::one, servo_bounds::torque_max,
                 "Most that may ever be sent as torque limit.");
        if (s.sound(in_us.keys[0]))
            if (const auto wrong = v.validate(); !wrong.empty())
                s.complain_as_found(c.ticks ? in_ticks.keys[0] : in_us.keys[0], wrong);
        s.finish();
        c.channels.push_back(channel);
        c.servos.push_back(v);
    }
    root.finish();
    return c;
}

}  // namespace

KeyInfo calibration_keys() {
    KeyInfo keys;
    keys.name = "calibration";
    keys.sentence = "A file that `calibration = \"...\"` names: how a thimble's servos sit.";
    Problems none;
    Section root(nullptr, "", none, &keys);
    read_calibration_keys(root);
    return keys;
}

ThimbleCalibration read_calibration(const std::filesystem::path& file) {
    Problems problems{file, {}};
    const toml::table table = parse_toml(file);
    Section root(&table, "", problems);
    ThimbleCalibration c = read_calibration_keys(root);
    if (!problems.messages.empty()) throw InputError(problems.messages);
    return c;
}

void write_calibration(const std::filesystem::path& file, const ThimbleCalibration& c, const std::string& unit) {
    PlainText out;
    out << "# Calibration of a thimble's servos, one per joint.\nserial = \"" << c.serial << "\"\nunit = \"" << unit
        << "\"\n";
    for (std::size_t i = 0; i < c.servos.size(); ++i)
        out << "\n[[servo]]\nchannel = " << c.channels[i] << "\nzero_" << unit << " = " << c.servos[i].zero << "\n"
            << unit << "_per_rad = " << c.servos[i].units_per_rad << "\nmin_" << unit << " = " << c.servos[i].min
            << "\nmax_" << unit << " = " << c.servos[i].max << "\ntorque_per_Nm = " << c.servos[i].torque_per_Nm
            << "\ntorque_max = " << c.servos[i].torque_max << "\n";
    write_file(file, out.str());
}

}  // namespace palpate
