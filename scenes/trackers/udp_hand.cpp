#include "scenes/trackers/udp_hand.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "meshes/input_error.h"

namespace palpate {

using Clock = std::chrono::steady_clock;

struct UdpHand::State {
    int socket = -1, port = 0;
    std::string hand;
    std::atomic<bool> ending{false};
    mutable std::mutex mutex;
    HandRecording::Frame newest;
    Clock::time_point arrived{};
    UdpHandCounts counts;
    std::thread receiver;

    void take(const char* text, std::size_t size) {
        const auto json = nlohmann::json::parse(text, text + size, nullptr, false);
        HandRecording::Frame frame;
        HandFrameUnits units;
        std::string wrong = json.is_object() ? read_units(json, units) : "expected a JSON object";
        const auto which = json.is_object() ? json.find("hand") : json.end();
        if (wrong.empty() && which != json.end() && *which != hand) return;  // the other hand
        if (wrong.empty()) wrong = read_hand_frame(json, units, frame);
        const std::lock_guard lock(mutex);
        if (!wrong.empty()) {
            ++counts.malformed;
            counts.last_problem = std::move(wrong);
            return;
        }
        ++counts.frames;
        newest = frame;
        arrived = Clock::now();
    }
    void receive() {
        std::vector<char> buffer(65536);
        while (!ending) {
            pollfd p{socket, POLLIN, 0};
            if (poll(&p, 1, 100) <= 0) continue;
            const ssize_t n = recv(socket, buffer.data(), buffer.size(), 0);
            if (n > 0) take(buffer.data(), std::size_t(n));
        }
    }
};

UdpHand::UdpHand(int port, const std::string& hand, bool any_address) : state_(std::make_unique<State>()) {
    State& s = *state_;
    s.hand = hand;
    s.socket = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(std::uint16_t(port));
    address.sin_addr.s_addr = htonl(any_address ? INADDR_ANY : INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (s.socket < 0 || bind(s.socket, reinterpret_cast<sockaddr*>(&address), size) != 0 ||
        getsockname(s.socket, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
        if (s.socket >= 0) close(s.socket);
        throw InputError("cannot receive a hand on UDP port " + std::to_string(port) +
                         ": is another program using it? Choose one with --hand-port");
    }
    s.port = ntohs(address.sin_port);
    s.receiver = std::thread([&s] { s.receive(); });
}

UdpHand::~UdpHand() {
    state_->ending = true;
    state_->receiver.join();
    close(state_->socket);
}

int UdpHand::port() const { return state_->port; }

UdpHandCounts UdpHand::counts() const {
    const std::lock_guard lock(state_->mutex);
    return state_->counts;
}

TrackerPose::Sample UdpHand::newest(int finger) const {
    const std::lock_guard lock(state_->mutex);
    TrackerPose::Sample sample;
    const bool recent = state_->counts.frames > 0 && Clock::now() - state_->arrived < std::chrono::milliseconds(250);
    sample.valid = recent && state_->newest.valid;
    sample.pose = state_->newest.finger[std::size_t(finger)];
    return sample;
}

}  // namespace palpate
