#include "scenes/stream/stream.h"

#include <netdb.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstring>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "devices/loop/clock.h"
#include "meshes/input_error.h"
#include "scenes/stream/stream_message.h"
#include "scenes/web/access.h"
#include "scenes/web/bounded_json.h"
#include "scenes/web/server.h"

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t largest_datagram = 65000;

/// A pose that somebody commands; none: a finger is not seen.
using Commanded = std::map<std::string, std::optional<Pose<double>>>;

int connected_socket(const std::string& target) {
    const std::string where =
        "--stream " + target + ": expected udp:HOST:PORT, websocket:PORT, or - for standard output";
    const std::size_t colon = target.rfind(':');
    if (!target.starts_with("udp:") || colon <= 4 || colon + 1 >= target.size()) throw InputError(where);
    const std::string host = target.substr(4, colon - 4), port = target.substr(colon + 1);
    if (port.find_first_not_of('0') == std::string::npos) throw InputError(where + " with a port of 1 to 65535");
    addrinfo hints{};
    hints.ai_socktype = SOCK_DGRAM;
    hints.ai_flags = AI_NUMERICSERV;
    addrinfo* found = nullptr;
    if (const int error = getaddrinfo(host.c_str(), port.c_str(), &hints, &found); error != 0)
        throw InputError(where + ": " + gai_strerror(error));
    int socket = -1;
    for (const addrinfo* a = found; a && socket < 0; a = a->ai_next) {
        socket = ::socket(a->ai_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        if (socket >= 0 && connect(socket, a->ai_addr, a->ai_addrlen) != 0) close(std::exchange(socket, -1));
    }
    freeaddrinfo(found);
    if (socket < 0) throw InputError(where + ": " + std::strerror(errno));
    const int room = 1 << 20;
    setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return socket;
}

int websocket_port(const std::string& target) {
    const std::string text = target.substr(std::string_view("websocket:").size());
    const bool digits = !text.empty() && text.size() <= 5 && text.find_first_not_of("0123456789") == std::string::npos;
    if (!digits || std::stoi(text) > 65535)
        throw InputError("--stream " + target + ": expected websocket:PORT with a port of 0 (any free one) to 65535");
    return std::stoi(text);
}

/// Seven finite numbers with a rotation that is none of zero.
bool read_pose(const nlohmann::json& j, Pose<double>& pose) {
    if (!j.is_array() || j.size() != 7) return false;
    double v[7];
    for (std::size_t i = 0; i < 7; ++i) {
        if (!j[i].is_number()) return false;
        v[i] = j[i].get<double>();
        if (!std::isfinite(v[i]) || std::abs(v[i]) > 1e6) return false;
    }
    pose = {{v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}};
    const double square = v[3] * v[3] + v[4] * v[4] + v[5] * v[5] + v[6] * v[6];
    if (square < 1e-12) return false;
    if (std::abs(square - 1) > 1e-14) pose.rotation = normalised(pose.rotation);
    return true;
}

}  // namespace

/// A ring from the step to the thread that writes; the step never waits.
struct Stream::Work {
    StreamSettings settings;
    int socket = -1;                 ///< of UDP
    std::unique_ptr<WebServer> web;  ///< of WebSockets; neither: standard output
    StreamNames names;
    static constexpr std::uint64_t ring = 64;
    std::array<StreamNumbers, ring> steps;
    StreamNumbers late;  ///< of the step: the newest that the ring had no room for, sent if it stays the last
    bool has_late = false;
    std::atomic<std::uint64_t> written{0}, taken{0};  ///< steps ever put in, and taken out
    std::atomic<bool> ending{false}, samples{false}, paused{false}, cut{false}, came{false};
    std::atomic<std::int64_t> told{0}, sent{0}, left_out{0}, missed{0}, commands{0}, wrong{0};
    std::atomic<int> error{0};
    double next = 0;  ///< simulated time of the next line [s]
    std::mutex lock;  ///< of the commanded poses; the step does not wait for it
    Commanded fingers, objects;
    std::vector<std::string> wanted_settings;
    std::atomic<std::uint64_t> commanded{0};  ///< changes of these
    std::uint64_t obeyed = 0;                 ///< of the step: what it has of them
    Commanded fingers_now, objects_now;
    Clock::time_point last_chance{};
    std::thread sender, receiver;

    ~Work() {
        end();
        if (socket >= 0) close(socket);
    }
    bool full() const { return written - taken.load(std::memory_order_acquire) >= ring; }
    void put_late() {
        while (full() && !cut && Clock::now() < last_chance)
            std::this_thread::sleep_for(std::chrono::microseconds(300));
        if (full()) return;
        std::swap(steps[written % ring], late);
        --left_out, has_late = false, ++written;
    }
    void end() {
        if (has_late && !ending) put_late();
        ending = true;
        if (sender.joinable()) sender.join();
        if (web) {
            web->drop_clients();
            while (web->clients() > 0 && Clock::now() < last_chance)
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            missed = web->missed();
            web.reset();
        }
        if (receiver.joinable()) receiver.join();
    }

