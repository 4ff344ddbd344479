// Live hands over UDP, WebSocket and from a Leap Motion service: what is understood, what hostile or broken senders can
// do, and how tracked fingers are fitted to the model's.

#include <arpa/inet.h>
#include <civetweb.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "meshes/input_error.h"
#include "scenes/run/grasp.h"
#include "scenes/trackers/pinch_fit.h"
#include "scenes/trackers/ultraleap.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;

void send(int port, const std::string& text) {
    const int s = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    sendto(s, text.data(), text.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
    close(s);
}

constexpr int left = 0, right = 1;

/// Lines with joints of the repository's recording: one datagram each.
std::vector<std::string> recorded_frames() {
    std::ifstream in(testing::source_dir() + "/scenes/pinch.jsonl");
    std::vector<std::string> lines;
    nlohmann::json header;
    for (std::string line; std::getline(in, line);) {
        auto json = nlohmann::json::parse(line);
        if (!json.contains("joints")) {
            header = json;
            continue;
        }
        for (const char* key : {"units", "up"})
            if (header.contains(key)) json[key] = header[key];
        lines.push_back(json.dump());
    }
    return lines;
}

TEST(UdpHand, ALiveHandIsTheRecordedOne) {
    const HandRecording recording = read_hand_recording(testing::source_dir() + "/scenes/pinch.jsonl", "right");
    const auto lines = recorded_frames();
    ASSERT_EQ(lines.size(), recording.frames.size());
    LiveHands live("udp:0");
    HandMailbox& hand = live.mailbox;
    EXPECT_FALSE(hand.newest(right, 1).valid);
    for (std::size_t k : {std::size_t(0), lines.size() / 2}) {
        const auto before = hand.counts().frames[right];
        send(live.source->port(), lines[k]);
        ASSERT_TRUE(eventually([&] { return hand.counts().frames[right] > before; }));
        for (int f = 0; f < 5; ++f) {
            const TrackerPose::Sample s = hand.newest(right, f);
            EXPECT_TRUE(s.valid);
            EXPECT_EQ(s.pose.position.x, recording.frames[k].finger[f].position.x);
            EXPECT_EQ(s.pose.rotation.w, recording.frames[k].finger[f].rotation.w);
        }
    }
    EXPECT_TRUE(eventually([&] { return !hand.newest(right, 1).valid; }));  // silence: the hand is gone
}

TEST(UdpHand, BadMessagesAreCountedAndChangeNothing) {
    const std::string good = recorded_frames()[0];
    LiveHands live("udp:0");
    HandMailbox& hand = live.mailbox;
    const int port = live.source->port();
    send(port, good);
    ASSERT_TRUE(eventually([&] { return hand.counts().frames[right] == 1; }));
    const std::vector<std::string> bad{"",
                                       "{",
                                       good.substr(0, good.size() / 2),
                                       "[1, 2]",
                                       "null",
                                       "{\"joints\": 26}",
                                       "{\"joints\": [[1]]}",
                                       "{\"hand\": 7, \"joints\": {}}",
                                       "{\"units\": 3, \"joints\": []}",
                                       std::string(60000, '['),
                                       std::string("\xff\x00\xfe", 3)};
    for (const auto& text : bad) send(port, text);
    std::string nan = good;
    nan.replace(nan.find("[["), 2, "[[NaN,");
    send(port, nan);
    // An empty datagram is no message, and one of no hand of ours is passed over.
    EXPECT_TRUE(eventually([&] { return hand.counts().malformed >= std::int64_t(bad.size()) - 1; }));
    EXPECT_EQ(hand.counts().frames[right], 1);
    EXPECT_FALSE(hand.counts().last_problem.empty());
    EXPECT_THROW(LiveHands("udp:" + std::to_string(port)), InputError);
}

std::shared_ptr<const HandRecording> recorded(const std::filesystem::path& path) {
    return std::make_shared<HandRecording>(read_hand_recording(path, "right"));
}

TEST(HandMailbox, CountsWhatComesLateAndTellsTheTiming) {
    const HandRecording recording = *recorded(testing::source_dir() + "/scenes/pinch.jsonl");
    HandMailbox mailbox;
    mailbox.take(right, recording.frames[5], 10.0);
    mailbox.take(right, recording.frames[6], 9.98);  // overtaken
    EXPECT_EQ(mailbox.counts().backward, 1);
    EXPECT_EQ(mailbox.newest(right, 1).pose.position.x, recording.frames[5].finger[1].position.x);
    EXPECT_FALSE(mailbox.newest(left, 1).valid);
    mailbox.take(right, recording.frames[7], 0.5);  // a tracker that was started anew
    EXPECT_EQ(mailbox.newest(right, 1).pose.position.x, recording.frames[7].finger[1].position.x);
    HandFrame gone = recording.frames[8];
    gone.valid = false;
    mailbox.take(right, gone, 0.6);
    EXPECT_FALSE(mailbox.newest(right, 1).valid) << "the tracker sees it no more";
    HandMailbox timed;
    for (int k = 0; k < 20; ++k, usleep(5000)) timed.take(right, recording.frames[0], 0.01 * k);
    const HandTiming t = timed.timing();
    EXPECT_TRUE(t.has_clock);
    EXPECT_GT(t.rate_Hz, 10);
    EXPECT_LT(t.rate_Hz, 201);
    EXPECT_GE(t.interval_ms, 5);
    EXPECT_GE(t.delay_ms, 0);
}

/// The service's own protocol there and back: what arrives is what was recorded, at its own times.
TEST(Ultraleap, AnEmulatedServiceGivesTheRecordedHand) {
    std::filesystem::path file = testing::source_dir() + "/scenes/pinch.jsonl";
    if (!testing::shared_data().empty()) file = testing::shared_data() / "tracking/pinch_57fps.csv";
    const auto recording = recorded(file);
    UltraleapEmulator service(0, {nullptr, recording}, 4, false);
    std::mutex mutex;
    std::vector<HandFrame> seen;
    LiveHands live("ultraleap:127.0.0.1:" + std::to_string(service.port()), false,
                   [&](int hand, const HandFrame& frame) {
                       EXPECT_EQ(hand, right);
                       const std::lock_guard lock(mutex);
                       seen.push_back(frame);
                   });
    ASSERT_TRUE(eventually([&] { return service.ended(); }));
    ASSERT_TRUE(eventually([&] {
        return live.mailbox.counts().frames[right] == std::int64_t(recording->frames.size());
    })) << to_text(live.mailbox.counts());
    EXPECT_EQ(live.mailbox.counts().malformed, 0);
    EXPECT_EQ(live.mailbox.counts().lost, 0);
    const std::lock_guard lock(mutex);
    ASSERT_EQ(seen.size(), recording->frames.size());
    for (std::size_t k = 0; k < seen.size(); ++k)
        for (std::size_t f = 0; f < 5; ++f) {
            const Pose<double>&a = seen[k].finger[f], &b = recording->frames[k].finger[f];
            EXPECT_LT(norm(a.position - b.position), 1e-12);
            EXPECT_LT(norm(shorter_twice_vector(a.rotation * conjugate(b.rotation))), 1e-9);
            EXPECT_NEAR(seen[k].length[f], recording->frames[k].length[f], 1e-12);
        }
}

TEST(Ultraleap, ComesBackAfterTheServiceWasStartedAnew) {
    const auto recording = recorded(testing::source_dir() + "/scenes/pinch.jsonl");
    auto service = std::make_unique<UltraleapEmulator>(0, std::array{recording, recording}, 1, true);
    const int port = service->port();
    LiveHands live("ultraleap:127.0.0.1:" + std::to_string(port));
    ASSERT_TRUE(eventually([&] { return live.mailbox.counts().frames[left] > 5; })) << "both hands";
    service->drop_clients();
    ASSERT_TRUE(eventually([&] { return live.mailbox.counts().connections == 2; }));
    service.reset();
    EXPECT_TRUE(eventually([&] { return !live.mailbox.newest(right, 1).valid; }));
    service = std::make_unique<UltraleapEmulator>(port, std::array{recording, recording}, 1, true);
    EXPECT_TRUE(eventually([&] { return live.mailbox.newest(right, 1).valid; }));
}

TEST(Ultraleap, BadMessagesAreCountedAndChangeNothing) {
    const auto recording = recorded(testing::source_dir() + "/scenes/pinch.jsonl");
    const nlohmann::json good = ultraleap_frame(1, 0.1, {nullptr, &recording->frames[0]});
    HandMailbox mailbox;
    std::int64_t last_id = -1;
    auto take = [&](const std::string& text) { take_ultraleap(mailbox, text.data(), text.size(), last_id); };
    take(good.dump());
    ASSERT_EQ(mailbox.counts().frames[right], 1);
    // What the service says beside frames is no fault.
    take(R"({"serviceVersion": "2.3.1", "version": 6})");
    take(R"({"event": {"type": "deviceEvent", "state": {"attached": true}}})");
    EXPECT_EQ(mailbox.counts().malformed, 0);
    int bad = 0;
    auto refuse = [&](const std::string& text) {
        take(text);
        EXPECT_EQ(mailbox.counts().malformed, ++bad) << text.substr(0, 80);
    };
    for (const char* text : {"", "{", "[]", "null", "{\"hands\": 1}", "{\"hands\": []}", "\xff\xfe"}) refuse(text);
    refuse(good.dump().substr(0, 300));
    for (const char* path : {"/hands/0/type", "/hands/0/id", "/pointables/0/type", "/pointables/1/bases",
                             "/pointables/2/dipPosition/0", "/pointables/3/bases/3/1", "/timestamp"})
        for (const nlohmann::json& value : {nlohmann::json(nullptr), nlohmann::json("x"), nlohmann::json::array()}) {
            nlohmann::json broken = good;
            broken[nlohmann::json::json_pointer(path)] = value;
            refuse(broken.dump());
        }
    EXPECT_EQ(mailbox.counts().frames[right], 1);
    // Frames that never came are counted.
    nlohmann::json later = good;
    later["id"] = 5, later["timestamp"] = 200000;
    take(later.dump());
    EXPECT_EQ(mailbox.counts().lost, 3);
    // A hand without all of its fingers is not seen.
    nlohmann::json part = later;
    part["pointables"].erase(0), part["id"] = 6, part["timestamp"] = 300000;
    take(part.dump());
    EXPECT_FALSE(mailbox.newest(right, 1).valid);
}

/// A page, or a program, that sends hands to ws://.../hand.
struct Sender {
    mg_connection* connection = nullptr;
    explicit Sender(int port, const char* origin = nullptr, const std::string& path = "/hand") {
        char error[200] = "";
        connection = mg_connect_websocket_client(
            "127.0.0.1", port, 0, error, sizeof error, path.c_str(), origin,
            [](mg_connection*, int, char*, std::size_t, void*) -> int { return 1; }, nullptr, nullptr);
    }
    ~Sender() {
        if (connection) mg_close_connection(connection);
    }
    void send(const std::string& text) {
        mg_websocket_client_write(connection, MG_WEBSOCKET_OPCODE_TEXT, text.data(), text.size());
    }
};

TEST(WebsocketHand, TakesHandsFromThisMachineAlone) {
    LiveHands live("websocket:0");
    const int port = live.source->port();
    const auto lines = recorded_frames();
    Sender page(port, "http://localhost:8080");
    ASSERT_TRUE(page.connection);
    for (std::size_t k = 0; k < 20; ++k) page.send(lines[k]);
    EXPECT_TRUE(eventually([&] { return live.mailbox.counts().frames[right] == 20; }));
    EXPECT_TRUE(live.mailbox.newest(right, 1).valid);
    for (const char* bad : {"", "{", "[]", "{\"joints\": []}"}) page.send(bad);
    EXPECT_TRUE(eventually([&] { return live.mailbox.counts().malformed >= 3; }));
    page.send(std::string(100000, 'x'));
    EXPECT_TRUE(eventually([&] { return live.mailbox.counts().last_problem == "a message of more than 64 kB"; }));
    for (const char* other : {"http://example.com", "https://localhost.example.com", "http://localhost:evil", "null"})
        EXPECT_FALSE(Sender(port, other).connection) << other;
    EXPECT_THROW(LiveHands("websocket:" + std::to_string(port)), InputError);
}

TEST(WebsocketHand, PagesOfOtherMachinesNeedTheToken) {
    LiveHands live("websocket:0", true);
    const int port = live.source->port();
    const std::string about = live.source->about(), path = about.substr(about.find("/hand"));
    ASSERT_NE(path.find("?token="), std::string::npos) << about;
    const char* elsewhere = "https://headset.example.com";
    EXPECT_FALSE(Sender(port, elsewhere).connection);
    EXPECT_FALSE(Sender(port, elsewhere, "/hand?token=0123456789abcdef0123456789abcdef").connection);
    EXPECT_FALSE(Sender(port, "http://localhost:evil").connection);
    EXPECT_TRUE(Sender(port, elsewhere, path).connection);
    EXPECT_TRUE(Sender(port, "http://localhost:8080").connection);
}

/// Messages that would be read by recursion, or fill the memory, are refused before they are parsed.
TEST(LiveTracker, DepthAndSizeAreBoundedOnEveryWayIn) {
    HandMailbox mailbox;
    std::int64_t last_id = -1;
    for (const char* key : {"hand", "units", "up", "valid", "joints", "hands", "pointables", "anything"})
        for (const int depth : {17, 450, 30'000, 5'000'000}) {
            const std::string text =
                std::string("{\"") + key + "\":" + std::string(depth - 1, '[') + std::string(depth - 1, ']') + "}";
            const auto before = mailbox.counts().malformed;
            take_joints(mailbox, text.data(), text.size());
            take_ultraleap(mailbox, text.data(), text.size(), last_id);
            EXPECT_EQ(mailbox.counts().malformed, before + 2);
            const std::string problem = mailbox.counts().last_problem;
            EXPECT_TRUE(problem == "a message nested more than 16 deep" || problem == "a message of more than 64 kB")
                << problem;
        }
    const testing::ScratchFolder folder;
    const std::string file = (folder.path / "deep.jsonl").string();
    std::ofstream(file) << "{\"units\":" << std::string(5'000'000, '[') << std::string(5'000'000, ']') << "}\n";
    const testing::Outcome o = testing::palpate_program("tracker " + file);
    EXPECT_EQ(o.code, 2) << o.out;
    EXPECT_NE(o.out.find("deep.jsonl:1: a message of more than 64 kB"), std::string::npos) << o.out;
}

/// Everything that a tracker can do wrong, to the program as it is shipped: counted and said, never a crash, and never
/// a jump of a thimble.
TEST(LiveTracker, HostileInputNeverMovesAThimbleFasterThanItMay) {
    const testing::ScratchFolder folder;
    const std::string log = (folder.path / "log").string(), out = (folder.path / "out").string();
    const pid_t child = fork();
    if (child == 0) {
        if (!freopen(log.c_str(), "w", stdout)) _exit(3);
        setvbuf(stdout, nullptr, _IOLBF, 0);
        execl(testing::program_path().c_str(), "palpate", "run",
              (testing::source_dir() + "/scenes/recorded_hand.toml").c_str(), "--tracker", "udp:0", "--duration", "2.5",
              "--out", out.c_str(), nullptr);
        _exit(4);
    }
    int port = 0;
    ASSERT_TRUE(eventually([&] {
        std::ifstream in(log);
        for (std::string line; std::getline(in, line);)
            if (const auto at = line.find("UDP port "); at != std::string::npos)
                port = std::atoi(line.c_str() + at + 9);
        return port > 0;
    }));
    const auto lines = recorded_frames();
    std::mt19937 random(9);
    std::uniform_real_distribution<double> u(-1, 1);
    for (int k = 0; k < 400; ++k, usleep(5000)) {
        nlohmann::json frame = nlohmann::json::parse(lines[std::size_t(k) % lines.size()]);
        frame.erase("t");
        auto& joints = frame["joints"];
        auto of_all = [&](auto change) {
            for (auto& j : joints)
                if (j.is_array() && j.size() >= 7) change(j);
        };
        const int kind = int(random() % 10);
        if (kind == 0) of_all([](auto& j) { j[3] = j[4] = j[5] = j[6] = 0; });
        if (kind == 1)
            of_all([](auto& j) {
                for (int q = 3; q < 7; ++q) j[q] = -j[q].template get<double>();
            });
        if (kind == 2) of_all([&](auto& j) { j[0] = j[0].template get<double>() + 1; });
        if (kind == 3) of_all([](auto& j) { j[0] = 1e308, j[1] = -1e308; });
        if (kind == 4)
            of_all([&](auto& j) {
                for (int q = 0; q < 7; ++q) j[q] = 10 * u(random);
            });
        if (kind == 5) frame["t"] = u(random);
        std::string text = frame.dump();
        if (kind == 6) text.resize(text.size() / 2);
        if (kind == 7) text = std::string(60000, '[');
        if (kind == 8 && k % 50 == 0) usleep(500'000);  // gone for half a second
        send(port, text);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    std::ifstream in(log);
    const std::string said(std::istreambuf_iterator<char>(in), {});
    EXPECT_NE(said.find("messages that were none"), std::string::npos) << said;
    for (const char* finger : {"thumb", "index"}) {
        std::ifstream csv(out + "/" + finger + ".csv");
        std::string line, cell;
        std::getline(csv, line);
        std::map<std::string, std::size_t> column;
        std::istringstream head(line);
        for (std::size_t c = 0; std::getline(head, cell, ','); ++c) column[cell] = c;
        std::vector<double> last, now;
        while (std::getline(csv, line)) {
            now.clear();
            std::istringstream row(line);
            while (std::getline(row, cell, ',')) now.push_back(std::strtod(cell.c_str(), nullptr));
            for (std::size_t c = 0; c < now.size(); ++c) {
                const bool nowhere = c >= column.at("centre_x_mm") && now[1] == 0;  // nothing pushes
                ASSERT_TRUE(std::isfinite(now[c]) || nowhere) << finger << ": " << line;
            }
            for (int j = 1; j <= 3 && !last.empty(); ++j) {
                const std::size_t c = column.at("sent" + std::to_string(j) + "_deg");
                // 6 rad/s, and one tick of 20 ms at a time.
                EXPECT_LE(std::abs(now[c] - last[c]), 6 * 0.020 * 57.3 + 1e-6) << finger << " at " << now[0];
            }
            last = now;
        }
    }
}

TEST(HandRecording, LinesAreReadAsTheyWereWritten) {
    const testing::ScratchFolder folder;
    const auto recording = recorded(testing::source_dir() + "/scenes/pinch.jsonl");
    {
        std::ofstream out(folder.path / "copy.jsonl");
        out << hand_header() << "\n";
        for (const HandFrame& f : recording->frames) out << hand_line(right, f) << "\n";
    }
    const auto copy = recorded(folder.path / "copy.jsonl");
    ASSERT_EQ(copy->frames.size(), recording->frames.size());
    for (std::size_t k = 0; k < copy->frames.size(); ++k)
        for (std::size_t f = 0; f < 5; ++f) {
            const Pose<double>&a = copy->frames[k].finger[f], &b = recording->frames[k].finger[f];
            EXPECT_LT(norm(a.position - b.position), 1e-12);
            EXPECT_LT(norm(shorter_twice_vector(a.rotation * conjugate(b.rotation))), 1e-9);
        }
}

TEST(HandRecording, ColumnsOfOneNameAreRefused) {
    const testing::ScratchFolder folder;
    std::ofstream(folder.path / "twice.csv") << "t_us,hand,t_us\n1,right,2\n";
    try {
        recorded(folder.path / "twice.csv");
        FAIL();
    } catch (const InputError& error) {
        EXPECT_NE(error.messages[0].find("two columns are called 't_us'"), std::string::npos) << error.messages[0];
    }
}

TEST(HandRecording, GoesRoundAndSlowerWhereItIsAskedTo) {
    const std::string file = testing::source_dir() + "/scenes/recorded_hand.toml";
    const Scene plain = load_scene(file), slow = load_scene(file, {"recording.speed=0.5"}),
                round = load_scene(file, {"recording.loop=true"});
    EXPECT_EQ(tracked_pose(slow, 0, 1.0).pose.position.x, tracked_pose(plain, 0, 0.5).pose.position.x);
    const double length = plain.recordings[right]->frames.back().time;
    EXPECT_FALSE(tracked_pose(plain, 0, length + 0.3).valid);
    const TrackerPose::Sample again = tracked_pose(round, 0, length + 0.3);
    EXPECT_TRUE(again.valid);
    EXPECT_NEAR(again.pose.position.x, tracked_pose(plain, 0, 0.3).pose.position.x, 1e-12);
}

/// Two fingers that pinch: fitted, they touch each other at the same place, pads facing.
TEST(PinchFit, FittedFingersMeet) {
    const auto recording = recorded(testing::source_dir() + "/scenes/pinch.jsonl");
    const Scene scene = load_scene(testing::source_dir() + "/scenes/recorded_grasp.toml");
    const TetMesh &thumb = scene.spec.fingers[0].mesh, &index = scene.spec.fingers[1].mesh;
    for (double thickness : {0.0, 0.01}) {
        const PinchFit p = fit_pinch(*recording, {0, 1}, {&thumb, &index}, thickness);
        EXPECT_GT(p.frames, 10);
        const HandFrame& frame = *std::find_if(recording->frames.begin(), recording->frames.end(),
                                               [&](auto& f) { return f.time >= 0.5 * (p.start + p.end); });
        Vec3<double> touching[2], normal[2];
        for (std::size_t k : {0u, 1u}) {
            const Pose<double> pose = compose(frame.finger[k], p.fit[k]);
            const Vec3<double> towards = rotation_matrix(frame.finger[k].rotation) * p.direction[k];
            double most = -1e300;
            for (int node : (k == 0 ? thumb : index).pad_nodes) {
                const Point& n = (k == 0 ? thumb : index).nodes[std::size_t(node)];
                const Vec3<double> x = transform(pose, Vec3<double>{n[0], n[1], n[2]});
                if (dot(x, towards) > most) most = dot(x, towards), touching[k] = x;
            }
            normal[k] = towards;
            // The pad looks to the other finger as far as a roll can make it.
            const Mat3<double> R = rotation_matrix(pose.rotation);
            EXPECT_NEAR(dot(R.column(1), towards), 0, 0.1);
            EXPECT_LE(dot(R.column(2), towards), 0.1);
        }
        EXPECT_LT(dot(normal[0], normal[1]), -0.95);
        EXPECT_NEAR(dot(touching[1] - touching[0], normal[0]), thickness, 2e-3);
    }
    HandRecording open = *recording;
    for (HandFrame& f : open.frames) f.finger[0].position.x += 0.1;
    EXPECT_THROW(fit_pinch(open, {0, 1}, {&thumb, &index}, 0), InputError);
}

/// A real hand pinched nothing while it was recorded; fitted to the model, it holds a ball until it opens.
TEST(Tracking, ARecordedRealHandHoldsABall) {
    const auto data = testing::shared_data();
    if (data.empty()) GTEST_SKIP() << "the recording of a real hand is not in this checkout";
    const testing::ScratchFolder folder;
    const std::filesystem::path file = folder.path / "real.toml";
    std::string text;
    text += "duration_s = 1.75\ndt_ms = 5\n[limits]\nlow = 0.6\nhigh = 1.4\n";
    text += "[recording]\nfile = \"" + std::filesystem::absolute(data / "tracking/pinch_57fps.csv").string() + "\"\n";
    text += "[[object]]\nname = \"ball\"\nkind = \"sphere\"\nradius_mm = 6\nmass_g = 5\nfriction = 0.8\n";
    text += "release_s = 0.85\n";
    for (const char* finger : {"thumb", "index"}) {
        const std::string name = finger;
        text += "[[finger]]\nname = \"" + name + "\"\nshape = { finger = \"" + name + "\" }\n";
        text += "follow = \"" + name + "\"\n";
    }
    std::ofstream(file) << text;
    const Scene plain = load_scene(file);
    const PinchFit p =
        fit_pinch(*plain.recordings[right], {0, 1}, {&plain.spec.fingers[0].mesh, &plain.spec.fingers[1].mesh}, 0.005);
    EXPECT_NEAR(p.gap, 0.0078, 0.0005);
    auto scene = std::make_unique<Scene>(load_scene(file));
    scene->tracker_pose.position = -1.0 * p.place;
    for (std::size_t k : {0u, 1u}) scene->finger_motions[k].fit = p.fit[k];
    Simulation simulation = make_simulation(std::move(*scene), 2);
    run(simulation, false, {});
    const BodySummary ball = summarise_bodies(simulation)[0];
    EXPECT_GT(ball.held_s, 0.6);
    EXPECT_GT(ball.dropped_at_s, 1.5) << "the hand opened";
    EXPECT_LT(ball.slip_mm, 4);  // most of it while the hand opens
    ASSERT_EQ(ball.grips.size(), 2u);
    for (const GripSummary& g : ball.grips) EXPECT_GT(g.reserve.weakest_N, 0.04) << g.finger;
    EXPECT_GT(ball.converged_share, 0.99);
}

/// A finger's `fit` moves it in the frame of the tracked one.
TEST(Tracking, FitPlacesTheModelInTheTrackedFinger) {
    const std::string file = testing::source_dir() + "/scenes/recorded_grasp.toml";
    const Scene plain = load_scene(file), fitted = load_scene(file, {"finger.thumb.fit.rotation_deg=[90, 0, 0]",
                                                                     "finger.thumb.fit.position_mm=[0, 0, 5]"});
    for (double t : {0.0, 0.7, 1.5}) {
        const Pose<double> a = tracked_pose(plain, 0, t).pose, b = tracked_pose(fitted, 0, t).pose;
        const Mat3<double> R = rotation_matrix(a.rotation), S = rotation_matrix(b.rotation);
        EXPECT_LT(norm(b.position - a.position - 0.005 * R.column(2)), 1e-12);
        EXPECT_LT(norm(S.column(0) - R.column(0)), 1e-12);
        EXPECT_LT(norm(S.column(1) - R.column(2)), 1e-12);
        EXPECT_LT(norm(tracked_pose(plain, 1, t).pose.position - tracked_pose(fitted, 1, t).pose.position), 1e-15);
    }
}

}  // namespace
}  // namespace palpate
