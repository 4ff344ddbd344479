// `palpate jog` and `palpate calibrate-thimble`: servos moved from the keyboard, through the same limits as always.

#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <thread>

#include "meshes/input_error.h"
#include "scenes/load/load_devices.h"
#include "scenes/program/commands.h"
#include "scenes/run/hardware.h"

namespace palpate {

namespace {

/// Keys one at a time, from a terminal or from a pipe.
class Keyboard {
  public:
    Keyboard() {
        if (!isatty(STDIN_FILENO) || tcgetattr(STDIN_FILENO, &before_) != 0) return;
        termios raw = before_;
        raw.c_lflag &= ~tcflag_t(ICANON | ECHO);
        changed_ = tcsetattr(STDIN_FILENO, TCSANOW, &raw) == 0;
    }
    ~Keyboard() {
        if (changed_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
    }
    Keyboard(const Keyboard&) = delete;
    Keyboard& operator=(const Keyboard&) = delete;
    /// A key, 0 if none came for 20 ms, -1 at the end of input.
    int next() {
        pollfd p{STDIN_FILENO, POLLIN, 0};
        if (::poll(&p, 1, 20) <= 0) return 0;
        char c;
        return ::read(STDIN_FILENO, &c, 1) == 1 ? static_cast<unsigned char>(c) : -1;
    }

  private:
    termios before_{};
    bool changed_ = false;
};

struct JogArguments {
    std::string scene, finger, out;
    std::vector<std::string> overrides;
    bool no_watchdog = false;
};

int thimble_of_finger(const Scene& scene, const std::string& name) {
    std::string all;
    for (std::size_t t = 0; t < scene.spec.thimbles.size(); ++t) {
        const std::string& finger = scene.spec.fingers[std::size_t(scene.spec.thimbles[t].finger)].name;
        if (name.empty() || finger == name) return int(t);
        all += (all.empty() ? "" : ", ") + finger;
    }
    throw InputError(scene.file.string() + ": --finger: expected a finger with a thimble" +
                     (all.empty() ? "; none has one" : " (" + all + ")") + ", found \"" + name + "\"");
}

/// One thimble under the keyboard; the others keep their rest pose.
struct Jog {
    Simulation s;
    std::size_t thimble;
    Coordinates target;  ///< joint angles [rad]

