// Recordings of Leap Motion: with and without bases of bones, with empty cells.

#include <fstream>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "scenes/trackers/hand_recording.h"
#include "tests/comma_locale.h"
#include "tests/support.h"

namespace palpate {
namespace {

using Rows = std::vector<std::vector<std::string>>;

std::string text_of(const Rows& rows) {
    std::string out;
    for (const auto& row : rows)
        for (std::size_t i = 0; i < row.size(); ++i) out += row[i] + (i + 1 < row.size() ? "," : "\n");
    return out;
}

/// A hand whose palm looks down; every finger bent by `bend` [rad] at each joint towards the palm, all along -z. A left
/// hand is its mirror image. Lengths in mm, y up.
Rows bent_hand(const std::string& hand, double bend, const std::vector<std::string>& more_columns = {}) {
    const double side = hand == "right" ? 1 : -1;
    Rows rows{{"t_us", "hand", "palm_x", "palm_y", "palm_z"}};
    for (const char* f : {"thumb", "index", "middle", "ring", "pinky"})
        for (const char* j : {"mcp", "pip", "dip", "tip"})
            for (const char* a : {"_x", "_y", "_z"}) rows[0].push_back(std::string(f) + "_" + j + a);
    for (const auto& c : more_columns) rows[0].push_back(c);
    for (int k = 0; k < 3; ++k) {
        std::vector<std::string> row{std::to_string(10000 * k), hand, "0", "0", "0"};
        for (int f = 0; f < 5; ++f) {
            double angle = 0, p[3] = {side * 20.0 * (f - 2), 0, -40};
            for (int j = 0; j < 4; ++j) {
                for (double x : p) row.push_back(std::to_string(x));
                p[1] -= 20 * std::sin(angle), p[2] -= 20 * std::cos(angle);
                angle += bend;
            }
        }
        for (std::size_t c = 0; c < more_columns.size(); ++c) row.emplace_back();
        rows.push_back(row);
    }
    return rows;
}

HandRecording read(const std::string& text, const std::string& hand) {
    testing::ScratchFolder scratch;
    write_file(scratch.path / "hand.csv", text);
    return read_hand_recording(scratch.path / "hand.csv", hand);
}

TEST(LeapCsv, WithoutBasesNailsFaceAwayFromThePalmAsFingersBend) {
    for (const std::string hand : {"right", "left"})
        for (double bend : {0.1, 0.5, 1.0}) {
            const HandRecording r = read(text_of(bent_hand(hand, bend)), hand);
            ASSERT_EQ(r.frames.size(), 3u);
            EXPECT_FALSE(r.note.empty());
            for (int f = 1; f < 5; ++f) {  // the thumb of this hand is no thumb
                const Mat3<double> R = rotation_matrix(r.frames[2].finger[std::size_t(f)].rotation);
                // World: z up from y up. The last bone is turned by twice the bend about the side.
                const Vec3<double> distal = R.column(0), dorsal = R.column(2);
                EXPECT_NEAR(distal.z, -std::sin(2 * bend), 1e-6);
                EXPECT_NEAR(dorsal.z, std::cos(2 * bend), 1e-6) << hand << " " << bend << " finger " << f;
                EXPECT_NEAR(dorsal.x, 0, 1e-6);
            }
        }
    const HandRecording straight = read(text_of(bent_hand("right", 0)), "right");
    EXPECT_GT(rotation_matrix(straight.frames[0].finger[1].rotation).column(2).z, 0.99);
}

TEST(LeapCsv, MayBeginWithAByteOrderMark) {
    const std::string text = text_of(bent_hand("right", 0.3));
    const testing::CommaLocale comma;
    EXPECT_EQ(read("\xef\xbb\xbf" + text, "right").frames[1].finger[1].position.x,
              read(text, "right").frames[1].finger[1].position.x);
}

TEST(LeapCsv, AnEmptyLastCellIsACell) {
    EXPECT_EQ(read(text_of(bent_hand("right", 0.3, {"remark"})), "right").frames.size(), 3u);
    Rows empty = bent_hand("right", 0.3);
    empty[2].back() = "";
    try {
        read(text_of(empty), "right");
        FAIL() << "an empty coordinate is no number";
    } catch (const InputError& error) {
        EXPECT_NE(error.messages[0].find(":3: expected a number"), std::string::npos) << error.messages[0];
    }
    Rows truncated = bent_hand("right", 0.3);
    truncated[3].pop_back();
    EXPECT_THROW(read(text_of(truncated), "right"), InputError);
    Rows without = bent_hand("right", 0.3);
    without[0][2] = "elsewhere";
    EXPECT_THROW(read(text_of(without), "right"), InputError) << "no palm, and no bases";
}

TEST(LeapCsv, BasesFromJointsAreThoseOfARealRecording) {
    PALPATE_NEED_SHARED_DATA(data);
    std::ifstream in(data / "tracking/pinch_57fps.csv");
    Rows rows;
    for (std::string line, cell; std::getline(in, line);) {
        rows.emplace_back();
        std::istringstream cells(line);
        while (std::getline(cells, cell, ',')) rows.back().push_back(cell);
    }
    for (const bool with_palm : {true, false}) {
        Rows some(rows.size());
        for (std::size_t c = 0; c < rows[0].size(); ++c) {
            const std::string& name = rows[0][c];
            const bool drop = name.find("basis") != std::string::npos ||
                              (!with_palm && (name.starts_with("palmN") || name.starts_with("dir_")));
            for (std::size_t r = 0; r < rows.size() && !drop; ++r) some[r].push_back(rows[r][c]);
        }
        const HandRecording whole = read_hand_recording(data / "tracking/pinch_57fps.csv", "right");
        const HandRecording joints = read(text_of(some), "right");
        EXPECT_TRUE(whole.note.empty());
        ASSERT_EQ(joints.frames.size(), whole.frames.size());
        double worst = 0;
        for (std::size_t k = 0; k < whole.frames.size(); ++k)
            for (std::size_t f = 0; f < 5; ++f) {
                const auto a = rotation_matrix(whole.frames[k].finger[f].rotation).column(2);
                const auto b = rotation_matrix(joints.frames[k].finger[f].rotation).column(2);
                worst = std::max(worst, std::acos(std::clamp(dot(a, b), -1.0, 1.0)));
            }
        EXPECT_LT(worst * 57.3, 1.0) << "degrees, " << (with_palm ? "with" : "without") << " the palm";
        std::printf("bases from joints: at most %.2f degrees off\n", worst * 57.3);
    }
}

}  // namespace
}  // namespace palpate