    void send_all() {
        // A reader of standard output that goes away is no reason to die.
        sigset_t pipe;
        sigemptyset(&pipe);
        sigaddset(&pipe, SIGPIPE);
        pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
        std::string line;
        while (!cut) {
            const std::uint64_t from = taken.load(std::memory_order_relaxed),
                                to = written.load(std::memory_order_acquire);
            if (from == to) {
                if (ending) return;
                std::this_thread::sleep_for(std::chrono::microseconds(300));
                continue;
            }
            // Far behind: the newest are worth more than the oldest.
            const std::uint64_t at = to - from > ring / 2 ? to - ring / 4 : from;
            left_out += std::int64_t(at - from);
            line.clear();
            append_line(steps[at % ring], names, true, line);
            if (socket >= 0 && line.size() > largest_datagram) {
                line.clear();
                append_line(steps[at % ring], names, false, line);
            }
            taken.store(at + 1, std::memory_order_release);
            if (web ? send_message(line) : socket >= 0 ? send_datagram(line) : write_line(line)) ++sent;
        }
    }
    bool send_message(std::string& line) {
        line.pop_back();  // the message ends the line
        if (web->clients() > 0) web->send_text(line);
        return web->clients() > 0;
    }
    /// Like the viewer's page: who connects knows the token; pages are those of this machine, unless others are asked
    /// in.
    bool accepts(const HttpHead& head) const {
        const std::string origin = head.field("origin");
        return head.path() == "/stream" && same_token(query_value(head.query(), "token"), settings.token) &&
               (origin.empty() || settings.any_address || is_local_origin(origin));
    }
    void listen() {
        if (settings.token.empty()) settings.token = random_token();
        if (settings.token.size() < 8 ||
            !std::all_of(settings.token.begin(), settings.token.end(),
                         [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_'; }))
            throw InputError("--stream-token: expected 8 or more letters, digits, - or _");
        WebHandlers handlers;
        handlers.accepts = [this](const HttpHead& head, const WebPeer&) {
            const bool welcome = accepts(head);
            if (welcome) came = true;
            return welcome;
        };
        handlers.message = [this](const WebPeer&, const std::string& text) {
            ++(take_command(text) ? commands : wrong);
            return true;
        };
        WebLimits limits;
        limits.skip_bytes = 256 << 10;
        limits.kernel_bytes = 128 << 10;
        try {
            web = std::make_unique<WebServer>(websocket_port(settings.target), settings.any_address,
                                              std::move(handlers), limits);
        } catch (const InputError& error) {
            throw InputError("--stream " + settings.target + ": " + error.messages.front());
        }
    }
    bool send_datagram(const std::string& line) {
        // Nobody listens, or the buffer is full: the next line is newer.
        if (::send(socket, line.data(), line.size() - 1, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0) return true;
        ++left_out;
        return false;
    }
    bool write_line(const std::string& line) {
        for (std::size_t at = 0; at < line.size();) {
            pollfd p{STDOUT_FILENO, POLLOUT, 0};
            if (poll(&p, 1, 50) <= 0) {
                if (ending && Clock::now() > last_chance) cut = true;
                if (cut) return false;
                continue;
            }
            // A pipe that can be written to takes this much at once.
            const ssize_t n = ::write(STDOUT_FILENO, line.data() + at, std::min<std::size_t>(line.size() - at, 4096));
            if (n < 0 && errno != EINTR && errno != EAGAIN) {
                if (errno != EPIPE) error = errno;
                cut = true;
                return false;
            }
            if (n > 0) at += std::size_t(n);
        }
        return true;
    }

    void receive() {
        std::vector<char> buffer(65536);
        while (!ending) {
            pollfd p{socket, POLLIN, 0};
            if (poll(&p, 1, 50) <= 0) continue;
            const ssize_t n = recv(socket, buffer.data(), buffer.size(), 0);
            if (n < 0) {
                std::this_thread::sleep_for(std::chrono::milliseconds(1));  // refused: nobody listens yet
                continue;
            }
            ++(take_command({buffer.data(), std::size_t(n)}) ? commands : wrong);
        }
    }
    bool take_command(std::string_view text) {
        std::string problem;
        const nlohmann::json j = parse_object(text, problem);
        if (!problem.empty()) return false;
        bool known = false;
        for (auto [key, flag] : {std::pair{"pause", &paused}, {"samples", &samples}})
            if (j.contains(key) && j[key].is_boolean()) *flag = j[key].get<bool>(), known = true;
        known |= take_pose(j, "finger", true, fingers);
        known |= take_pose(j, "object", false, objects);
        if (settings.takes_settings && j.contains("set") && j["set"].is_array()) {
            const std::lock_guard guard(lock);
            for (const auto& setting : j["set"])
                if (setting.is_string() && wanted_settings.size() < 1000)
                    wanted_settings.push_back(setting.get<std::string>()), known = true;
            ++commanded;
        }
        return known;
    }
    bool take_pose(const nlohmann::json& j, const char* what, bool may_be_unseen, Commanded& all) {
        if (!j.contains(what) || !j[what].is_string()) return false;
        const std::string name = j[what].get<std::string>();
        Pose<double> pose = Pose<double>::identity();
        const bool release = j.contains("release"), unseen = may_be_unseen && j.contains("pose") && j["pose"].is_null();
        if (!release && !unseen && !(j.contains("pose") && read_pose(j["pose"], pose))) return false;
        const std::lock_guard guard(lock);
        if (release)
            all.erase(name);
        else if (all.size() < 1000 || all.contains(name))
            all[name] = unseen ? std::nullopt : std::optional(pose);
        ++commanded;
        return true;
    }
};

std::string to_text(const StreamCounts& c) {
    std::string text = "stream: " + std::to_string(c.sent) + " of " + std::to_string(c.told) + " steps sent, " +
                       std::to_string(c.left_out) + " left out";
    if (c.commands + c.wrong_commands > 0)
        text += "; " + std::to_string(c.commands) + " commands, " + std::to_string(c.wrong_commands) +
                " that could not be read";
    if (c.missed > 0) text += "; " + std::to_string(c.missed) + " missed by readers that were behind";
    return text + (c.cut ? "; whoever read it has gone" : "");
}

void obey(Stream& stream, Simulation& s, StepInputs& inputs, const std::atomic<bool>& stop) {
    const bool waits = stream.paused();
    while (stream.paused() && !stop) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    if (waits && s.pace) s.pace->due = device_clock();
    stream.command(s, inputs);
}

Stream::Stream(const StreamSettings& settings) : work_(std::make_unique<Work>()) {
    work_->settings = settings;
    work_->samples = settings.samples;
    if (settings.target.starts_with("websocket:"))
        work_->listen();
    else if (settings.target != "-")
        work_->socket = connected_socket(settings.target);
}

Stream::~Stream() { end(); }

StreamCounts Stream::end() {
    if (!work_->ending) work_->last_chance = Clock::now() + std::chrono::milliseconds(work_->web ? 5000 : 500);
    work_->end();
    return counts();
}

void Stream::tell(const Simulation& s) {
    Work& w = *work_;
    if (w.settings.rate > 0) {
        if (s.world.time < w.next && s.world.time > w.next - 2 / w.settings.rate) return;
        w.next = s.world.time + 1 / w.settings.rate - 0.5 * s.world.solver.dt;
    }
    if (!w.sender.joinable()) {
        w.names = stream_names(s);
        w.sender = std::thread([&w] { w.send_all(); });
        if (w.socket >= 0) w.receiver = std::thread([&w] { w.receive(); });
    }
    w.told.fetch_add(1, std::memory_order_relaxed);
    const std::uint64_t at = w.written.load(std::memory_order_relaxed);
    const bool full = w.full();
    const bool other_scene = w.names.fingers.size() != s.fingers.size() ||
                             w.names.objects.size() != s.world.shapes.size() ||
                             w.names.kinds.size() != s.world.matchings.size();
    if (other_scene || full) w.left_out.fetch_add(1, std::memory_order_relaxed);
    if (other_scene) return;
    w.has_late = full;
    take_numbers(s, w.names, w.samples, full ? w.late : w.steps[at % Work::ring]);
    if (!full) w.written.store(at + 1, std::memory_order_release);
}

void Stream::command(const Simulation& s, StepInputs& inputs) {
    Work& w = *work_;
    if (w.commanded.load(std::memory_order_relaxed) != w.obeyed)
        if (const std::unique_lock guard(w.lock, std::try_to_lock); guard) {
            w.fingers_now = w.fingers, w.objects_now = w.objects;
            w.obeyed = w.commanded;
        }
    if (w.obeyed == 0) return;
    for (std::size_t i = 0; i < inputs.fingers.size(); ++i) {
        const auto found = w.fingers_now.find(s.world.skins[i].name);
        if (found == w.fingers_now.end()) continue;
        inputs.fingers[i].valid = found->second.has_value();
        if (found->second) inputs.fingers[i].pose = *found->second;
        inputs.fingers[i].time = s.world.time + s.world.solver.dt;
    }
    for (std::size_t i = 0; i < inputs.objects.size(); ++i) {
        const VirtualObject& shape = s.world.shapes[i];
        const auto found = w.objects_now.find(shape.name);
        if (found != w.objects_now.end() && found->second && shape.body < 0 && shape.held_body < 0)
            inputs.objects[i] = *found->second;
    }
}

std::vector<std::string> Stream::take_settings() {
    const std::unique_lock guard(work_->lock, std::try_to_lock);
    return guard ? std::exchange(work_->wanted_settings, {}) : std::vector<std::string>{};
}

std::string Stream::address() const {
    const Work& w = *work_;
    return w.web ? "ws://127.0.0.1:" + std::to_string(w.web->port()) + "/stream?token=" + w.settings.token : "";
}

bool Stream::paused() const {
    const Work& w = *work_;
    return w.paused || (w.settings.waits && w.web && !w.came);
}

StreamCounts Stream::counts() const {
    const Work& w = *work_;
    return {w.told, w.sent, w.left_out, w.missed, w.commands, w.wrong, w.cut, w.error};
}

}  // namespace palpate