    Jog(Scene scene, std::size_t which, bool no_watchdog) : s(make_simulation(std::move(scene), 1)), thimble(which) {
        arm(s, {!no_watchdog, ".", false});  // this is how a calibration is found
        target = newest_report(*s.hardware, int(thimble)).sent;
    }
    ThimbleLoop& loop() { return *s.loops[thimble]; }
    void publish() { loop().mailbox.publish({0, target, true}); }
    void move_joint(int j, double by) {
        const DeviceModel& m = loop().model;
        target[j] = std::clamp(target[j] + by, m.joint_min[j], m.joint_max[j]);
    }
    const ThimbleReport& report() { return newest_report(*s.hardware, int(thimble)); }
};

void show(Jog& jog, int chosen, const Coordinates* w) {
    const ThimbleReport& r = jog.report();
    const DeviceModel& m = jog.loop().model;
    std::string line = "\r";
    char part[96];
    for (int j = 0; j < r.sent.size(); ++j) {
        std::snprintf(part, sizeof part, "%s%d: %6.1f [%.0f, %.0f]  ", j == chosen ? "*" : " ", j + 1,
                      r.sent[j] / degree, m.joint_min[j] / degree, m.joint_max[j] / degree);
        line += part;
    }
    for (int i = 0; w && i < w->size(); ++i) {
        const bool length = m.kind->configuration_is_length[std::size_t(i)];
        std::snprintf(part, sizeof part, " %s %.1f %s", m.kind->configuration_names[std::size_t(i)].c_str(),
                      (*w)[i] / (length ? 1e-3 : degree), length ? "mm" : "deg");
        line += part;
    }
    std::fprintf(stderr, "%s %-10s", line.c_str(), name(r.status.mode));
}

int jog_thimble(const JogArguments& a, const std::atomic<bool>& stop) {
    Scene scene = load_scene(a.scene, a.overrides);
    const int t = thimble_of_finger(scene, a.finger);
    Jog jog(std::move(scene), std::size_t(t), a.no_watchdog);
    const DeviceModel& m = jog.loop().model;
    const DeviceKind& kind = *m.kind;
    Coordinates w = m.rest;
    bool by_pose = false;
    int joint = 0;
    std::fprintf(stderr, "1-%d choose a joint, + - move it by a degree; ", kind.joint_count);
    const std::string up = "tpdxyz", down = "TPDXYZ";
    for (std::size_t i = 0; i < kind.configuration_names.size(); ++i)
        std::fprintf(stderr, "%c %c move %s; ", up[i], down[i], kind.configuration_names[i].c_str());
    std::fprintf(stderr, "h rest pose, r re-arm after a fault, q end\n");
    Keyboard keys;
    while (!stop) {
        const int key = keys.next();
        if (key < 0 || key == 'q') break;
        if (key >= '1' && key < '1' + kind.joint_count) joint = key - '1';
        if (key == '+' || key == '-') jog.move_joint(joint, (key == '+' ? 1 : -1) * degree), by_pose = false;
        if (key == 'r') jog.loop().rearm_asked = true;
        if (key == 'h') w = m.rest, by_pose = true, jog.target = kind.joints(m, w).q;
        for (std::size_t i = 0; i < kind.configuration_names.size(); ++i) {
            if (key == 0 || (key != up[i] && key != down[i])) continue;
            Coordinates next = w;
            next[std::ptrdiff_t(i)] +=
                (key == up[i] ? 1 : -1) * (kind.configuration_is_length[i] ? 0.25e-3 : 1 * degree);
            if (!inside_workspace(m, next)) {
                std::fprintf(stderr, "\a");
                continue;
            }
            w = next;
            by_pose = true;
            jog.target = kind.joints(m, w).q;
        }
        jog.publish();
        show(jog, joint, by_pose ? &w : nullptr);
    }
    disarm(jog.s);
    bool rests = true;
    std::fprintf(stderr, "\n%s%s", hardware_report(jog.s).c_str(), rest_report(jog.s, rests).c_str());
    return 0;
}

/// Lets the user move one joint until Enter; false at the end of input.
bool place(Jog& jog, int joint, const std::string& question, const std::atomic<bool>& stop, Keyboard& keys) {
    std::fprintf(stderr, "\n%s; + - by a degree, > < by ten, Enter when it is there, q gives up\n", question.c_str());
    while (!stop) {
        const int key = keys.next();
        if (key < 0 || key == 'q') return false;
        if (key == '+' || key == '-') jog.move_joint(joint, (key == '+' ? 1 : -1) * degree);
        if (key == '>' || key == '<') jog.move_joint(joint, (key == '>' ? 10 : -10) * degree);
        jog.publish();
        show(jog, joint, nullptr);
        if (key != '\n' && key != '\r') continue;
        // What counts is where the servo is told to be, not where it is on its way to.
        for (int k = 0; k < 500 && (jog.report().sent - jog.target).cwiseAbs().maxCoeff() > 1e-6 && !stop; ++k) {
            jog.publish();
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        return true;
    }
    return false;
}

int calibrate_thimble(const JogArguments& a, const std::atomic<bool>& stop) {
    Scene scene = load_scene(a.scene, a.overrides);
    const auto t = std::size_t(thimble_of_finger(scene, a.finger));
    DriverSpec& driver = scene.drivers[t];
    if (driver.driver == "simulated") throw InputError(a.scene + ": this finger's thimble is simulated");
    const bool ticks = driver.driver == "dynamixel" || driver.driver == "feetech";
    // Until it is known how the servos sit, an angle is no more than a share of what the controller may send.
    DeviceModel& m = scene.spec.thimbles[t].model;
    for (std::size_t j = 0; j < driver.servos.size(); ++j) {
        ServoCalibration& c = driver.servos[j];
        c = ticks ? ServoCalibration{2048, 651.9, 512, 3584} : ServoCalibration{};
        m.joint_min[std::ptrdiff_t(j)] = (c.min - c.zero) / c.units_per_rad;
        m.joint_max[std::ptrdiff_t(j)] = (c.max - c.zero) / c.units_per_rad;
    }
    const std::vector<ServoCalibration> provisional = driver.servos;
    ThimbleCalibration result{driver.serial, driver.channels, provisional};
    Jog jog(std::move(scene), t, a.no_watchdog);
    Keyboard keys;
    for (int j = 0; j < int(provisional.size()); ++j) {
        ServoCalibration& c = result.servos[std::size_t(j)];
        const ServoCalibration& p = provisional[std::size_t(j)];
        auto units = [&] { return p.zero + p.units_per_rad * jog.target[j]; };
        const std::string servo =
            "servo " + std::to_string(j + 1) + " (channel " + std::to_string(result.channels[std::size_t(j)]) + "): ";
        double at[4];
        const char* questions[] = {"move it to joint angle 0", "move it to joint angle +30 degrees",
                                   "move it to the lowest angle that it may ever take",
                                   "move it to the highest angle that it may ever take"};
        for (int k = 0; k < 4; ++k) {
            if (!place(jog, j, servo + questions[k], stop, keys)) {
                std::fprintf(stderr, "\ngiven up; nothing was written\n");
                return 130;
            }
            at[k] = units();
        }
        c = {at[0], (at[1] - at[0]) / (30 * degree), std::min(at[2], at[3]), std::max(at[2], at[3])};
        for (const auto& sentence : c.validate()) throw InputError(servo + sentence + "; nothing was written");
    }
    disarm(jog.s);
    write_calibration(a.out, result, ticks ? "ticks" : "us");
    std::printf("\n%s written; in the scene: device = { ..., calibration = \"%s\" }\n", a.out.c_str(), a.out.c_str());
    return 0;
}

void add_arguments(const Command& c, const std::shared_ptr<JogArguments>& a) {
    c.scene("scene", a->scene, "scene file (.toml) or bare name whose thimble it is").required();
    c.option("--finger", a->finger, "the finger (default: the first with a thimble)");
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.flag("--no-watchdog", a->no_watchdog, "also with controllers whose watchdog is off");
}

}  // namespace

Action add_jog_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c = program.subcommand("jog", "move a thimble from the keyboard");
    auto a = std::make_shared<JogArguments>();
    add_arguments(c, a);
    return [a, &stop] { return jog_thimble(*a, stop); };
}

Action add_calibrate_thimble_command(const Command& program, const std::atomic<bool>& stop) {
    const Command c =
        program.subcommand("calibrate-thimble", "find zero, direction, scale and range of a thimble's servos");
    auto a = std::make_shared<JogArguments>();
    add_arguments(c, a);
    c.option("--out", a->out, "calibration file to write").required();
    return [a, &stop] { return calibrate_thimble(*a, stop); };
}

}  // namespace palpate
