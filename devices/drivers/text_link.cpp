#include "devices/drivers/text_link.h"

#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "devices/drivers/serial_line.h"
#include "devices/drivers/text_protocol.h"
#include "devices/loop/clock.h"

namespace palpate {

namespace {

using Clock = SerialLine::Clock;
using std::chrono::milliseconds;

constexpr int baud = 115200;
constexpr int watchdog_ms = 200;
constexpr auto answer_time = milliseconds(60);

/// What a board's "err ..." means.
LinkProblem problem_of(const std::string& port, const text::Reply& reply) {
    if (reply.words == "watchdog")
        return {port + ": the board's watchdog has bitten: its servos went home", true, FaultKind::watchdog};
    if (reply.words == "idle")
        return {port + ": the board was started anew, and is not armed", true, FaultKind::watchdog};
    if (reply.words == "checksum") return {port + ": a line did not arrive whole", false, FaultKind::bad_reply};
    return {port + ": the board refuses: " + reply.words, true, FaultKind::refused};
}

class TextLink final : public BoardLink {
  public:
    explicit TextLink(TextLinkSettings settings) : settings_(std::move(settings)) { steps_per_unit = 1; }

    std::string open(std::span<WireValue> positions) override try {
        active_ = false;
        if (!line_.is_open()) open_line();
        const text::Reply hello = wake();
        if (hello.value("palpate") != text::protocol)
            throw std::runtime_error("the board speaks another version of the protocol: " + hello.words);
        set_watchdog();
        const int channels = hello.value("channels").value_or(0);
        for (int c : settings_.channels)
            if (c >= channels)
                throw std::runtime_error("the board has channels 0 to " + std::to_string(channels - 1) + ", not " +
                                         std::to_string(c));
        if (const auto problem = limit_speed(first_move_share)) throw std::runtime_error(problem.text);
        for (int c : settings_.channels) positions[std::size_t(c)] = look_at(c);
        awake_ = true;
        return "";
    } catch (const std::exception& error) {
        if (awake_ || !waiting_) close();  // while a board starts, its port stays open: opening starts it anew
        const std::string what = error.what();
        return what.starts_with(settings_.port) ? what : settings_.port + ": " + what;
    }

    void close() override {
        line_.close();
        reader_.clear();
        active_ = awake_ = false;
    }

    LinkProblem activate() override {
        const LinkProblem problem = order("arm");
        active_ = !problem;
        return problem;
    }

    void deactivate() override {
        active_ = false;
        order("rest");
    }

    LinkProblem write(std::span<const ChannelTarget> targets, std::span<Transfer> transfers) override {
        for (std::size_t at = 0; at < targets.size(); at += text::most_targets) {
            const std::size_t count = std::min(text::most_targets, targets.size() - at);
            const double sent = device_clock();
            if (const auto problem = order_targets("set", targets.subspan(at, count))) return problem;
            std::fill_n(transfers.begin() + std::ptrdiff_t(at), count, Transfer{sent, device_clock()});
        }
        return {};
    }

    LinkProblem write_torques(std::span<const ChannelTarget>) override {
        return {"hobby servos cannot limit their force", true, FaultKind::refused};
    }

    LinkProblem feed() override {
        text::Reply reply;
        if (const auto problem = ask("feed", reply)) return problem;
        if (active_ && reply.word("state") != "armed") {
            reply.words = reply.word("state") == "home" ? "watchdog" : "idle";
            return problem_of(settings_.port, reply);
        }
        if (measures) seen_ = std::move(reply);
        return {};
    }

    LinkProblem read(std::span<const int> channels, std::span<WireValue> positions) override {
        for (int c : channels)
            if (const int us = seen_.value(std::to_string(c)).value_or(0); us > 0)
                positions[std::size_t(c)] = WireValue(std::min(us, 0x7fff));
        return {};
    }

    LinkProblem limit_speed(double share) override {
        std::vector<ChannelTarget> limits;
        for (int c : settings_.channels) limits.push_back({c, own_speed(share)});
        return settings_.speed_us_per_s > 0 ? order_targets("speed", limits) : LinkProblem{};
    }

    bool write_in_signal(std::span<const ChannelTarget> targets) noexcept override {
        char line[text::longest_line];
        line[0] = '\n';  // whatever was being written ends here
        const std::size_t size = 1 + text::encode_targets(last_number, "set", targets, std::span(line).subspan(1));
        return line_.fd() >= 0 && size > 1 && ::write(line_.fd(), line, size) == ssize_t(size);
    }

  private:
    static constexpr unsigned last_number = 60000;  ///< which no command has

