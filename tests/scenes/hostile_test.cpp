// Trackers that send anything at all, while fingers touch something: nothing crashes, the memory stays, and no thimble
// moves faster than it may.

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "scenes/run/dead_man.h"
#include "scenes/run/simulation.h"
#include "scenes/trackers/ultraleap.h"
#include "scenes/web/server.h"
#include "scenes/web/websocket.h"
#include "tests/support.h"

namespace palpate {
namespace {

using nlohmann::json;

/// Largest resident memory, from now on if `reset` [MB].
double peak_memory(bool reset) {
    if (reset) std::ofstream("/proc/self/clear_refs") << 5;
    std::ifstream in("/proc/self/status");
    for (std::string line; std::getline(in, line);)
        if (line.starts_with("VmHWM:")) return 1e-3 * std::atof(line.c_str() + 6);
    return 0;
}

/// Messages of a recorded hand, and what a hostile sender makes of them.
struct Messages {
    std::mt19937 random{17};
    std::shared_ptr<const HandRecording> hand;
    std::size_t frame = 0;
    std::int64_t id = 0;

    int below(int n) { return int(random() % unsigned(n)); }

    json good(bool ultraleap) {
        const HandFrame& f = hand->frames[frame++ / 80 % hand->frames.size()];  // slowly
        ++id;
        if (ultraleap) return ultraleap_frame(id, 0.01 * double(id), {nullptr, &f});
        json j = json::parse(hand_line(1, f));
        j["units"] = "m", j["up"] = "z";
        j.erase("t");
        return j;
    }
    json anything() {
        const double numbers[] = {0, -1, 1e308, -1e308, 1e-320, 4, 26, 0.5, -0.0, 1e9};
        switch (below(8)) {
            case 0:
                return nullptr;
            case 1:
                return below(2) == 0;
            case 2:
                return numbers[below(10)];
            case 3:
                return std::string(std::size_t(below(40)), char(' ' + below(90)));
            case 4:
                return json::array({anything(), numbers[below(10)]});
            case 5:
                return json::object({{"x", below(3)}});
            case 6:
                return std::int64_t(random()) << 31;
            default:
                return "right";
        }
    }
    /// Something inside becomes something else.
    void mutate(json& j) {
        json* at = &j;
        while (at->is_structured() && !at->empty() && below(6)) {
            auto it = at->begin();
            std::advance(it, below(int(at->size())));
            at = &*it;
        }
        if (at->is_array() && !at->empty() && below(3) == 0)
            at->erase(std::size_t(below(int(at->size()))));
        else if (at->is_object() && !at->empty() && below(3) == 0)
            at->erase(at->begin());
        else
            *at = anything();
    }
    std::string nested(int depth) {
        const char* keys[] = {"hand", "units", "up", "joints", "hands", "t"};
        const bool closed = below(2) == 0;
        return std::string("{\"") + keys[below(6)] + "\":" + std::string(std::size_t(depth), '[') +
               std::string(closed ? std::size_t(depth) : 0u, ']') + "}";
    }
    std::string next(bool ultraleap) {
        const int kind = below(40);
        if (kind == 0) return nested(1 + below(500));
        if (kind == 1 && below(20) == 0) return nested(200'000);
        if (kind == 2 && below(20) == 0) return "{\"x\":\"" + std::string(std::size_t(below(2'000'000)), 'x') + "\"}";
        json j = good(ultraleap);
        for (int k = kind < 20 ? 0 : below(4); k > 0; --k) mutate(j);
        if (kind == 3 && j.is_object()) j["t"] = below(100) - 50;
        std::string text = j.dump();
        if (kind >= 36) text.resize(std::size_t(below(int(text.size()))));
        for (int k = kind >= 33 ? below(4) : 0; k > 0 && !text.empty(); --k)
            text[std::size_t(below(int(text.size())))] = char(random());
        return text;
    }
};

/// Hands that touch a ball, and how far their thimbles moved in a step.
struct Touched {
    Simulation simulation = make_simulation(load_scene(testing::source_dir() + "/scenes/recorded_hand.toml"), 1);
    std::vector<Coordinates> q, velocity;
    int touching = 0;

