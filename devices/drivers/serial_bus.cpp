#include "devices/drivers/serial_bus.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "devices/drivers/compact_link.h"
#include "devices/drivers/serial_targets.h"
#include "devices/drivers/servo_modes.h"
#include "devices/loop/clock.h"

namespace palpate {

namespace {

using Clock = SerialLine::Clock;
using std::chrono::milliseconds;

constexpr int attempts = 4;                          ///< to get an answer, while nothing moves yet
constexpr int watchdog_ticks = 10;                   ///< of a Dynamixel, 20 ms each
constexpr int least_place = 1, most_place = 0x7fff;  ///< [ticks]; also what stands for all that lies beyond

/// Dynamixel and Feetech bus servos. The line is half-duplex: nothing is said before an answer has come, or is overdue.
class ServoBus final : public BoardLink {
  public:
    explicit ServoBus(SerialBusSettings settings)
        : settings_(std::move(settings)),
          dynamixel_(settings_.protocol == SerialProtocol::dynamixel),
          reader_(dynamixel_ ? StatusReader::Protocol::dynamixel : StatusReader::Protocol::feetech) {
        measures = true;
        steps_per_unit = 1;
        if (settings_.baud == 0) settings_.baud = dynamixel_ ? 57600 : 1000000;
    }

    std::string open(std::span<WireValue> positions) override;
    void close() override;
    LinkProblem activate() override;
    void deactivate() override {
        watching_ = false;
        switch_torque_off(settings_.channels);
    }
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        return write_in_one(line_, dynamixel_ ? dynamixel::write_targets(targets) : feetech::write_targets(targets),
                            10.0 / settings_.baud, transfers);
    }
    LinkProblem write_torques(std::span<const ChannelTarget> limits) override {
        return line_.write(dynamixel_ ? dynamixel::write_torques(limits) : feetech::write_torques(limits));
    }
    LinkProblem feed() override;
    LinkProblem read(std::span<const int> channels, std::span<WireValue> positions) override;
    LinkProblem limit_speed(double share) override;
    bool write_in_signal(std::span<const ChannelTarget> targets) noexcept override {
        return write_now(line_.fd(), settings_.protocol, targets);
    }

  private:
    struct Register {
        int address, size;
        const char* name;
    };
    LinkProblem send_all(const Register& r, std::span<const int> ids, int value) const;
    std::optional<StatusPacket> answer(Clock::time_point end);
    Clock::time_point reply_deadline(std::size_t replies, int size) const;
    int ask(int id, const Register& r);
    void set(int id, const Register& r, int value);
    LinkProblem read_all(const Register& r, std::span<const int> ids, std::map<int, int>& values);
    LinkProblem problem_of(const StatusPacket& p);
    void find_all(std::span<WireValue> positions);
    void let_go(int id);
    void use_mode(int id);
    void prepare(int id, int position);
    int own_speed(double share) const;
    LinkProblem started_anew(const Register& r, int id, int value) const;
    void switch_torque_off(std::span<const int> ids);
    bool limits_force(int id) const {
        return std::find(settings_.force_channels.begin(), settings_.force_channels.end(), id) !=
               settings_.force_channels.end();
    }
    Register torque_enable() const {
        return {dynamixel_ ? dynamixel::torque_enable : feetech::torque_enable, 1, "torque switch"};
    }
    Register goal() const {
        return {dynamixel_ ? dynamixel::goal_position : feetech::goal_position, dynamixel_ ? 4 : 2, "goal position"};
    }
    Register speed() const {
        return {dynamixel_ ? dynamixel::profile_velocity : feetech::goal_speed, dynamixel_ ? 4 : 2, "speed limit"};
    }
    static constexpr Register watchdog{dynamixel::bus_watchdog, 1, "watchdog"};

