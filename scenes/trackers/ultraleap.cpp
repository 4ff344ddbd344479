#include "scenes/trackers/ultraleap.h"

#include <civetweb.h>

#include <Eigen/Geometry>
#include <atomic>
#include <cmath>
#include <condition_variable>
#include <thread>

#include "meshes/input_error.h"

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
    const Eigen::Matrix3d up = upright(true);
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
            set_finger(out, type->get<int>(), 1e-3 * (up * joint), 1e-3 * (up * tip), up * axes);
            found |= 1 << type->get<int>();
        }
        out.valid = found == 31;
    }
    return "";
}

class UltraleapHands : public HandSourceThread {
  public:
    UltraleapHands(HandMailbox& mailbox, std::string host, int port)
        : mailbox_(mailbox), host_(std::move(host)), port_(port) {
        mg_init_library(MG_FEATURES_WEBSOCKET);
        connector_ = std::thread([this] { stay_connected(); });
    }
    ~UltraleapHands() override {
        {
            const std::lock_guard lock(mutex_);
            ending_ = true;
        }
        changed_.notify_all();
        connector_.join();
        mg_exit_library();
    }
    std::string about() const override {
        return "Leap Motion service at ws://" + host_ + ":" + std::to_string(port_) + "/v6.json";
    }

  private:
    void stay_connected() {
        while (true) {
            closed_ = false;
            last_id_ = -1;
            char error[200] = "";
            mg_connection* c = mg_connect_websocket_client(
                host_.c_str(), port_, 0, error, sizeof error, "/v6.json", nullptr,
                [](mg_connection*, int kind, char* text, std::size_t size, void* data) -> int {
                    auto& self = *static_cast<UltraleapHands*>(data);
                    if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE) return 0;
                    if ((kind & 0xf) == MG_WEBSOCKET_OPCODE_TEXT)
                        take_ultraleap(self.mailbox_, text, size, self.last_id_);
                    return 1;
                },
                [](const mg_connection*, void* data) {
                    auto& self = *static_cast<UltraleapHands*>(data);
                    {
                        const std::lock_guard lock(self.mutex_);
                        self.closed_ = true;
                    }
                    self.changed_.notify_all();
                },
                this);
            std::unique_lock lock(mutex_);
            if (c) {
                lock.unlock();
                mailbox_.count_connection();
                // Frames also while this program is not in front: the service asks for both, word for word.
                for (const std::string hello : {"{\"version\":6}", "{\"background\":true}"})
                    mg_websocket_client_write(c, MG_WEBSOCKET_OPCODE_TEXT, hello.data(), hello.size());
                lock.lock();
                changed_.wait(lock, [&] { return closed_ || ending_; });
                lock.unlock();
                mg_close_connection(c);
                lock.lock();
            }
            if (changed_.wait_for(lock, std::chrono::milliseconds(500), [&] { return ending_; })) return;
        }
    }
    HandMailbox& mailbox_;
    std::string host_;
    int port_;
    std::int64_t last_id_ = -1;
    std::mutex mutex_;
    std::condition_variable changed_;
    bool ending_ = false, closed_ = false;
    std::thread connector_;
};

}  // namespace

std::unique_ptr<HandSourceThread> receive_ultraleap_hands(HandMailbox& mailbox, const std::string& host, int port) {
    return std::make_unique<UltraleapHands>(mailbox, host, port);
}

