// Hands from an OpenXR runtime: a fake one (openxr_runtime.cpp), behind the real loader.

#include <dlfcn.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/trackers/hand_source.h"
#include "tests/scenes/openxr_runtime.h"
#include "tests/support.h"

namespace palpate {
namespace {

using testing::eventually;
using testing::OpenXrControl;

const std::string runtime = PALPATE_OPENXR_RUNTIME;  // of the build
constexpr int left = 0, right = 1;

class OpenXr : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!dlopen("libopenxr_loader.so.1", RTLD_NOW))
            GTEST_SKIP() << "the OpenXR loader is not installed (apt install libopenxr-dev)";
        manifest_ = (folder_.path / "runtime.json").string();
        std::ofstream(manifest_) << nlohmann::json{{"file_format_version", "1.0.0"},
                                                   {"runtime", {{"library_path", runtime}}}};
        setenv("XR_RUNTIME_JSON", manifest_.c_str(), 1);
        unsetenv("FAKE_OPENXR");
        void* library = dlopen(runtime.c_str(), RTLD_NOW);  // stays open: its control outlives instances
        ASSERT_TRUE(library) << dlerror();
        const auto find = reinterpret_cast<OpenXrControl* (*)()>(dlsym(library, "openxr_runtime_control"));
        control_ = find();
        control_->absent = control_->lost = control_->ends = control_->misused = false;
        control_->located = control_->made = 0;
        std::ifstream in(testing::source_dir() + "/scenes/pinch.jsonl");
        for (std::string line; std::getline(in, line);)
            if (const auto json = nlohmann::json::parse(line); json.contains("joints") && json["joints"].is_array())
                frames_.push_back(json);
        show(left, 0), show(right, 0);
        control_->active[left] = false;
    }
    /// The hand is as in a recorded frame.
    void show(int hand, std::size_t frame) {
        const std::lock_guard lock(control_->mutex);
        for (std::size_t k = 0; k < 26; ++k) {
            control_->known[hand][k] = true;
            for (std::size_t i = 0; i < 7; ++i)
                control_->joints[hand][k][i] = frames_[frame]["joints"][k][i].get<float>();
        }
        control_->active[hand] = true;
    }
    /// The same frame as a message to udp:PORT, in the floats that a runtime gives.
    HandFrame by_message(std::size_t frame) {
        HandFrame seen;
        HandMailbox taking([&](int, const HandFrame& f) { seen = f; });
        nlohmann::json joints = nlohmann::json::array();
        for (const auto& joint : frames_[frame]["joints"]) {
            nlohmann::json row = nlohmann::json::array();
            for (std::size_t i = 0; i < 7; ++i) row.push_back(double(joint[i].get<float>()));
            joints.push_back(row);
        }
        const std::string text = nlohmann::json{{"hand", "right"}, {"joints", joints}}.dump();
        take_joints(taking, text.data(), text.size());
        EXPECT_EQ(0, taking.counts().malformed) << taking.counts().last_problem;
        return seen;
    }
    static std::string problem() {
        try {
            LiveHands live("openxr");
            return "it opened";
        } catch (const InputError& error) { return error.what(); }
    }
    testing::ScratchFolder folder_;
    std::string manifest_;
    OpenXrControl* control_ = nullptr;
    std::vector<nlohmann::json> frames_;
};

TEST_F(OpenXr, HandsAreThoseOfTheUdpSource) {
    LiveHands live("openxr");
    EXPECT_EQ("the OpenXR runtime of a test", live.source->about());
    for (std::size_t frame : {0u, 40u, 90u}) {
        show(right, frame);
        const HandFrame expected = by_message(frame);
        ASSERT_TRUE(expected.valid);
        const int before = control_->located;
        ASSERT_TRUE(eventually([&] { return control_->located > before + 4; }));
        for (int f = 0; f < 5; ++f) {
            const TrackerPose::Sample now = live.mailbox.newest(right, f);
            ASSERT_TRUE(now.valid);
            const Pose<double>& wanted = expected.finger[std::size_t(f)];
            EXPECT_EQ(wanted.position.x, now.pose.position.x);
            EXPECT_EQ(wanted.position.y, now.pose.position.y);
            EXPECT_EQ(wanted.position.z, now.pose.position.z);
            EXPECT_EQ(wanted.rotation.w, now.pose.rotation.w);
            EXPECT_EQ(wanted.rotation.y, now.pose.rotation.y);
        }
        EXPECT_FALSE(live.mailbox.newest(left, 1).valid);
    }
    show(left, 10);
    EXPECT_TRUE(eventually([&] { return live.mailbox.newest(left, 1).valid; }));
    EXPECT_FALSE(control_->misused);
    EXPECT_TRUE(live.mailbox.timing().has_clock);
}

