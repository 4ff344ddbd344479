#include "scenes/trackers/ultraleap.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <nlohmann/json.hpp>
#include <thread>

#include "meshes/input_error.h"
#include "scenes/web/bounded_json.h"
#include "scenes/web/client.h"
#include "scenes/web/server.h"

namespace palpate {

namespace {

using nlohmann::json;

/// A vector of three finite numbers; false where it is none.
bool read_vector(const json& j, const char* key, Eigen::Vector3d& v) {
    const auto it = j.find(key);
    if (it == j.end() || !it->is_array() || it->size() != 3) return false;
    for (std::size_t k = 0; k < 3; ++k) {
        if (!(*it)[k].is_number()) return false;
        v[std::ptrdiff_t(k)] = (*it)[k].get<double>();
    }
    return v.allFinite();
}

/// Axes of the distal bone: the last of four, given as rows.
bool read_distal_axes(const json& pointable, Eigen::Matrix3d& axes) {
    const auto bases = pointable.find("bases");
    if (bases == pointable.end() || !bases->is_array() || bases->size() != 4) return false;
    const json& distal = (*bases)[3];
    if (!distal.is_array() || distal.size() != 3) return false;
    for (std::size_t a = 0; a < 3; ++a) {
        if (!distal[a].is_array() || distal[a].size() != 3) return false;
        for (std::size_t k = 0; k < 3; ++k) {
            if (!distal[a][k].is_number()) return false;
            axes(std::ptrdiff_t(k), std::ptrdiff_t(a)) = distal[a][k].get<double>();
        }
    }
    return axes.allFinite();
}

std::string read_hands(const json& frame, std::array<HandFrame, 2>& hands) {
    const auto all = frame.find("hands"), pointables = frame.find("pointables");
    if (all == frame.end() || !all->is_array() || pointables == frame.end() || !pointables->is_array())
        return "a frame without \"hands\" and \"pointables\"";
    for (const json& hand : *all) {
        if (!hand.is_object() || !hand.contains("id") || !hand["id"].is_number() || !hand.contains("type"))
            return "hands: expected \"id\" and \"type\"";
        const int side = hand["type"] == "right";
        if (!side && hand["type"] != "left") return "hands: expected the type \"left\" or \"right\"";
        HandFrame& out = hands[std::size_t(side)];
        int found = 0;
        for (const json& p : *pointables) {
            if (!p.is_object() || !p.contains("handId") || p["handId"] != hand["id"]) continue;
            const auto type = p.find("type");
            if (type == p.end() || !type->is_number_integer() || *type < 0 || *type > 4)
                return "pointables: expected a type from 0 (thumb) to 4 (little finger)";
            Eigen::Vector3d joint, tip;
            Eigen::Matrix3d axes;
            if (!read_vector(p, "dipPosition", joint) || !read_distal_axes(p, axes) ||
                !(read_vector(p, "btipPosition", tip) || read_vector(p, "tipPosition", tip)))
                return "pointables: expected dipPosition, btipPosition and 4 bases";
            set_finger(out, type->get<int>(), joint, tip, axes, {1e-3, true});
            found |= 1 << type->get<int>();
        }
        out.valid = found == 31;
    }
    return "";
}

class UltraleapHands : public HandSourceThread {
  public:
    UltraleapHands(HandMailbox& mailbox, std::string host, int port) : mailbox_(mailbox) {
        service_.host = std::move(host);
        service_.port = port;
        service_.path = "/v6.json";
        service_.connected = [this] {
            mailbox_.count_connection();
            last_id_ = -1;
            // Frames also while this program is not in front: the service asks for both, word for word.
            return std::vector<std::string>{"{\"version\":6}", "{\"background\":true}"};
        };
        service_.message = [this](const std::string& text) {
            take_ultraleap(mailbox_, text.data(), text.size(), last_id_);
        };
        service_.too_large = [this] { mailbox_.count_malformed("a message of more than 64 kB"); };
        stop_fd_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
        connector_ = std::thread([this] { stay_connected(); });
    }
    ~UltraleapHands() override {
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto n = ::write(stop_fd_, &one, sizeof one);
        connector_.join();
        ::close(stop_fd_);
    }
    std::string about() const override {
        return "Leap Motion service at ws://" + service_.host + ":" + std::to_string(service_.port) + "/v6.json";
    }