    mutable SerialLine line_{};
    SerialBusSettings settings_;
    bool dynamixel_;
    StatusReader reader_;
    double asked_ = 0;  ///< when servos answered last [s of device_clock]
    std::size_t next_turn_ = 0;
    bool watching_ = false;  ///< activated: registers that forget what was set tell of a servo that started anew
};

/// When `replies` of so many bytes of data must all have come.
Clock::time_point ServoBus::reply_deadline(std::size_t replies, int size) const {
    const double bytes = 30 + double(replies) * (size + 15);
    return Clock::now() + milliseconds(25 + int(1.5e4 * bytes / settings_.baud));
}

std::optional<StatusPacket> ServoBus::answer(Clock::time_point end) {
    while (true) {
        if (auto p = reader_.next()) return p;
        const Bytes bytes = line_.read(end);
        if (bytes.empty()) return std::nullopt;
        reader_.add(bytes);
    }
}

/// What a servo's error byte says.
LinkProblem ServoBus::problem_of(const StatusPacket& p) {
    if (p.error == 0) return {};
    if (!dynamixel_) return feetech::problem_of(p.id, p.error);
    int hardware = 0;
    if (p.error & 0x80) {
        line_.write(dynamixel::read_register(std::uint8_t(p.id), dynamixel::hardware_error, 1));
        const auto reply = answer(reply_deadline(1, 1));
        if (reply && reply->id == p.id && reply->parameters.size() == 1) hardware = reply->parameters[0];
    }
    return dynamixel::problem_of(p.id, p.error, hardware);
}

/// One register of several servos, each of which has to answer once, for itself.
LinkProblem ServoBus::read_all(const Register& r, std::span<const int> ids, std::map<int, int>& values) {
    line_.discard();
    reader_.clear();
    if (const auto p = line_.write(dynamixel_ ? dynamixel::read_all(r.address, r.size, ids)
                                              : feetech::read_all(r.address, r.size, ids)))
        return p;
    const auto end = reply_deadline(ids.size(), r.size);
    std::optional<StatusPacket> complaint;
    LinkProblem problem;
    for (std::size_t replies = 0; replies < ids.size(); ++replies) {
        const auto p = answer(end);
        if (!p) break;
        const std::string servo = "servo " + std::to_string(p->id);
        if (std::find(ids.begin(), ids.end(), p->id) == ids.end() || values.count(p->id)) {
            problem = {servo + (values.count(p->id) ? " answers twice" : " answers and was not asked"), false,
                       FaultKind::wrong_servo};
            continue;
        }
        if (p->error) complaint = p;
        if (int(p->parameters.size()) != r.size) {
            if (!p->error) problem = {servo + " answers with another length", false, FaultKind::bad_reply};
            continue;
        }
        std::uint32_t value = 0;
        for (int k = 0; k < r.size; ++k) value |= std::uint32_t(p->parameters[std::size_t(k)]) << 8 * k;
        values[p->id] = int(value);
    }
    asked_ = device_clock();
    return complaint ? problem_of(*complaint) : problem;
}

/// Asked again where the answer is missing or another one: on a busy computer what answers the request before may come
/// late, in its place.
int ServoBus::ask(int id, const Register& r) {
    const int ids[] = {id};
    std::string problem;
    for (int attempt = 0; attempt < attempts; ++attempt) {
        if (attempt > 0) answer(Clock::now() + milliseconds(20 * attempt));  // what is late
        std::map<int, int> values;
        const LinkProblem found = read_all(r, ids, values);
        if (!found && values.count(id)) return values[id];
        problem = found ? found.text : "servo " + std::to_string(id) + " does not tell its " + r.name;
        if (found.lost || found.kind == FaultKind::reported || found.kind == FaultKind::wrong_servo) break;
    }
    throw std::runtime_error(settings_.port + ": " + problem);
}

/// Writes a register of one servo, awaits its answer, and reads it back.
void ServoBus::set(int id, const Register& r, int value) {
    line_.discard();
    reader_.clear();
    const auto servo = std::uint8_t(id);
    const auto wide = std::uint32_t(value);
    const LinkProblem problem = line_.write(dynamixel_ ? dynamixel::write_register(servo, r.address, r.size, wide)
                                                       : feetech::write_register(servo, r.address, r.size, wide));
    if (problem) throw std::runtime_error(settings_.port + ": " + problem.text);
    answer(Clock::now() + milliseconds(20));  // some are set to be silent: what counts is what is read back
    if (const int now = ask(id, r); now != value)
        throw std::runtime_error(settings_.port + ": servo " + std::to_string(id) + " does not keep its " + r.name +
                                 ": " + std::to_string(value) + " reads back as " + std::to_string(now));
}

int ServoBus::own_speed(double share) const {
    const double ticks = share * settings_.speed_units_per_s;
    const double units = dynamixel_ ? ticks / 4096 * 60 / 0.229 : ticks;  // 0.229 turns a minute
    return int(std::clamp(std::ceil(units), 1.0, 32000.0));
}

/// Torque off, so that its mode may be changed, and it cannot move while it is.
void ServoBus::let_go(int id) {
    if (dynamixel_) set(id, watchdog, 0);  // one that has bitten refuses everything else
    set(id, torque_enable(), 0);
    use_mode(id);
}

/// Modes are kept without supply, and another program may have set any. They are read, and refused by name; only what
/// force mode needs is set, and taken back, for a run that was killed leaves it behind.
void ServoBus::use_mode(int id) {
    const Register mode{dynamixel_ ? dynamixel::operating_mode : feetech::mode, 1, "operating mode"};
    const auto refuse = [&](const std::string& problem) {
        if (!problem.empty())
            throw std::runtime_error(settings_.port + ": servo " + std::to_string(id) + " is in " + problem);
    };
    if (!dynamixel_) return refuse(feetech_mode_problem(ask(id, mode)));
    refuse(dynamixel_drive_problem(ask(id, {dynamixel::drive_mode, 1, "drive mode"})));
    if (!limits_force(id)) {
        const int found = ask(id, mode);
        if (found == int(dynamixel::current_based_position)) return set(id, mode, dynamixel::plain_position);
        return refuse(dynamixel_mode_problem(found));
    }
    try {
        set(id, mode, dynamixel::current_based_position);
    } catch (const std::runtime_error& error) {
        throw std::runtime_error(std::string(error.what()) +
                                 "; it has no current-based position mode, which mode = \"force\" needs");
    }
}

/// Goal where the servo is, limits; nothing moves.
void ServoBus::prepare(int id, int position) {
    if (position <= least_place || position >= most_place)  // told to hold still, it would turn
        throw std::runtime_error(settings_.port + ": servo " + std::to_string(id) +
                                 " stands beyond what can be commanded: turn it back by hand, without its supply");
    if (limits_force(id) && dynamixel_)
        set(id, {dynamixel::goal_current, 2, "goal current"}, 0);  // no force before the first limit comes
    const double acceleration = settings_.acceleration_units_per_s2;
    if (acceleration > 0 && dynamixel_)  // 214.577 turns per minute^2
        set(id, {dynamixel::profile_acceleration, 4, "acceleration limit"},
            int(std::clamp(std::ceil(acceleration / 4096 * 3600 / 214.577), 1.0, 32767.0)));
    if (acceleration > 0 && !dynamixel_)  // 100 steps/s^2; 0 is none, where more is asked for than it counts
        set(id, {feetech::acceleration, 1, "acceleration limit"},
            acceleration <= 25400 ? int(std::ceil(acceleration / 100)) : 0);
    if (settings_.speed_units_per_s > 0) set(id, speed(), own_speed(first_move_share));
    set(id, goal(), position);
}

/// Where all servos are; asked again, as in ask().
void ServoBus::find_all(std::span<WireValue> positions) {
    std::string wrong;
    for (int attempt = 0; attempt < attempts; ++attempt) {
        if (attempt > 0) answer(Clock::now() + milliseconds(20 * attempt));
        const LinkProblem problem = read(settings_.channels, positions);
        wrong = problem.text;
        for (int c : settings_.channels)
            if (positions[std::size_t(c)] == no_pulse && !problem)
                wrong = "no servo answers with id " + std::to_string(c);
        if (wrong.empty()) return;
        if (problem.lost) break;
    }
    throw std::runtime_error(settings_.port + ": " + wrong);
}

std::string ServoBus::open(std::span<WireValue> positions) try {
    close();
    line_.open(settings_.port, settings_.baud);
    watching_ = false;
    find_all(positions);
    for (int c : settings_.channels) let_go(c);
    find_all(positions);  // places count anew in another mode, and what is let go may sag
    for (int c : settings_.channels) prepare(c, positions[std::size_t(c)]);
    return "";
} catch (const std::exception& error) {
    close();
    return error.what();
}

LinkProblem ServoBus::activate() try {
    for (int c : settings_.channels) set(c, torque_enable(), 1);
    if (dynamixel_)
        for (int c : settings_.channels) set(c, watchdog, watchdog_ticks);
    watching_ = true;
    return {};
} catch (const std::exception& error) { return {error.what(), true, FaultKind::refused}; }

LinkProblem ServoBus::send_all(const Register& r, std::span<const int> ids, int value) const {
    std::vector<ChannelTarget> values;
    for (int id : ids) values.push_back({id, WireValue(value)});
    if (values.empty()) return {};
    return line_.write(dynamixel_ ? dynamixel::write_all(r.address, r.size, values)
                                  : feetech::write_all(r.address, r.size, values));
}

LinkProblem ServoBus::limit_speed(double share) {
    return settings_.speed_units_per_s > 0 ? send_all(speed(), settings_.channels, own_speed(share)) : LinkProblem{};
}

/// Each servo is told by itself, too: one whose checksum went wrong in the packet for all must not hold on.
void ServoBus::switch_torque_off(std::span<const int> ids) {
    if (!line_.is_open()) return;
    if (dynamixel_) send_all(watchdog, ids, 0);  // one that has bitten refuses
    send_all(torque_enable(), ids, 0);
}

void ServoBus::close() {
    // The servos keep their mode: back to plain positions, let go, for whoever uses them next.
    if (line_.is_open() && dynamixel_ && !settings_.force_channels.empty()) {
        switch_torque_off(settings_.force_channels);
        send_all({dynamixel::operating_mode, 1, ""}, settings_.force_channels, dynamixel::plain_position);
    }
    line_.close();
    reader_.clear();
}

/// A servo whose supply failed for a moment answers as ever, but holds nothing, and has forgotten what was set since.
LinkProblem ServoBus::started_anew(const Register& r, int id, int value) const {
    const std::string servo = "servo " + std::to_string(id);
    if (dynamixel_ && value == 0xFF)
        return {"the watchdog of " + servo + " has bitten: it does not listen any more", true, FaultKind::watchdog};
    const bool kept = dynamixel_ ? value == watchdog_ticks : value != 0;  // a speed limit changes after the first move
    if (!watching_ || kept) return {};
    return {servo + " has started anew, as where its supply fails for a moment: its " + r.name + " is " +
                std::to_string(value) + ", and was set",
            true, FaultKind::watchdog};
}

/// One servo in each turn, all after a pause, before anything is sent: watchdogs; a Feetech servo, which has none, is
/// asked for its torque switch and its speed limit, by turns.
LinkProblem ServoBus::feed() {
    if (settings_.channels.empty()) return {};
    if (!line_.is_open()) return {"the serial port is not open", true};
    const bool all = device_clock() - asked_ > ask_first_after;
    const std::size_t count = settings_.channels.size(), turn = next_turn_++, of = turn % count;
    const bool limited = settings_.speed_units_per_s > 0;
    const Register r = dynamixel_ ? watchdog : limited && turn / count % 2 ? speed() : torque_enable();
    const std::span<const int> ids(settings_.channels);
    std::map<int, int> values;
    const LinkProblem problem = read_all(r, all ? ids : ids.subspan(of, 1), values);
    for (const auto& [id, value] : values)
        if (const LinkProblem found = started_anew(r, id, value)) return found;
    if (!problem && values.empty())
        return {"servo " + std::to_string(ids[of]) + " does not answer", false, FaultKind::silent};
    return problem;
}

LinkProblem ServoBus::read(std::span<const int> channels, std::span<WireValue> positions) {
    std::map<int, int> values;
    const Register present{dynamixel_ ? dynamixel::present_position : feetech::present_position, dynamixel_ ? 4 : 2,
                           ""};
    if (channels.empty()) return {};
    const LinkProblem problem = read_all(present, channels, values);
    for (const auto& [id, raw] : values) {
        // Below zero, and beyond what counts here: no finger thimble gets there.
        const int value = !dynamixel_ && raw & 0x8000 ? -(raw & 0x7fff) : raw;
        positions[std::size_t(id)] = WireValue(std::clamp(value, least_place, most_place));
    }
    return problem;
}

}  // namespace

std::unique_ptr<BoardLink> make_serial_bus(const SerialBusSettings& settings) {
    if (settings.need_watchdog && settings.protocol != SerialProtocol::dynamixel)
        throw std::runtime_error(
            settings.port +
            ": this protocol cannot tell whether servos let go when this program is killed; --no-watchdog goes on");
    if (settings.protocol == SerialProtocol::maestro_compact) return make_compact_link(settings);
    return std::make_unique<ServoBus>(settings);
}

}  // namespace palpate