void take_ultraleap(HandMailbox& mailbox, const char* text, std::size_t size, std::int64_t& last_id) {
    const json message = json::parse(text, text + size, nullptr, false);
    if (!message.is_object()) return mailbox.count_malformed("expected a JSON object");
    if (!message.contains("hands")) return;  // the service's version, and events of its devices
    std::array<HandFrame, 2> hands;
    std::string wrong = read_hands(message, hands);
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
    const Eigen::Matrix3d down = upright(true).transpose();
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
    mg_context* context = nullptr;
    int port = 0;
    std::array<std::shared_ptr<const HandRecording>, 2> hands;
    double speed = 1;
    bool loop = false;
    mutable std::mutex mutex;
    std::condition_variable changed;
    std::vector<mg_connection*> clients;
    bool ending = false, drop = false;
    std::atomic<bool> ended{false};
    std::thread sender;
    static State& of(void* data) { return *static_cast<State*>(data); }

    void send_all() {
        struct Event {
            double time;
            std::array<const HandFrame*, 2> hands;
        };
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
        const double length = events.back().time - events.front().time + 0.02;
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return !clients.empty() || ending; });
        const auto start = std::chrono::steady_clock::now();
        std::int64_t id = 0;
        for (int round = 0; !ending && (round == 0 || loop); ++round)
            for (const Event& e : events) {
                const double time = e.time - events.front().time + round * length;
                const auto due = start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                             std::chrono::duration<double>(time / speed));
                changed.wait_until(lock, due, [&] { return ending; });
                if (ending) return;
                const std::string text = ultraleap_frame(++id, time, e.hands).dump();
                for (mg_connection* c : clients) {
                    if (drop) mg_websocket_write(c, MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE, nullptr, 0);
                    mg_websocket_write(c, MG_WEBSOCKET_OPCODE_TEXT, text.data(), text.size());
                }
                drop = false;
            }
        ended = true;
    }
};

UltraleapEmulator::UltraleapEmulator(int port, std::array<std::shared_ptr<const HandRecording>, 2> hands, double speed,
                                     bool loop)
    : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.hands = std::move(hands);
    s.speed = speed, s.loop = loop;
    const std::string address = "127.0.0.1:" + std::to_string(port);
    const char* options[] = {"listening_ports", address.c_str(), "num_threads", "4", nullptr};
    mg_init_library(MG_FEATURES_WEBSOCKET);
    mg_callbacks callbacks{};
    s.context = mg_start(&callbacks, &s, options);
    if (!s.context) {
        mg_exit_library();
        throw InputError("cannot listen on port " + std::to_string(port) +
                         ": is a Leap Motion service running? Choose another one with --port");
    }
    mg_server_port listening[4];
    if (mg_get_server_ports(s.context, 4, listening) > 0) s.port = listening[0].port;
    mg_set_websocket_handler(
        s.context, "/v6.json", [](const mg_connection*, void*) -> int { return 0; },
        [](mg_connection* c, void* data) {
            State& state = State::of(data);
            const std::string hello = "{\"serviceVersion\":\"palpate emulate-tracker\",\"version\":6}";
            mg_websocket_write(c, MG_WEBSOCKET_OPCODE_TEXT, hello.data(), hello.size());
            {
                const std::lock_guard lock(state.mutex);
                state.clients.push_back(c);
            }
            state.changed.notify_all();
        },
        [](mg_connection*, int kind, char*, std::size_t, void*) -> int {
            return (kind & 0xf) != MG_WEBSOCKET_OPCODE_CONNECTION_CLOSE;
        },
        [](const mg_connection* c, void* data) {
            State& state = State::of(data);
            const std::lock_guard lock(state.mutex);
            state.clients.erase(std::remove(state.clients.begin(), state.clients.end(), c), state.clients.end());
        },
        &s);
    s.sender = std::thread([&s] { s.send_all(); });
}

UltraleapEmulator::~UltraleapEmulator() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->ending = true;
    }
    state_->changed.notify_all();
    state_->sender.join();
    mg_stop(state_->context);
    mg_exit_library();
}

int UltraleapEmulator::port() const { return state_->port; }
int UltraleapEmulator::clients() const {
    const std::lock_guard lock(state_->mutex);
    return int(state_->clients.size());
}
bool UltraleapEmulator::ended() const { return state_->ended; }
void UltraleapEmulator::drop_clients() {
    const std::lock_guard lock(state_->mutex);
    state_->drop = true;
}

}  // namespace palpate
