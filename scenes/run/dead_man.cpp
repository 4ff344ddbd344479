#include "scenes/run/dead_man.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/joystick.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <utility>

#include "devices/loop/clock.h"
#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

/// A file descriptor that is closed.
struct Descriptor {
    explicit Descriptor(int value) : fd(value) {}
    ~Descriptor() {
        if (fd >= 0) ::close(fd);
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    int fd;
};

constexpr int read_at_once = 5000;  ///< more than a terminal keeps; whoever sends without end holds nobody up

/// What waits unread where nobody has asked for a while was said then, not now.
class Attention {
  public:
    bool lapsed(double now) { return now - std::exchange(asked_, now) > 0.25; }

  private:
    double asked_ = -1e9;
};

/// A key that repeats: first after the pause that keyboards make, then often.
class Key final : public DeadMan {
  public:
    Key() {
        uses_terminal = true;
        if (tcgetattr(STDIN_FILENO, &before_) != 0) throw InputError("--hold key: standard input is no terminal");
        termios raw = before_;
        raw.c_lflag &= ~tcflag_t(ICANON | ECHO);
        tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    }
    ~Key() override { tcsetattr(STDIN_FILENO, TCSANOW, &before_); }
    bool held() override {
        const double now = device_clock();
        const bool stale = attention_.lapsed(now);
        char c;
        pollfd p{STDIN_FILENO, POLLIN, 0};
        for (int k = 0; k<read_at_once&& ::poll(&p, 1, 0)> 0 && ::read(STDIN_FILENO, &c, 1) == 1; ++k) {
            if (stale) continue;
            if (c == '\n' || c == '\r') {
                enter_ = true;
                continue;
            }
            const bool repeats = now - last_ < patience_;
            patience_ = repeats ? between_repeats : before_repeats;
            last_ = now;
        }
        return now - last_ < patience_;
    }

  private:
    static constexpr double before_repeats = 0.7, between_repeats = 0.2;  ///< [s]
    termios before_{};
    Attention attention_;
    double last_ = -1e9, patience_ = 0;
};

class Joystick final : public DeadMan {
  public:
    Joystick(const std::string& path, int button)
        : file_(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)), button_(button) {
        if (file_.fd < 0) throw InputError("--hold: " + path + " cannot be opened");
    }
    bool held() override {
        js_event e;
        ssize_t n = 0;
        for (int k = 0; k < read_at_once && (n = ::read(file_.fd, &e, sizeof e)) == ssize_t(sizeof e); ++k) {
            if ((e.type & ~JS_EVENT_INIT) != JS_EVENT_BUTTON || e.number >= 64) continue;
            const std::uint64_t bit = std::uint64_t(1) << e.number;
            pressed_ = e.value ? pressed_ | bit : pressed_ & ~bit;
        }
        if (n == 0 || (n < 0 && errno != EAGAIN)) pressed_ = 0;  // unplugged
        return button_ < 0 ? pressed_ != 0 : (pressed_ >> button_ & 1) != 0;
    }

  private:
    Descriptor file_;
    int button_;
    std::uint64_t pressed_ = 0;
};

class Heartbeat final : public DeadMan {
  public:
    explicit Heartbeat(int port) : socket_(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
        sockaddr_in here{};
        here.sin_family = AF_INET;
        here.sin_port = htons(std::uint16_t(port));
        here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        if (::bind(socket_.fd, reinterpret_cast<sockaddr*>(&here), sizeof here) != 0)
            throw InputError("--hold heartbeat:" + std::to_string(port) + ": the port is taken");
    }
    bool held() override {
        const double now = device_clock();
        const bool stale = attention_.lapsed(now);
        for (int k = 0; k < read_at_once; ++k) {
            char c = 0;  // of an empty datagram, too
            if (::recv(socket_.fd, &c, 1, 0) < 0) break;
            last_ = c == '1' && !stale ? now : -1e9;
            counts.foreign += c != '1' && c != '0';
        }
        return now - last_ < silence;
    }

  private:
    static constexpr double silence = 0.25;  ///< [s]
    Descriptor socket_;
    Attention attention_;
    double last_ = -1e9;
};

/// A whole number in [0, most], or nothing.
bool read_number(const std::string& text, int most, int& out) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
    return error == std::errc{} && end == text.data() + text.size() && out >= 0 && out <= most;
}

}  // namespace

namespace {

std::unique_ptr<DeadMan> open_dead_man(const std::string& source) {
    if (source == "key") return std::make_unique<Key>();
    const std::string kind = source.substr(0, source.find(':')),
                      rest = kind.size() < source.size() ? source.substr(kind.size() + 1) : "";
    int number = -1;
    if (kind == "heartbeat" && read_number(rest, 65535, number) && number > 0)
        return std::make_unique<Heartbeat>(number);
    if (kind == "joystick" && !rest.empty()) {
        const std::size_t colon = rest.find(':');
        if (colon == std::string::npos) return std::make_unique<Joystick>(rest, -1);
        if (read_number(rest.substr(colon + 1), 63, number))
            return std::make_unique<Joystick>(rest.substr(0, colon), number);
    }
    throw InputError("--hold: expected key, joystick:/dev/input/js0[:BUTTON] or heartbeat:PORT, found \"" + source +
                     "\"");
}

}  // namespace

std::unique_ptr<DeadMan> make_dead_man(const std::string& source) {
    std::unique_ptr<DeadMan> dead_man = open_dead_man(source);
    dead_man->source = source;
    return dead_man;
}

void refuse_to_hold_unarmed(const std::string& source, bool armed) {
    if (source.empty() || armed) return;
    throw InputError("--hold " + source + ": without --arm no thimble moves; give --arm, too, or leave --hold out");
}

void obey_dead_man(DeadMan& dead_man, Simulation& s) {
    const bool held = dead_man.held(), enter = dead_man.take_enter();
    HoldCounts& c = dead_man.counts;
    const double now = device_clock(), passed = c.obeyed_at < 0 ? 0 : now - c.obeyed_at;
    c.watched += passed;
    if (c.was_held) c.held += passed;
    c.obeyed_at = now, c.was_held = held;
    for (auto& loop : s.loops) {
        loop->let_go = !held;
        if (enter) loop->rearm_asked = true;
    }
}

std::string take_news(DeadMan& dead_man) {
    if (dead_man.counts.foreign == 0 || std::exchange(dead_man.counts.foreign_told, true)) return "";
    return "--hold " + dead_man.source +
           ": a datagram says neither 1 (held) nor 0 (let go): thimbles follow while datagrams that begin with 1 come";
}

std::string hold_report(const DeadMan& dead_man) {
    const HoldCounts& c = dead_man.counts;
    char times[80];
    if (c.held > 0)
        plain_snprintf(times, sizeof times, "held for %.2f s of %.2f s", c.held, c.watched);
    else
        plain_snprintf(times, sizeof times, "never held in %.2f s: thimbles did not follow", c.watched);
    return "--hold " + dead_man.source + ": " + times +
           (c.foreign == 0 ? ""
                           : "; " + std::to_string(c.foreign) + " datagrams said neither 1 (held) nor 0 (let go)") +
           "\n";
}

}  // namespace palpate