  private:
    void stay_connected() {
        pollfd stop{stop_fd_, POLLIN, 0};
        do converse(service_, stop_fd_);
        while (::poll(&stop, 1, 500) == 0);
    }
    HandMailbox& mailbox_;
    WebConversation service_;
    std::int64_t last_id_ = -1;
    int stop_fd_ = -1;
    std::thread connector_;
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_ultraleap_hands(HandMailbox& mailbox, const std::string& host, int port) {
    return std::make_unique<UltraleapHands>(mailbox, host, port);
}

void take_ultraleap(HandMailbox& mailbox, const char* text, std::size_t size, std::int64_t& last_id) {
    std::string wrong;
    const json message = parse_object({text, size}, wrong);
    if (!wrong.empty()) return mailbox.count_malformed(std::move(wrong));
    if (!message.contains("hands")) return;  // the service's version, and events of its devices
    std::array<HandFrame, 2> hands;
    wrong = read_hands(message, hands);
    const auto stamp = message.find("timestamp"), id = message.find("id");
    if (wrong.empty() && (stamp == message.end() || !stamp->is_number())) wrong = "expected a \"timestamp\"";
    if (!wrong.empty()) return mailbox.count_malformed(std::move(wrong));
    if (id != message.end() && id->is_number_integer()) {
        const auto number = id->get<std::int64_t>();
        if (last_id >= 0 && number > last_id + 1 && number < last_id + 10000) mailbox.count_lost(number - last_id - 1);
        last_id = number;
    }
    const double time = 1e-6 * stamp->get<double>();
    for (int hand : {0, 1}) mailbox.take(hand, hands[std::size_t(hand)], time);
}

nlohmann::json ultraleap_frame(std::int64_t id, double time, const std::array<const HandFrame*, 2>& hands) {
    json frame{{"id", id},
               {"timestamp", std::llround(1e6 * time)},
               {"currentFrameRate", 0},
               {"hands", json::array()},
               {"pointables", json::array()}};
    const Eigen::Matrix3d down = to_z_up(true).transpose();
    auto list = [](const Eigen::Vector3d& v) { return json{v.x(), v.y(), v.z()}; };
    for (int side : {0, 1}) {
        const HandFrame* hand = hands[std::size_t(side)];
        if (!hand || !hand->valid) continue;
        frame["hands"].push_back({{"id", side + 1}, {"type", hand_names[std::size_t(side)]}, {"confidence", 1}});
        for (int f = 0; f < 5; ++f) {
            const Pose<double>& pose = hand->finger[std::size_t(f)];
            const Mat3<double> R = rotation_matrix(pose.rotation);
            const Vec3<double> half = (0.5 * hand->length[std::size_t(f)]) * R.column(0);
            auto place = [&](const Vec3<double>& p) { return list(1e3 * (down * Eigen::Vector3d(p.x, p.y, p.z))); };
            // x sideways, y dorsal, z proximal.
            const Vec3<double> axes[3] = {cross(R.column(0), R.column(2)), R.column(2), -1.0 * R.column(0)};
            json basis = json::array();
            for (const Vec3<double>& a : axes) basis.push_back(list(down * Eigen::Vector3d(a.x, a.y, a.z)));
            frame["pointables"].push_back({{"id", 10 * (side + 1) + f},
                                           {"handId", side + 1},
                                           {"type", f},
                                           {"dipPosition", place(pose.position - half)},
                                           {"btipPosition", place(pose.position + half)},
                                           {"tipPosition", place(pose.position + half)},
                                           {"bases", {basis, basis, basis, basis}}});
        }
    }
    return frame;
}

struct UltraleapEmulator::State {
    std::array<std::shared_ptr<const HandRecording>, 2> hands;
    double speed = 1;
    bool loop = false;
    std::mutex mutex;
    std::condition_variable changed;
    bool ending = false;
    std::atomic<bool> ended{false};
    std::unique_ptr<WebServer> server;
    std::thread sender;

    struct Event {
        double time;
        std::array<const HandFrame*, 2> hands;
    };
    std::vector<Event> events() const;
    void send_all();
};

/// Both hands' frames by their times.
std::vector<UltraleapEmulator::State::Event> UltraleapEmulator::State::events() const {
    std::vector<Event> events;
    for (std::size_t side : {0u, 1u}) {
        if (!hands[side]) continue;
        for (const HandFrame& f : hands[side]->frames) {
            auto same = std::find_if(events.begin(), events.end(), [&](auto& e) { return e.time == f.time; });
            if (same == events.end()) same = events.insert(events.end(), Event{f.time, {}});
            same->hands[side] = &f;
        }
    }
    std::sort(events.begin(), events.end(), [](auto& a, auto& b) { return a.time < b.time; });
    return events;
}

void UltraleapEmulator::State::send_all() {
    using Clock = std::chrono::steady_clock;
    const std::vector<Event> all = events();
    const double length = all.back().time - all.front().time + 0.02;
    std::unique_lock lock(mutex);
    while (server->clients() == 0)
        if (changed.wait_for(lock, std::chrono::milliseconds(5), [&] { return ending; })) return;
    const auto start = Clock::now();
    std::int64_t id = 0;
    for (int round = 0; round == 0 || loop; ++round)
        for (const Event& e : all) {
            const double time = e.time - all.front().time + round * length;
            const auto due =
                start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(time / speed));
            if (changed.wait_until(lock, due, [&] { return ending; })) return;
            server->send_text(ultraleap_frame(++id, time, e.hands).dump());
        }
    ended = true;
}

UltraleapEmulator::UltraleapEmulator(int port, std::array<std::shared_ptr<const HandRecording>, 2> hands, double speed,
                                     bool loop)
    : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.hands = std::move(hands);
    s.speed = speed, s.loop = loop;
    WebHandlers handlers;
    handlers.accepts = [](const HttpHead& head, const WebPeer&) { return head.path() == "/v6.json"; };
    handlers.greeting = [] { return std::string("{\"serviceVersion\":\"palpate emulate-tracker\",\"version\":6}"); };
    handlers.message = [](const WebPeer&, const std::string&) { return true; };
    try {
        s.server = std::make_unique<WebServer>(port, false, std::move(handlers));
    } catch (const InputError&) {
        throw InputError("cannot listen on port " + std::to_string(port) +
                         ": is a Leap Motion service running? Choose another one with --port");
    }
    s.sender = std::thread([&s] { s.send_all(); });
}

UltraleapEmulator::~UltraleapEmulator() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->ending = true;
    }
    state_->changed.notify_all();
    state_->sender.join();
}

int UltraleapEmulator::port() const { return state_->server->port(); }
int UltraleapEmulator::clients() const { return state_->server->clients(); }
bool UltraleapEmulator::ended() const { return state_->ended; }
void UltraleapEmulator::drop_clients() { state_->server->drop_clients(); }

}  // namespace palpate
