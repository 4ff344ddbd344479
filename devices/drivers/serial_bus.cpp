#include "devices/drivers/serial_bus.h"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "devices/drivers/serial_protocol.h"

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;

/// A tty in raw mode.
class Line {
  public:
    ~Line() { close(); }
    void open(const std::string& port, int baud) {
        fd_ = ::open(port.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        if (fd_ < 0) throw std::runtime_error(port + " cannot be opened: " + std::strerror(errno));
        termios t{};
        if (tcgetattr(fd_, &t) != 0) throw std::runtime_error(port + " is not a serial port");
        cfmakeraw(&t);
        t.c_cflag |= CLOCAL | CREAD;
        const speed_t speed = baud == 1000000 ? B1000000 : baud == 115200 ? B115200 : B57600;
        cfsetispeed(&t, speed);
        cfsetospeed(&t, speed);
        if (tcsetattr(fd_, TCSANOW, &t) != 0) throw std::runtime_error(port + ": its speed cannot be set");
        tcflush(fd_, TCIOFLUSH);
    }
    void close() {
        if (fd_ >= 0) ::close(fd_);
        fd_ = -1;
    }
    bool is_open() const { return fd_ >= 0; }
    /// All of it within 100 ms, or what went wrong.
    LinkProblem write(const Bytes& bytes) {
        const auto end = Clock::now() + std::chrono::milliseconds(100);
        for (std::size_t at = 0; at < bytes.size();) {
            const auto n = ::write(fd_, bytes.data() + at, bytes.size() - at);
            if (n > 0) {
                at += std::size_t(n);
            } else if (n < 0 && errno != EAGAIN && errno != EINTR) {
                return {std::string("the serial port is gone: ") + std::strerror(errno), true};
            } else if (!wait(POLLOUT, end)) {
                return {"the serial port takes no more bytes"};
            }
        }
        return {};
    }
    /// What comes until `end`, at least one byte; empty on timeout.
    Bytes read(Clock::time_point end) {
        std::uint8_t bytes[256];
        if (!wait(POLLIN, end)) return {};
        const auto n = ::read(fd_, bytes, sizeof bytes);
        return n > 0 ? Bytes(bytes, bytes + n) : Bytes{};
    }

  private:
    bool wait(short what, Clock::time_point end) const {
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
        pollfd p{fd_, what, 0};
        return left > 0 && ::poll(&p, 1, int(left)) > 0 && (p.revents & what);
    }
    int fd_ = -1;
};

class SerialBus final : public BoardLink {
  public:
    explicit SerialBus(SerialBusSettings settings)
        : settings_(std::move(settings)),
          reader_(settings_.protocol == SerialProtocol::dynamixel ? StatusReader::Protocol::dynamixel
                                                                  : StatusReader::Protocol::feetech) {
        measures = settings_.protocol != SerialProtocol::maestro_compact;
        steps_per_unit = measures ? 1 : 4;
        if (settings_.baud == 0) settings_.baud = settings_.protocol == SerialProtocol::feetech ? 1000000 : 57600;
    }

    std::string open(std::span<WireValue> positions) override try {
        close();
        if (settings_.need_watchdog && settings_.protocol != SerialProtocol::dynamixel)
            throw std::runtime_error(
                settings_.port +
                ": this protocol cannot tell whether servos let go when this program is killed; --no-watchdog goes on");
        line_.open(settings_.port, settings_.baud);
        if (settings_.protocol == SerialProtocol::maestro_compact) {
            for (int c : settings_.channels) positions[std::size_t(c)] = ask_compact(compact::get_position(c));
            if (settings_.speed_units_per_s > 0)
                for (int c : settings_.channels)
                    must(
                        line_.write(compact::set_speed(c, std::uint16_t(std::ceil(settings_.speed_units_per_s / 25)))));
            ask_compact(compact::get_errors());
        } else {
            read(settings_.channels, positions);
            for (int c : settings_.channels)
                if (positions[std::size_t(c)] == no_pulse)
                    throw std::runtime_error(settings_.port + ": no servo answers with id " + std::to_string(c));
            prepare_servos();
        }
        return "";
    } catch (const std::exception& error) {
        close();
        return error.what();
    }

    void close() override {
        // The servos keep their mode: back to plain positions, let go, for whoever uses them next.
        if (line_.is_open() && settings_.protocol == SerialProtocol::dynamixel)
            for (int c : settings_.force_channels) {
                const auto id = std::uint8_t(c);
                line_.write(dynamixel::write_register(id, dynamixel::torque_enable, 1, 0));
                line_.write(dynamixel::write_register(id, dynamixel::operating_mode, 1, dynamixel::plain_position));
            }
        line_.close();
        reader_.clear();
    }

    LinkProblem write(std::span<const ChannelTarget> targets, std::span<char> arrived) override {
        if (!line_.is_open()) return {"the serial port is not open", true};
        const Bytes bytes = settings_.protocol == SerialProtocol::maestro_compact ? compact::set_targets(targets, true)
                            : settings_.protocol == SerialProtocol::dynamixel     ? dynamixel::write_targets(targets)
                                                                                  : feetech::write_targets(targets);
        const LinkProblem problem = line_.write(bytes);
        if (!problem) std::fill(arrived.begin(), arrived.end(), char(1));
        return problem;
    }

