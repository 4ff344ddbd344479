// Hands whose rotations contradict their positions: the mistake is named, wherever they come from.

#include "scenes/trackers/bone_axes.h"

#include <Eigen/Geometry>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "meshes/input_error.h"
#include "scenes/load/scene.h"
#include "scenes/trackers/hand_doubts.h"
#include "tests/support.h"

namespace palpate {
namespace {

/// x, y, z, qx, qy, qz, qw
using Joint = std::array<double, 7>;

Joint turned_by(const Joint& j, double degrees) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(degrees / 57.29577951308232, Eigen::Vector3d::UnitX()));
    const Eigen::Quaterniond q = Eigen::Quaterniond(j[6], j[3], j[4], j[5]) * turn;
    return {j[0], j[1], j[2], q.x(), q.y(), q.z(), q.w()};
}

struct Mistake {
    const char* said;
    std::function<Joint(const Joint&)> make;
};

const std::vector<Mistake>& mistakes() {
    static const std::vector<Mistake> all{
        {"with w first they agree", [](const Joint& j) { return Joint{j[0], j[1], j[2], j[6], j[3], j[4], j[5]}; }},
        {"conjugated they agree", [](const Joint& j) { return Joint{j[0], j[1], j[2], -j[3], -j[4], -j[5], j[6]}; }},
        {"mirrored they agree", [](const Joint& j) { return Joint{j[0], j[1], -j[2], -j[3], -j[4], j[5], j[6]}; }},
        {"all rotations are none", [](const Joint& j) { return Joint{j[0], j[1], j[2], 0, 0, 0, 1}; }},
        {"with +y of a bone to its tip they agree", [](const Joint& j) { return turned_by(j, -90); }},
        {"neither w first", [](const Joint& j) { return turned_by(j, 60); }},
    };
    return all;
}

/// The lines of the repository's recording, with every joint changed.
std::vector<std::string> changed_lines(const std::function<Joint(const Joint&)>& change) {
    std::ifstream in(testing::source_dir() + "/scenes/pinch.jsonl");
    std::vector<std::string> lines;
    for (std::string line; std::getline(in, line); lines.push_back(line)) {
        auto json = nlohmann::json::parse(line);
        if (!json["joints"].is_array()) continue;
        for (auto& joint : json["joints"]) joint = change(joint.get<Joint>());
        line = json.dump();
    }
    return lines;
}

std::filesystem::path written(const testing::ScratchFolder& folder, const std::vector<std::string>& lines) {
    const auto path = folder.path / "hand.jsonl";
    std::ofstream out(path);
    for (const std::string& line : lines) out << line << "\n";
    return path;
}

Scene followed(const std::filesystem::path& recording) {
    return load_scene(testing::source_dir() + "/scenes/recorded_hand.toml",
                      {"recording.file=\"" + recording.string() + "\""});
}

TEST(BoneAxes, AHandThatIsWellIsNotDoubted) {
    const BoneTally bones = bones_of(read_hand_recording(testing::source_dir() + "/scenes/pinch.jsonl", "right"));
    EXPECT_EQ(bones.median(BoneReading::meant), 0);
    EXPECT_EQ(bone_problem(bones), "");
    if (testing::shared_data().empty()) return;
    const BoneTally real = bones_of(read_hand_recording(testing::shared_data() / "tracking/pinch_57fps.csv", "right"));
    EXPECT_GT(real.frames(), 50);
    EXPECT_LT(real.median(BoneReading::meant), 5);
}

TEST(BoneAxes, RecordingsThatCannotBeRightAreRefusedAndTheMistakeIsNamed) {
    const testing::ScratchFolder folder;
    for (const Mistake& m : mistakes()) {
        const auto file = written(folder, changed_lines(m.make));
        try {
            followed(file);
            ADD_FAILURE() << "it was taken: " << m.said;
        } catch (const InputError& error) {
            ASSERT_EQ(error.messages.size(), 1u) << "once, and not once a finger";
            EXPECT_NE(error.messages[0].find("hand.jsonl: rotations contradict positions"), std::string::npos)
                << error.messages[0];
            EXPECT_NE(error.messages[0].find(m.said), std::string::npos) << error.messages[0];
        }
        // Who looks what is wrong is told, and not sent away.
        const testing::Outcome o = testing::palpate_program("tracker " + file.string());
        EXPECT_EQ(o.code, 0) << o.out;
        EXPECT_NE(o.out.find(m.said), std::string::npos) << o.out;
    }
}

TEST(BoneAxes, ATrackerThatIsOffIsDoubtedAndFollowed) {
    const testing::ScratchFolder folder;
    for (const double off : {10.0, 30.0}) {
        const auto file = written(folder, changed_lines([&](const Joint& j) { return turned_by(j, off); }));
        const Scene scene = followed(file);
        const auto said = std::count_if(scene.warnings.begin(), scene.warnings.end(), [](const std::string& w) {
            return w.find("rotations contradict positions") != std::string::npos;
        });
        EXPECT_EQ(said, off > doubtful_bones_deg) << off;
    }
}

/// Live hands move at once, and may become right: they are followed, and what is wrong is said.
TEST(BoneAxes, OfLiveHandsTheMistakeIsNamed) {
    const testing::ScratchFolder folder;
    for (const Mistake& m : mistakes()) {
        HandMailbox mailbox;
        DoubtTeller teller;
        for (const std::string& line : changed_lines(m.make)) {
            auto json = nlohmann::json::parse(line);
            if (!json["joints"].is_array()) continue;
            json["units"] = "m", json["up"] = "z";
            const std::string text = json.dump();
            take_joints(mailbox, text.data(), text.size());
        }
        EXPECT_GT(mailbox.counts().frames[1], 50);
        const std::vector<std::string> told = teller.news(mailbox);
        ASSERT_EQ(told.size(), 1u) << m.said;
        EXPECT_NE(told[0].find(m.said), std::string::npos) << told[0];
        EXPECT_TRUE(teller.news(mailbox).empty()) << "once";
    }
}

/// A recording of such a hand is not mended by being written: what was wrong can still be seen.
TEST(BoneAxes, ARecordedHandIsAsContradictoryAsItWas) {
    const testing::ScratchFolder folder;
    const auto wrong = read_hand_recording(written(folder, changed_lines(mistakes()[1].make)), "right");
    std::vector<std::string> lines{hand_header()};
    for (const HandFrame& f : wrong.frames) lines.push_back(hand_line(1, f));
    const auto copy = read_hand_recording(written(folder, lines), "right");
    EXPECT_NEAR(bones_of(copy).median(BoneReading::meant), bones_of(wrong).median(BoneReading::meant), 1);
}

}  // namespace
}  // namespace palpate