TEST_F(OpenXr, JointsThatAreNotKnownAreNoHand) {
    LiveHands live("openxr");
    const auto seen = [&] { return live.mailbox.newest(right, 1).valid; };
    ASSERT_TRUE(eventually(seen));
    const auto set = [&](int joint, bool known, float x) {
        const std::lock_guard lock(control_->mutex);
        control_->known[right][joint] = known;
        control_->joints[right][joint][0] = x;
    };
    const float x = control_->joints[right][9][0];
    set(9, false, x);  // distal joint of the index finger
    EXPECT_TRUE(eventually([&] { return !seen(); }));
    set(9, true, NAN);
    const int before = control_->located;
    ASSERT_TRUE(eventually([&] { return control_->located > before + 4; }));
    EXPECT_FALSE(seen());
    set(9, true, x);
    EXPECT_TRUE(eventually(seen));
    set(0, false, 0);  // the palm is not needed
    const int later = control_->located;
    ASSERT_TRUE(eventually([&] { return control_->located > later + 4; }));
    EXPECT_TRUE(seen());
}

TEST_F(OpenXr, ARuntimeThatEndsIsFoundAgain) {
    LiveHands live("openxr");
    const auto seen = [&] { return live.mailbox.newest(right, 1).valid; };
    ASSERT_TRUE(eventually(seen));
    control_->absent = true;
    control_->lost = true;
    ASSERT_TRUE(eventually([&] { return !seen(); }));
    EXPECT_EQ(1, live.mailbox.counts().malformed);
    EXPECT_EQ("the OpenXR runtime is gone: XR_ERROR_INSTANCE_LOST", live.mailbox.counts().last_problem);
    EXPECT_EQ(0, control_->instances);
    control_->absent = false;
    EXPECT_TRUE(eventually(seen));
    EXPECT_EQ(2, live.mailbox.counts().connections);
    control_->ends = true;
    EXPECT_TRUE(eventually([&] { return live.mailbox.counts().connections == 3; }));
    EXPECT_EQ("the OpenXR runtime is gone: it is about to end", live.mailbox.counts().last_problem);
    EXPECT_EQ(1, control_->instances);
}

TEST_F(OpenXr, WhatIsMissingIsSaid) {
    const std::pair<const char*, const char*> cases[] = {
        {"hands", "tracker openxr: the OpenXR runtime has no XR_EXT_hand_tracking: it tracks no hands"},
        {"headless",
         "tracker openxr: the OpenXR runtime has no XR_MND_headless: it gives hands only to programs that draw, which "
         "palpate does not; such a program can send them to udp:PORT"},
        {"headset",
         "tracker openxr: of a test has no headset (XR_ERROR_FORM_FACTOR_UNAVAILABLE): connect it, or start the "
         "service anew"},
        {"tracking", "tracker openxr: the headset \"Simulated\" tracks no hands, or they are switched off"}};
    // In processes of their own: the loader asks a runtime once what it can.
    for (const auto& [lacking, said] : cases) {
        const testing::Outcome ran =
            testing::shell("FAKE_OPENXR=" + std::string(lacking) + " XR_RUNTIME_JSON=" + manifest_ + " " +
                           testing::program_path() + " tracker openxr --seconds 1");
        EXPECT_EQ(2, ran.code);
        EXPECT_NE(std::string::npos, ran.out.find(said)) << ran.out;
    }
    control_->absent = true;
    EXPECT_EQ("tracker openxr: the OpenXR runtime gives no instance (XR_ERROR_RUNTIME_UNAVAILABLE): is it running?",
              problem());
}

TEST_F(OpenXr, TheProgramSaysThatThereIsNone) {
    const std::string program = testing::program_path(), out = " --out " + (folder_.path / "out").string();
    const std::string scene = testing::source_dir() + "/scenes/recorded_hand.toml";
    const std::string said =
        "tracker openxr: no OpenXR runtime answers (XR_ERROR_RUNTIME_UNAVAILABLE): start one, and make it the system's "
        "(/etc/xdg/openxr/1/active_runtime.json) or name its file in XR_RUNTIME_JSON";
    for (const std::string& command :
         {program + " tracker openxr --seconds 1", program + " run " + scene + " --tracker openxr" + out}) {
        const testing::Outcome ran = testing::shell("XR_RUNTIME_JSON=/nowhere.json " + command);
        EXPECT_EQ(2, ran.code) << ran.out;
        EXPECT_NE(std::string::npos, ran.out.find(said)) << ran.out;
    }
    const testing::Outcome ran =
        testing::shell("XR_RUNTIME_JSON=" + manifest_ + " " + program + " tracker openxr --seconds 1");
    EXPECT_EQ(0, ran.code) << ran.out;
    EXPECT_NE(std::string::npos, ran.out.find("the OpenXR runtime of a test")) << ran.out;
}

}  // namespace
}  // namespace palpate