    LinkProblem write_torques(std::span<const ChannelTarget> limits) override {
        if (!line_.is_open()) return {"the serial port is not open", true};
        if (!measures) return {"a Maestro cannot limit the force of its servos", true};
        return line_.write(settings_.protocol == SerialProtocol::dynamixel ? dynamixel::write_torques(limits)
                                                                           : feetech::write_torques(limits));
    }

    LinkProblem feed() override try {
        if (!line_.is_open()) return {"the serial port is not open", true};
        if (measures) return heard_ ? LinkProblem{} : LinkProblem{"no servo answers"};
        const std::uint16_t errors = ask_compact(compact::get_errors());
        return errors ? LinkProblem{"the Maestro reports errors, bits " + std::to_string(errors)} : LinkProblem{};
    } catch (const std::exception& error) { return {error.what()}; }

    void read(std::span<const int> channels, std::span<WireValue> positions) override {
        if (!measures || channels.empty()) return;
        const bool is_dynamixel = settings_.protocol == SerialProtocol::dynamixel;
        if (line_.write(is_dynamixel ? dynamixel::read_positions(channels) : feetech::read_positions(channels))) {
            heard_ = false;
            return;
        }
        std::size_t missing = channels.size();
        const auto end = Clock::now() + std::chrono::milliseconds(50);
        while (missing > 0) {
            const Bytes bytes = line_.read(end);
            if (bytes.empty()) break;
            reader_.add(bytes);
            while (const auto p = reader_.next()) {
                if (std::find(channels.begin(), channels.end(), p->id) == channels.end() || p->parameters.size() < 2)
                    continue;
                const int value = p->parameters[0] | p->parameters[1] << 8;
                // Beyond a turn the position has a sign: no finger thimble gets there.
                positions[std::size_t(p->id)] = WireValue(value == 0 ? 1 : std::min(value, 0x7fff));
                --missing;
            }
        }
        heard_ = missing == 0;
    }

  private:
    void must(const LinkProblem& problem) {
        if (problem) throw std::runtime_error(settings_.port + ": " + problem.text);
    }
    std::uint16_t ask_compact(const Bytes& request) {
        must(line_.write(request));
        Bytes reply;
        const auto end = Clock::now() + std::chrono::milliseconds(60);
        while (reply.size() < 2) {
            const Bytes more = line_.read(end);
            if (more.empty()) throw std::runtime_error(settings_.port + ": no answer");
            reply.insert(reply.end(), more.begin(), more.end());
        }
        return std::uint16_t(reply[0] | reply[1] << 8);
    }
    /// Speed limit, watchdog of 200 ms where there is one, torque on.
    void prepare_servos() {
        for (int c : settings_.channels) {
            const auto id = std::uint8_t(c);
            const double ticks = settings_.speed_units_per_s;
            if (settings_.protocol == SerialProtocol::dynamixel) {
                const auto velocity = std::uint32_t(std::ceil(ticks / 4096 * 60 / 0.229));  // 0.229 turns a minute
                must(line_.write(dynamixel::write_register(id, dynamixel::bus_watchdog, 1, 0)));
                if (limits_force(c)) prepare_force(id);
                if (ticks > 0)
                    must(line_.write(dynamixel::write_register(id, dynamixel::profile_velocity, 4, velocity)));
                must(line_.write(dynamixel::write_register(id, dynamixel::torque_enable, 1, 1)));
                must(line_.write(dynamixel::write_register(id, dynamixel::bus_watchdog, 1, 10)));
            } else {
                if (ticks > 0)
                    must(line_.write(feetech::write_register(id, feetech::goal_speed, 2, std::uint32_t(ticks))));
                must(line_.write(feetech::write_register(id, feetech::torque_enable, 1, 1)));
            }
        }
    }

    bool limits_force(int channel) const {
        const auto& f = settings_.force_channels;
        return std::find(f.begin(), f.end(), channel) != f.end();
    }
    /// Position with limited current: a mode that not every servo has. No force before the first limit comes.
    void prepare_force(std::uint8_t id) {
        must(line_.write(dynamixel::write_register(id, dynamixel::torque_enable, 1, 0)));
        must(line_.write(
            dynamixel::write_register(id, dynamixel::operating_mode, 1, dynamixel::current_based_position)));
        must(line_.write(dynamixel::write_register(id, dynamixel::goal_current, 2, 0)));
        must(line_.write(dynamixel::read_register(id, dynamixel::operating_mode, 1)));
        const auto end = Clock::now() + std::chrono::milliseconds(60);
        while (true) {
            const Bytes bytes = line_.read(end);
            if (bytes.empty()) break;
            reader_.add(bytes);
            while (const auto p = reader_.next())
                if (p->id == id && p->parameters.size() == 1) {
                    if (p->parameters[0] == dynamixel::current_based_position) return;
                    throw std::runtime_error(settings_.port + ": servo " + std::to_string(id) +
                                             " has no current-based position mode, which mode = \"force\" needs");
                }
        }
        throw std::runtime_error(settings_.port + ": servo " + std::to_string(id) +
                                 " does not tell its operating mode");
    }

    SerialBusSettings settings_;
    Line line_;
    StatusReader reader_;
    bool heard_ = true;
};

}  // namespace

std::unique_ptr<BoardLink> make_serial_bus(const SerialBusSettings& settings) {
    return std::make_unique<SerialBus>(settings);
}

}  // namespace palpate
