#include "devices/drivers/compact_link.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include "devices/drivers/maestro_protocol.h"
#include "devices/drivers/serial_targets.h"

namespace palpate {

namespace {

using Clock = SerialLine::Clock;
using std::chrono::milliseconds;

/// A Maestro's own USB port, which knows no baud.
bool is_usb_all_the_way(const std::string& port) {
    std::error_code none;
    return std::filesystem::canonical(port, none).filename().string().starts_with("ttyACM");
}

/// A Pololu Maestro by its compact protocol.
class CompactLink final : public BoardLink {
  public:
    explicit CompactLink(SerialBusSettings settings) : settings_(std::move(settings)) {}

    std::string open(std::span<WireValue> positions) override try {
        close();
        const int baud = settings_.baud ? settings_.baud : 57600;
        line_.open(settings_.port, baud);
        byte_takes_ = is_usb_all_the_way(settings_.port) ? 0 : 10.0 / baud;
        told_.fill(no_pulse);
        doubtful_ = false;
        refuse_echo();
        for (int c : settings_.channels) {
            const WireValue at = positions[std::size_t(c)] = ask(compact::get_position(c));
            if (at > compact::most)
                throw std::runtime_error(settings_.port + ": channel " + std::to_string(c) + " is said to be at " +
                                         std::to_string(at / 4) + " us, which no Maestro sends");
        }
        if (const auto problem = limit_speed(first_move_share)) throw std::runtime_error(problem.text);
        ask(compact::get_errors());  // of what was before
        return "";
    } catch (const std::exception& error) {
        close();
        return error.what();
    }
    void close() override { line_.close(); }
    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        const LinkProblem problem = write_in_one(line_, compact::set_targets(targets, true), byte_takes_, transfers);
        for (const auto& [channel, value] : targets) told_[std::size_t(channel)] = problem ? no_pulse : value;
        return problem;
    }
    LinkProblem write_torques(std::span<const ChannelTarget>) override {
        return {"a Maestro cannot limit the force of its servos", true, FaultKind::refused};
    }
    LinkProblem feed() override try {
        if (doubtful_) take_what_is_late();
        const bool doubtful = std::exchange(doubtful_, true);
        const std::uint16_t errors = ask(compact::get_errors());
        if (errors & maestro::serial_timeout) return bitten;
        if (doubtful)
            if (const auto problem = astray()) return problem;
        doubtful_ = false;
        if (errors) return {"the Maestro reports errors, bits " + std::to_string(errors), false, FaultKind::reported};
        return {};
    } catch (const std::exception& error) { return {error.what(), false, FaultKind::silent}; }
    LinkProblem limit_speed(double share) override {
        Bytes all;
        for (int c : settings_.channels) {
            const double units = std::ceil(share * settings_.speed_units_per_s / 25);
            const Bytes one = compact::set_speed(c, std::uint16_t(std::clamp(units, 1.0, 16383.0)));
            if (settings_.speed_units_per_s > 0) all.insert(all.end(), one.begin(), one.end());
        }
        return line_.write(all);
    }
    bool write_in_signal(std::span<const ChannelTarget> targets) noexcept override {
        return write_now(line_.fd(), SerialProtocol::maestro_compact, targets);
    }

  private:
    inline static const LinkProblem bitten{"the Maestro's watchdog has bitten: its servos went home", true,
                                           FaultKind::watchdog};
    /// What comes back of a question would pass for the answer to it: a place, or errors.
    void refuse_echo() {
        line_.discard();
        const Bytes request = compact::get_errors();
        if (const auto problem = line_.write(request)) throw std::runtime_error(settings_.port + ": " + problem.text);
        Bytes all;
        for (const auto end = Clock::now() + milliseconds(60); all.size() < 3 && Clock::now() < end;) {
            const Bytes more = line_.read(Clock::now() + milliseconds(20));
            if (more.empty() && !all.empty()) break;
            all.insert(all.end(), more.begin(), more.end());
        }
        if (all.size() != 2 && !all.empty() && all[0] == request[0])
            throw std::runtime_error(settings_.port +
                                     ": what is said comes back: an adapter that echoes, or its two lines are joined");
    }
    void take_what_is_late() {
        for (const auto end = Clock::now() + milliseconds(40); Clock::now() < end;)
            if (line_.read(Clock::now() + milliseconds(15)).empty()) return;
    }
    /// Asking for errors forgets them: where an answer was lost, the watchdog may have bitten all the same. Then servos
    /// are not where they were told to be.
    LinkProblem astray() {
        for (int c : settings_.channels) {
            const WireValue told = told_[std::size_t(c)], at = told == no_pulse ? told : ask(compact::get_position(c));
            if (at == told) continue;
            if (at == no_pulse) return bitten;
            return {"an answer was lost, and servo " + std::to_string(c) +
                        " is not where it was told to be: its watchdog may have bitten",
                    false, FaultKind::silent};
        }
        return {};
    }
    std::uint16_t ask(const Bytes& request) {
        line_.discard();
        if (const auto problem = line_.write(request)) throw std::runtime_error(settings_.port + ": " + problem.text);
        Bytes reply;
        const auto end = Clock::now() + milliseconds(60);
        while (reply.size() < 2) {
            const Bytes more = line_.read(end);
            if (more.empty()) throw std::runtime_error(settings_.port + ": no answer");
            reply.insert(reply.end(), more.begin(), more.end());
        }
        if (reply.size() > 2) throw std::runtime_error(settings_.port + ": an answer of more than two bytes");
        return std::uint16_t(reply[0] | reply[1] << 8);
    }

    SerialBusSettings settings_;
    SerialLine line_;
    double byte_takes_ = 0;
    std::array<WireValue, max_channels> told_{};  ///< no_pulse: nothing, or nobody knows
    bool doubtful_ = false;                       ///< an answer that said how the board is was lost
};

}  // namespace

std::unique_ptr<BoardLink> make_compact_link(const SerialBusSettings& settings) {
    return std::make_unique<CompactLink>(settings);
}

}  // namespace palpate
