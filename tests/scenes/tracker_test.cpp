// A live hand over UDP: what is understood, and what hostile or broken senders can do.

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>

#include "meshes/input_error.h"
#include "scenes/scene.h"
#include "scenes/trackers/udp_hand.h"
#include "tests/support.h"

namespace palpate {
namespace {

void send(int port, const std::string& text) {
    const int s = socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(std::uint16_t(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    sendto(s, text.data(), text.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
    close(s);
}

template <class Condition>
bool eventually(Condition condition) {
    for (int i = 0; i < 500; ++i, usleep(10'000))
        if (condition()) return true;
    return false;
}

/// Lines with joints of the repository's recording: one datagram each.
std::vector<std::string> recorded_frames() {
    std::ifstream in(PALPATE_SOURCE_DIR "/scenes/pinch.jsonl");
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
    const HandRecording recording = read_hand_recording(PALPATE_SOURCE_DIR "/scenes/pinch.jsonl", "right");
    const auto lines = recorded_frames();
    ASSERT_EQ(lines.size(), recording.frames.size());
    UdpHand hand(0, "right", false);
    EXPECT_FALSE(hand.newest(1).valid);
    for (std::size_t k : {std::size_t(0), lines.size() / 2}) {
        const auto before = hand.counts().frames;
        send(hand.port(), lines[k]);
        ASSERT_TRUE(eventually([&] { return hand.counts().frames > before; }));
        for (int f = 0; f < 5; ++f) {
            const TrackerPose::Sample s = hand.newest(f);
            EXPECT_TRUE(s.valid);
            EXPECT_EQ(s.pose.position.x, recording.frames[k].finger[f].position.x);
            EXPECT_EQ(s.pose.rotation.w, recording.frames[k].finger[f].rotation.w);
        }
    }
    EXPECT_TRUE(eventually([&] { return !hand.newest(1).valid; }));  // silence: the hand is gone
}

TEST(UdpHand, BadMessagesAreCountedAndChangeNothing) {
    const std::string good = recorded_frames()[0];
    UdpHand hand(0, "right", false);
    send(hand.port(), good);
    ASSERT_TRUE(eventually([&] { return hand.counts().frames == 1; }));
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
    for (const auto& text : bad) send(hand.port(), text);
    std::string nan = good;
    nan.replace(nan.find("[["), 2, "[[NaN,");
    send(hand.port(), nan);
    // An empty datagram is no message, and one of no hand of ours is passed over.
    EXPECT_TRUE(eventually([&] { return hand.counts().malformed >= std::int64_t(bad.size()) - 1; }));
    EXPECT_EQ(hand.counts().frames, 1);
    EXPECT_FALSE(hand.counts().last_problem.empty());
    EXPECT_THROW(UdpHand(hand.port(), "right", false), InputError);
}

/// A finger's `fit` moves it in the frame of the tracked one.
TEST(Tracking, FitPlacesTheModelInTheTrackedFinger) {
    const std::string file = PALPATE_SOURCE_DIR "/scenes/recorded_grasp.toml";
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