    explicit Touched(const std::string& source) {
        follow_live(simulation, std::make_shared<LiveHands>(source));
        for (const auto& loop : simulation.loops) q.push_back(loop->q), velocity.push_back(loop->velocity);
    }
    HandMailbox& mailbox() { return simulation.live->mailbox; }
    /// A step. Returns what a thimble did that it must not do.
    std::string advance_and_judge() {
        advance(simulation);
        for (Series& series : simulation.finger_series) series.values.clear();
        simulation.step_series.values.clear();
        for (const ContactSurface& c : simulation.world.contact_surfaces) touching += c.normal_force > 0.01;
        std::string wrong;
        for (std::size_t t = 0; t < simulation.loops.size(); ++t) {
            const ThimbleLoop& loop = *simulation.loops[t];
            const double period = loop.settings.period, slack = 1 + 1e-9;
            const SlewLimits& most = loop.settings.limits;
            if (!loop.q.allFinite()) wrong += "not finite; ";
            if (!((loop.q - q[t]).cwiseAbs().maxCoeff() <= most.velocity * period * slack)) wrong += "too fast; ";
            if (!((loop.velocity - velocity[t]).cwiseAbs().maxCoeff() <= most.acceleration * period * slack))
                wrong += "accelerates too much; ";
            q[t] = loop.q, velocity[t] = loop.velocity;
        }
        return wrong;
    }
};

/// How many of the environment's name, or so many.
int asked_for(const char* name, int otherwise) {
    const char* asked = std::getenv(name);
    return asked ? std::atoi(asked) : otherwise;
}

TEST(LiveTracker, RandomMessagesOfAllSourcesAreHarmless) {
    const int count = asked_for("PALPATE_TRACKER_MESSAGES", 3'000);
    Touched touched("udp:0");
    Messages messages;
    messages.hand = touched.simulation.scene.recordings[1];
    ASSERT_TRUE(messages.hand);
    HandMailbox& mailbox = touched.mailbox();
    std::int64_t last_id = -1;
    double before = 0;
    for (int k = 0; k < count; ++k) {
        const bool ultraleap = messages.below(2) == 0;
        const std::string text = messages.next(ultraleap);
        if (ultraleap)
            take_ultraleap(mailbox, text.data(), text.size(), last_id);
        else
            take_joints(mailbox, text.data(), text.size());
        if (k == count / 10) before = peak_memory(true);
        if (k % 20) continue;
        ASSERT_EQ(touched.advance_and_judge(), "") << "message " << k;
    }
    EXPECT_GT(touched.touching, count / 2000) << "the ball was hardly touched";
    EXPECT_LT(peak_memory(false) - before, 20) << "MB";
    const HandCounts counts = mailbox.counts();
    EXPECT_GT(counts.malformed, count / 10);
    EXPECT_GT(counts.frames[1], count / 10);
}

/// Somebody who sends, and takes no offence at being thrown out.
struct Sender {
    virtual ~Sender() = default;
    virtual void send(const std::string& message, std::mt19937& random) = 0;
};

int connected(int type, int port) {
    const int fd = socket(AF_INET, type, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{20, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    EXPECT_EQ(connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);
    return fd;
}

struct UdpSender final : Sender {
    int fd;
    explicit UdpSender(int port) : fd(connected(SOCK_DGRAM, port)) {}
    ~UdpSender() override { close(fd); }
    void send(const std::string& message, std::mt19937&) override {
        [[maybe_unused]] const auto sent =
            ::send(fd, message.data(), std::min<std::size_t>(message.size(), 65507), MSG_NOSIGNAL);
    }
};

/// Fragments, too, and now and then bytes that are no WebSocket's.
struct WebsocketSender final : Sender {
    int port, fd = -1;
    explicit WebsocketSender(int port) : port(port) {}
    ~WebsocketSender() override { close(fd); }
    void greet() {
        close(fd);
        fd = connected(SOCK_STREAM, port);
        const std::string hello =
            "GET /hand HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";
        ASSERT_EQ(write(fd, hello.data(), hello.size()), ssize_t(hello.size()));
        std::string answer;
        for (char c; !answer.ends_with("\r\n\r\n") && read(fd, &c, 1) == 1;) answer += c;
        ASSERT_TRUE(answer.starts_with("HTTP/1.1 101")) << answer;
    }
    void send(const std::string& message, std::mt19937& random) override {
        const Mask mask{1, 2, 3, std::uint8_t(random())};
        Bytes out;
        append_message(out, Opcode::text, bytes_of(message), &mask);
        if (random() % 300 == 0)
            for (std::uint8_t& byte : out) byte = std::uint8_t(random());
        if (fd < 0) greet();
        for (std::size_t at = 0; at < out.size();) {
            const ssize_t n =
                ::send(fd, out.data() + at, std::min<std::size_t>(out.size() - at, 1 + random() % 9000), MSG_NOSIGNAL);
            if (n <= 0) return greet();
            at += std::size_t(n);
        }
    }
};

/// A Leap Motion service gone mad. Whoever is thrown out comes back after half a second.
struct ServiceSender final : Sender {
    WebServer& service;
    explicit ServiceSender(WebServer& service) : service(service) {}
    void send(const std::string& message, std::mt19937&) override {
        if (message.size() > 65536 && skipped++ % 8) return;  // for this costs time
        if (service.clients() == 0) testing::eventually([&] { return service.clients() > 0; });
        service.send_text(message);
    }
    int skipped = 0;
};

/// The same through the sockets that trackers send to, or are connected to.
TEST(LiveTracker, RandomMessagesThroughSocketsAreHarmless) {
    const int count = asked_for("PALPATE_SOCKET_MESSAGES", 5'000) / 3;
    WebHandlers anybody;
    anybody.accepts = [](const HttpHead&, const WebPeer&) { return true; };
    anybody.message = [](const WebPeer&, const std::string&) { return true; };
    WebServer service(0, false, std::move(anybody));
    for (const std::string source : {"udp:0", "websocket:0", "ultraleap:127.0.0.1:"}) {
        SCOPED_TRACE(source);
        const bool ultraleap = source[1] == 'l';
        Touched touched(ultraleap ? source + std::to_string(service.port()) : source);
        Messages messages;
        messages.hand = touched.simulation.scene.recordings[1];
        ASSERT_TRUE(messages.hand);
        const int port = touched.simulation.live->source->port();
        std::unique_ptr<Sender> sender;
        if (source[0] == 'u' && !ultraleap) sender = std::make_unique<UdpSender>(port);
        if (source[0] == 'w') sender = std::make_unique<WebsocketSender>(port);
        if (ultraleap) sender = std::make_unique<ServiceSender>(service);
        auto taken = [&] {
            const HandCounts c = touched.mailbox().counts();
            return c.frames[0] + c.frames[1] + c.malformed + c.backward;
        };
        double before = 0;
        for (int k = 0; k < count; ++k) {
            sender->send(messages.next(ultraleap), messages.random);
            if (k == count / 10) before = peak_memory(true);
            if (k % 20) continue;
            // No faster than they are read: it is not the kernel's queue that is tried.
            for (std::int64_t n = -1, now = taken(); n != now; n = now, now = taken())
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            ASSERT_EQ(touched.advance_and_judge(), "") << "message " << k;
        }
        EXPECT_GT(touched.touching, count / 2000) << "the ball was hardly touched";
        EXPECT_LT(peak_memory(false) - before, 20) << "MB";
        const HandCounts counts = touched.mailbox().counts();
        EXPECT_GT(counts.malformed, count / 20);
        EXPECT_GT(counts.frames[1], count / 20);
    }
}

TEST(DeadMan, WhoeverSendsWithoutEndHoldsNobodyUp) {
    const auto endless = make_dead_man("joystick:/dev/zero");
    for (int k = 0; k < 100; ++k) EXPECT_FALSE(endless->held());
}

TEST(DeadMan, WhatWasSaidWhileNobodyAskedCountsNoMore) {
    const std::string port = std::to_string(20000 + ::getpid() % 30000);
    const auto heart = make_dead_man("heartbeat:" + port);
    UdpSender sender(std::stoi(port));
    std::mt19937 unused;
    EXPECT_FALSE(heart->held());
    sender.send("1", unused);
    EXPECT_TRUE(testing::eventually([&] { return heart->held(); }));
    // The program stands still; the hand lets go meanwhile, which a lost datagram would have said.
    sender.send("1", unused);
    std::this_thread::sleep_for(std::chrono::milliseconds(600));
    EXPECT_FALSE(heart->held());
    EXPECT_FALSE(heart->held());
}

TEST(DeadMan, HeartbeatsOfOtherWordsAreCountedAndSaidOnce) {
    const std::string port = std::to_string(20000 + (::getpid() + 1) % 30000);
    const auto heart = make_dead_man("heartbeat:" + port);
    Simulation none;
    UdpSender sender(std::stoi(port));
    std::mt19937 unused;
    const auto obeyed = [&](const auto& done) {
        return testing::eventually([&] {
            obey_dead_man(*heart, none);
            return done();
        });
    };
    obey_dead_man(*heart, none);
    EXPECT_EQ(take_news(*heart), "");
    sender.send("0", unused);
    for (const char* word : {"x", "", "held"}) sender.send(word, unused);
    ASSERT_TRUE(obeyed([&] { return heart->counts.foreign == 3; })) << heart->counts.foreign;
    EXPECT_NE(take_news(*heart).find("--hold heartbeat:" + port + ": a datagram says neither 1 (held) nor 0 (let go)"),
              std::string::npos);
    EXPECT_EQ(take_news(*heart), "");
    EXPECT_NE(hold_report(*heart).find(": never held in "), std::string::npos) << hold_report(*heart);
    EXPECT_NE(hold_report(*heart).find("; 3 datagrams said neither"), std::string::npos) << hold_report(*heart);
    sender.send("1\n", unused);
    ASSERT_TRUE(obeyed([&] { return heart->counts.held > 0; }));
    EXPECT_NE(hold_report(*heart).find(": held for "), std::string::npos) << hold_report(*heart);
    EXPECT_EQ(heart->counts.foreign, 3);
}

}  // namespace
}  // namespace palpate
