// Trackers that send anything at all, while fingers touch something: nothing crashes, the memory stays, and no thimble
// moves faster than it may.

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "scenes/run/simulation.h"
#include "scenes/trackers/ultraleap.h"
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

TEST(LiveTracker, RandomMessagesOfAllSourcesAreHarmless) {
    const char* asked = std::getenv("PALPATE_TRACKER_MESSAGES");
    const int count = asked ? std::atoi(asked) : 10'000;
    Simulation s = make_simulation(load_scene(testing::source_dir() + "/scenes/recorded_hand.toml"), 1);
    Messages messages;
    messages.hand = s.scene.recordings[1];
    ASSERT_TRUE(messages.hand);
    follow_live(s, std::make_shared<LiveHands>("udp:0"));
    HandMailbox& mailbox = s.live->mailbox;
    std::int64_t last_id = -1;
    std::vector<Coordinates> q, velocity;
    for (const auto& loop : s.loops) q.push_back(loop->q), velocity.push_back(loop->velocity);
    double before = 0;
    int touching = 0;
    for (int k = 0; k < count; ++k) {
        const bool ultraleap = messages.below(2) == 0;
        const std::string text = messages.next(ultraleap);
        if (ultraleap)
            take_ultraleap(mailbox, text.data(), text.size(), last_id);
        else
            take_joints(mailbox, text.data(), text.size());
        if (k == count / 10) before = peak_memory(true);
        if (k % 20) continue;
        advance(s);
        for (Series& series : s.finger_series) series.values.clear();
        s.step_series.values.clear();
        for (const ContactSurface& c : s.world.contact_surfaces) touching += c.normal_force > 0.01;
        for (std::size_t t = 0; t < s.loops.size(); ++t) {
            const ThimbleLoop& loop = *s.loops[t];
            const double period = loop.settings.period;
            const SlewLimits& most = loop.settings.limits;
            ASSERT_TRUE(loop.q.allFinite());
            ASSERT_LE((loop.q - q[t]).cwiseAbs().maxCoeff(), most.velocity * period * (1 + 1e-9)) << "message " << k;
            ASSERT_LE((loop.velocity - velocity[t]).cwiseAbs().maxCoeff(), most.acceleration * period * (1 + 1e-9));
            q[t] = loop.q, velocity[t] = loop.velocity;
        }
    }
    EXPECT_GT(touching, count / 2000) << "the ball was hardly touched";
    EXPECT_LT(peak_memory(false) - before, 20) << "MB";
    const HandCounts counts = mailbox.counts();
    EXPECT_GT(counts.malformed, count / 10);
    EXPECT_GT(counts.frames[1], count / 10);
}

}  // namespace
}  // namespace palpate