    void open_line() {
        line_.open(settings_.port, baud);
        termios t{};  // closing must not start the board anew: its watchdog is to take the servos home
        if (tcgetattr(line_.fd(), &t) == 0) {
            t.c_cflag &= ~tcflag_t(HUPCL);
            tcsetattr(line_.fd(), TCSANOW, &t);
        }
        waiting_ = false;
    }

    /// The answer to the first "hello". The first time, in open() at arming, that may take seconds; later not.
    text::Reply wake() {
        const auto patience = std::chrono::duration<double>(first_ ? settings_.wake_s : 0.2);
        const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(patience);
        first_ = false;
        waiting_ = true;
        while (true) {
            text::Reply reply;
            const LinkProblem problem = ask("hello", reply);
            if (!problem) return reply;
            if (problem.lost) waiting_ = false;
            if (problem.lost || Clock::now() >= end) throw std::runtime_error(problem.text);
        }
    }

    WireValue own_speed(double share) const {
        return WireValue(std::clamp(std::ceil(share * settings_.speed_us_per_s), 1.0, 20000.0));
    }

    /// As it reads back, in words for whoever arms.
    void set_watchdog() {
        if (const auto problem = order("watchdog " + std::to_string(watchdog_ms)); problem && settings_.need_watchdog)
            throw std::runtime_error(problem.text + ", asked to set its watchdog; --no-watchdog goes on");
        if (!settings_.need_watchdog) return;
        const auto ms = demand("hello").value("watchdog");
        if (ms != watchdog_ms)
            throw std::runtime_error("the board's watchdog was set to " + std::to_string(watchdog_ms) +
                                     " ms and reads back as " + (ms ? std::to_string(*ms) + " ms" : "nothing") +
                                     "; --no-watchdog goes on");
    }

    /// Where a channel is, as far as the board knows, once its speed limit was set.
    WireValue look_at(int channel) {
        const text::Reply about = demand("about " + std::to_string(channel));
        if (settings_.speed_us_per_s > 0 && about.value("speed") != own_speed(first_move_share))
            throw std::runtime_error("the board does not keep the speed limit of channel " + std::to_string(channel) +
                                     ": it reads back as " + std::to_string(about.value("speed").value_or(0)));
        const int measured = about.value("measured").value_or(0), at = about.value("at").value_or(0);
        measures |= measured > 0;
        const int place = std::clamp(measured > 0 ? measured : at, 0, 0x7fff), min = about.value("min").value_or(place),
                  max = about.value("max").value_or(place);
        // On its way back it would be told what the board refuses.
        if (place > 0 && (place < min || place > max))
            throw std::runtime_error("the servo of channel " + std::to_string(channel) + " stands at " +
                                     std::to_string(place) + " us, and the board allows " + std::to_string(min) +
                                     " to " + std::to_string(max) + " us: turn it there by hand, without its supply");
        return WireValue(place);
    }

    LinkProblem send(std::string_view line) {
        return line_.write({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()});
    }
    void next_number() { number_ = number_ % (last_number - 1) + 1; }

    /// Waits for the answer to the last line; answers to earlier ones are passed over.
    LinkProblem take_answer(text::Reply& reply) {
        const auto end = Clock::now() + answer_time;
        while (true) {
            while (auto r = reader_.next()) {
                if (r->number != number_ && r->number != 0) continue;
                reply = std::move(*r);
                return reply.ok ? LinkProblem{} : problem_of(settings_.port, reply);
            }
            const auto bytes = line_.read(end);
            if (bytes.empty()) return {settings_.port + ": no answer", false, FaultKind::silent};
            reader_.add(bytes);
        }
    }
    LinkProblem ask(std::string_view words, text::Reply& reply) {
        next_number();
        reader_.clear();
        if (const auto problem = send(text::line_of(number_, words))) return problem;
        return take_answer(reply);
    }
    LinkProblem order(std::string_view words) {
        text::Reply reply;
        return ask(words, reply);
    }
    LinkProblem order_targets(std::string_view verb, std::span<const ChannelTarget> targets) {
        char line[text::longest_line];
        next_number();
        reader_.clear();
        const std::size_t size = text::encode_targets(number_, verb, targets, line);
        if (const auto problem = send({line, size})) return problem;
        text::Reply reply;
        return take_answer(reply);
    }
    text::Reply demand(const std::string& words) {
        text::Reply reply;
        if (const auto problem = ask(words, reply)) throw std::runtime_error(problem.text);
        return reply;
    }

    TextLinkSettings settings_;
    SerialLine line_;
    text::ReplyReader reader_;
    text::Reply seen_;  ///< the newest answer with measured places
    unsigned number_ = 0;
    bool first_ = true, waiting_ = false, awake_ = false, active_ = false;
};

}  // namespace

std::unique_ptr<BoardLink> make_text_link(const TextLinkSettings& settings) {
    return std::make_unique<TextLink>(settings);
}

}  // namespace palpate
