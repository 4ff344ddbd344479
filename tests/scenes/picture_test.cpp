// Pictures: no torn faces, a hand that ends where its fingertips begin, progress lines.

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <map>

#include "engine/contact/shape.h"
#include "meshes/input_error.h"
#include "scenes/picture/rest_hand.h"
#include "scenes/picture/still.h"
#include "scenes/recording/video.h"
#include "tests/support.h"

namespace palpate {
namespace {

using Eigen::Vector3d;

using testing::scenes;

/// Whether a ray meets a triangle, and how far away.
bool meets(const Vector3d& from, const Vector3d& along, const Vector3d& a, const Vector3d& b, const Vector3d& c,
           double& t) {
    const Vector3d u = b - a, v = c - a, p = along.cross(v);
    const double det = u.dot(p);
    if (std::abs(det) < 1e-18) return false;
    const Vector3d s = from - a, q = s.cross(u);
    const double wu = s.dot(p) / det, wv = along.dot(q) / det;
    t = v.dot(q) / det;
    return wu >= 0 && wv >= 0 && wu + wv <= 1 && t > 0;
}

/// The mug is seen where a ray meets it before anything opaque, and nowhere else: no face is torn, none is missing.
TEST(Picture, TheMugIsSeenWhereRaysMeetIt) {
    Simulation s = make_simulation(load_scene(scenes + "hold_mug.toml"), 2);
    const VirtualObject* mug = nullptr;
    for (const VirtualObject& o : s.world.shapes)
        if (o.mesh) mug = &o;
    ASSERT_TRUE(mug);
    const Triangles t = object_triangles(s.world, *mug, {0.5f, 0.5f, 0.5f});
    const Vector3d middle(mug->pose.position.x, mug->pose.position.y, mug->pose.position.z);
    Camera camera;
    camera.target = middle, camera.eye = middle + Vector3d(0.25, -0.22, 0.12);
    Raster raster(camera, 120, 90, {1, 1, 1});
    raster.layer(t, 7, 1.0, {});
    int seen = 0, differ = 0, number = 0;
    for (int y = 0; y < 90; ++y)
        for (int x = 0; x < 120; ++x) {
            if (!testing::is_tried(number++, 4)) continue;
            const auto [from, along] = raster.view().ray(x + 0.5, y + 0.5);
            bool hit = false;
            double distance = 0;
            for (const auto& f : t.faces)
                hit = hit ||
                      meets(from, along, t.vertices[std::size_t(f[0])].position, t.vertices[std::size_t(f[1])].position,
                            t.vertices[std::size_t(f[2])].position, distance);
            seen += hit;
            differ += hit != (raster.layer_id(x, y) == 7);
        }
    EXPECT_GT(seen, 250);
    EXPECT_LE(differ, seen / 100) << "of " << seen << " pixels of the mug";
}

/// Of the picture that a run leaves: the mug is where rays of its view meet it before fingers and floor.
TEST(Picture, OfTheMugIsWhatRaysOfItsViewMeet) {
    Simulation s = make_simulation(load_scene(scenes + "hold_mug.toml"), 2);
    PictureSettings settings;
    settings.width = 160, settings.height = 120, settings.samples = 1;
    settings.hand = settings.thimbles = settings.pads = false;
    Painter painter(s, settings);
    painter.paint(s);
    const Raster& raster = painter.raster();
    std::vector<Triangles> mug, opaque;
    int id = -1, layers = 0;
    double floor = 1e9;
    for (const VirtualObject& o : s.world.shapes) {
        if (o.shape.kind == ShapeKind::plane) {
            floor = o.pose.position.z;
            continue;
        }
        if (o.mesh) id = layers, mug.push_back(object_triangles(s.world, o, {}));
        ++layers;
    }
    ASSERT_EQ(layers, 1) << "a second object would have to be met, too";
    for (const EntityId finger : s.fingers) opaque.push_back(finger_triangles(s.world, finger, 1));
    auto nearest = [](const std::vector<Triangles>& all, const Vector3d& from, const Vector3d& along) {
        double least = HUGE_VAL, distance = 0;
        for (const Triangles& t : all)
            for (const auto& f : t.faces)
                if (meets(from, along, t.vertices[std::size_t(f[0])].position, t.vertices[std::size_t(f[1])].position,
                          t.vertices[std::size_t(f[2])].position, distance))
                    least = std::min(least, distance);
        return least;
    };
    int seen = 0, differ = 0;
    for (int y = 0; y < settings.height; ++y)
        for (int x = 0; x < settings.width; ++x) {
            const auto [from, along] = raster.view().ray(x + 0.5, y + 0.5);
            double others = along.z() < 0 ? (floor - from.z()) / along.z() : HUGE_VAL;
            const double to_mug = nearest(mug, from, along);
            if (std::isfinite(to_mug)) others = std::min(others, nearest(opaque, from, along));
            const bool hit = to_mug < others;
            seen += hit;
            differ += hit != (raster.layer_id(x, y) == id);
        }
    EXPECT_GT(seen, 800);
    EXPECT_LE(differ, seen / 100) << "of " << seen << " pixels of the mug";
}

/// However small the picture: every name is whole, above the pads, and none covers another.
TEST(Picture, NamesAreWhole) {
    int number = 0;
    for (const char* name : {"hand.toml", "two_hands.toml", "recorded_hand.toml"}) {
        if (!testing::is_tried(number++, 3)) continue;
        Simulation s = make_simulation(load_scene(scenes + name), 2);
        for (int k = 0; k < 60; ++k) advance(s);
        for (const auto& [width, height] : {std::pair{460, 380}, {900, 620}, {1600, 900}}) {
            PictureSettings settings;
            settings.width = width, settings.height = height, settings.samples = 1;
            Painter painter(s, settings);
            painter.paint(s);
            const auto& names = painter.names();
            ASSERT_EQ(names.size(), s.fingers.size());
            for (std::size_t k = 0; k < names.size(); ++k) {
                const auto [x, y, w, h] = names[k];
                EXPECT_TRUE(x >= 0 && y >= 0 && x + w <= width && y + h <= height - std::min(200, height / 3))
                    << name << " at " << width << ": name " << k << " at " << x << ", " << y << " is cut";
                for (std::size_t j = 0; j < k; ++j)
                    EXPECT_FALSE(x < names[j][0] + names[j][2] && names[j][0] < x + w &&
                                 y < names[j][1] + names[j][3] && names[j][1] < y + h)
                        << name << " at " << width << ": names " << j << " and " << k << " cover each other";
            }
        }
    }
}

/// Last joints are where the simulated bones begin, whatever the hand, and bones keep about their lengths.
TEST(Picture, AHandEndsWhereItsFingertipsBegin) {
    for (const char* name : {"hand.toml", "two_hands.toml", "press.toml", "pinch.toml", "recorded_grasp.toml"}) {
        Simulation s = make_simulation(load_scene(scenes + name), 2);
        for (int k = 0; k < 20; ++k) advance(s);
        const std::vector<HandParts> hands = hands_of(s.scene);
        std::size_t fingers = 0;
        for (const HandParts& parts : hands) {
            HandPoser poser(s, parts);
            const HandBones& bones = poser.pose(s);
            for (const auto& bone : bones) ASSERT_TRUE(bone.matrix().allFinite()) << name;
            EXPECT_LT(bones[0].linear().determinant() * (parts.left ? -1 : 1), 1 + 1e-9);
            EXPECT_GT(bones[0].linear().determinant() * (parts.left ? -1 : 1), 1 - 1e-9) << "a hand of the other side";
            for (int f = 0; f < 5; ++f) {
                const int row = parts.finger[std::size_t(f)];
                if (row < 0) continue;
                ++fingers;
                const EntityId finger = s.fingers[std::size_t(row)];
                const Pose<double> bone = bone_pose(s.world, finger);
                const double cut = bounds(s.world.skins.find(finger)->mesh.nodes)[0][0];
                const Vec3<double> begins = transform(bone, Vec3<double>{cut, 0, 0});
                const auto ends = bones[std::size_t(hand_bone(f, 1))] * rest_joint(f, 2);
                EXPECT_NEAR((ends - Vector3d(begins.x, begins.y, begins.z)).norm(), 0, 1e-9) << name;
            }
        }
        EXPECT_EQ(fingers, s.fingers.size()) << name;
    }
    Scene two = load_scene(scenes + "two_hands.toml");
    ASSERT_EQ(hands_of(two).size(), 2u);
    EXPECT_NE(hands_of(two)[0].left, hands_of(two)[1].left);
}

/// Each edge is between two faces, once to and once fro; around each vertex faces form one fan.
TEST(Picture, TheHandsSkinIsAClosedManifold) {
    const Surface& skin = hand_skin().surface;
    std::map<std::pair<int, int>, int> ways;
    std::map<int, std::map<int, int>> next;  // around a vertex: from one neighbour to the next
    for (const auto& t : skin.triangles)
        for (std::size_t k = 0; k < 3; ++k) {
            const int a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
            EXPECT_EQ((++ways[{a, b}]), 1) << "more than one face on a side of the edge " << a << " to " << b;
            next[a][b] = c;
        }
    for (const auto& [edge, count] : ways)
        ASSERT_TRUE(ways.contains({edge.second, edge.first})) << "a hole at " << edge.first << " to " << edge.second;
    for (const auto& [vertex, around] : next) {
        std::size_t met = 0;
        for (int at = around.begin()->first; met <= around.size();) {
            at = around.at(at), ++met;
            if (at == around.begin()->first) break;
        }
        EXPECT_EQ(met, around.size()) << "two sheets meet at vertex " << vertex;
    }
    EXPECT_EQ(next.size(), skin.vertices.size());
    EXPECT_EQ(int(next.size()) - int(ways.size() / 2) + int(skin.triangles.size()), 2) << "not the shape of a ball";
    EXPECT_GT(volume(skin), 2e-4);
    EXPECT_LT(volume(skin), 6e-4);  // of a real hand: about 0.4 l
}

/// Skin goes from finger to finger at their roots alone: farther out it would be a web that tears as they bend apart.
TEST(Picture, FingersAreSeparateBeyondTheirRoots) {
    const HandSkin& skin = hand_skin();
    double farthest = 0;
    for (const auto& t : skin.surface.triangles)
        for (const int a : t)
            for (const int b : t) {
                const int of_a = (skin.bones[std::size_t(a)][0] - 1) / 3,
                          of_b = (skin.bones[std::size_t(b)][0] - 1) / 3;
                if (of_a < 1 || of_b < 1 || of_a == of_b) continue;  // the palm is -1 / 3 = 0, as the thumb
                const RestFinger& f = rest_fingers()[std::size_t(of_a)];
                const Point& x = skin.surface.vertices[std::size_t(a)];
                farthest = std::max(farthest, (Vector3d(x[0], x[1], x[2]) - f.root).dot(f.along) / f.length[0]);
            }
    std::printf("from finger to finger up to %.2f of the first bone\n", farthest);
    EXPECT_LT(farthest, 0.5);
}

/// Bones of the drawn hand before the last go around a mug that its fingertips hold, not through its wall.
TEST(Picture, AHandStaysOutOfWhatItHolds) {
    Simulation s = make_simulation(load_scene(scenes + "hold_mug.toml"), 2);
    const HandParts parts = hands_of(s.scene)[0];
    HandPoser poser(s, parts);
    const VirtualObject* mug = nullptr;
    for (const VirtualObject& o : s.world.shapes)
        if (o.name == "mug") mug = &o;
    ASSERT_NE(mug, nullptr);
    double nearest = 1;
    for (const double time : {0.3, 0.6}) {
        if (time > 0.5 && !testing::is_tried(1, 2)) continue;
        while (s.world.time < time) advance(s);
        const HandBones bones = poser.pose(s);
        for (int f = 0; f < 5; ++f)
            for (int segment = f == 0 ? 1 : 0; segment < 2; ++segment)
                for (double share = 0; share <= 1; share += 0.125) {
                    const Vector3d x = bones[std::size_t(hand_bone(f, segment))] *
                                       ((1 - share) * rest_joint(f, segment) + share * rest_joint(f, segment + 1));
                    const Vec3<double> here{x.x(), x.y(), x.z()};
                    nearest = std::min(nearest, surface_point(mug->shape, mug->pose, here).distance);
                }
    }
    std::printf("bones come within %.1f mm of the mug's surface\n", 1e3 * nearest);
    EXPECT_GT(nearest, 0.002);  // of bones alone posed by the palm: 2.7 mm inside
}

/// Names in little room are shortened all in the same manner.
TEST(Picture, NamesOfPadsAreShortenedAlike) {
    const std::vector<std::string> names{"left ring", "left middle", "right thumb"};
    EXPECT_EQ(fitting_names(names, 88), names);
    EXPECT_EQ(fitting_names(names, 87), (std::vector<std::string>{"L ring", "L middle", "R thumb"}));
    EXPECT_EQ(fitting_names(names, 42), (std::vector<std::string>{"L rin", "L mid", "R thu"}));
}

TEST(Picture, ScalesEndAtRoundNumbers) {
    EXPECT_DOUBLE_EQ(round_up(0.28), 0.3);
    EXPECT_DOUBLE_EQ(round_up(20), 20);
    EXPECT_DOUBLE_EQ(round_up(210), 250);
    EXPECT_DOUBLE_EQ(round_up(710), 800);
    EXPECT_DOUBLE_EQ(round_up(930), 1000);
}

TEST(Picture, ScalesAreThoseOfTheSceneOrOfTheRunWithoutItsSpikes) {
    Simulation s = make_simulation(load_scene(scenes + "press.toml", {"duration_s=0.6"}), 1);
    PressureScales recorded(1000);
    std::vector<double> peaks;
    for (int k = 0; k < 120; ++k) {
        advance(s);
        recorded.record(s);
        const std::vector<double> p = node_pressures(s.world, s.fingers[0]);
        if (const double peak = *std::max_element(p.begin(), p.end()); peak > 1000) peaks.push_back(peak);
    }
    std::sort(peaks.begin(), peaks.end());
    ASSERT_GT(peaks.size(), 20u);
    const auto below = std::count_if(peaks.begin(), peaks.end(), [&](double p) { return p <= recorded.most(); });
    EXPECT_GE(double(below), 0.95 * double(peaks.size()) - 1);
    EXPECT_LT(recorded.most(), 1.34 * peaks.back());
    EXPECT_EQ(scales_of(s, &recorded).most, recorded.most());
    EXPECT_EQ(scales_of(s, &recorded).pads, std::vector<double>{recorded.most(0)});
    EXPECT_EQ(scales_of(s, nullptr).most, 0);
    s.scene.scale_pressure = 77e3;
    EXPECT_EQ(scales_of(s, &recorded).most, 77e3);
    EXPECT_EQ(scales_of(s, &recorded).pads, std::vector<double>{77e3});
}

TEST(Picture, FilmsAreOfKindsThatExist) {
    EXPECT_THROW(Video("film.avi", {}), InputError);
    testing::ScratchFolder scratch;
    const std::string film = (scratch.path / "film.gif").string(), out = (scratch.path / "out").string();
    const std::string command = testing::program_path() + " run " + scenes +
                                "press.toml --duration 0.1 --quiet --no-picture --out " + out + " --video " + film;
    ASSERT_EQ(std::system(("PATH=" + scratch.path.string() + " " + command).c_str()), 0);  // no ffmpeg there
    int pictures = 0;
    for (const auto& entry : std::filesystem::directory_iterator(scratch.path / "film_frames"))
        pictures += entry.path().extension() == ".png";
    EXPECT_EQ(pictures, 3);
    EXPECT_FALSE(std::filesystem::exists(film));
    // Whom steps must not keep waiting has a film of the recording.
    const testing::Outcome armed = testing::shell(command + " --arm");
    EXPECT_EQ(armed.code, 2);
    EXPECT_NE(armed.out.find("palpate replay run.palpate --video"), std::string::npos) << armed.out;
    const std::string recording = (scratch.path / "run.palpate").string(),
                      again = (scratch.path / "again.gif").string();
    const std::string plain = command.substr(0, command.find(" --video"));
    ASSERT_EQ(std::system((plain + " --record " + recording).c_str()), 0);
    ASSERT_EQ(std::system(("PATH=" + scratch.path.string() + " " + testing::program_path() + " replay " + recording +
                           " --video " + again + " > /dev/null")
                              .c_str()),
              0);
    EXPECT_TRUE(std::filesystem::exists(scratch.path / "again_frames" / "frame_00002.png"));
    // What goes wrong with a film is said, and the results are there.
    const std::string broken = (scratch.path / "broken").string();
    std::filesystem::create_directory(broken);
    std::ofstream(broken + "/ffmpeg") << "#!/bin/sh\nexit 1\n";
    std::filesystem::permissions(broken + "/ffmpeg", std::filesystem::perms::owner_all);
    std::filesystem::remove_all(out);
    const testing::Outcome failed = testing::shell("PATH=" + broken + ":$PATH " + command);
    EXPECT_EQ(failed.code, 2) << failed.out;
    EXPECT_NE(failed.out.find("ffmpeg"), std::string::npos) << failed.out;
    EXPECT_TRUE(std::filesystem::exists(out + "/summary.json"));
    if (std::system("command -v ffmpeg > /dev/null 2>&1") != 0) GTEST_SKIP() << "no ffmpeg";
    ASSERT_EQ(std::system(command.c_str()), 0);
    EXPECT_GT(std::filesystem::file_size(film), 5000u);
    for (const auto& [ending, mark] : {std::pair{".webm", "webm"}, {".mp4", "ftyp"}}) {
        const std::string other = (scratch.path / "film").string() + ending;
        ASSERT_EQ(std::system((plain + " --video " + other).c_str()), 0) << ending;
        EXPECT_GT(std::filesystem::file_size(other), 2000u) << ending;
        std::ifstream in(other, std::ios::binary);
        std::string head(64, ' ');
        in.read(head.data(), 64);
        EXPECT_NE(head.find(mark), std::string::npos) << ending;
    }
}

/// The paper's figures, by one command from what comes with the program.
TEST(Picture, OfThePaperAreMadeByOneCommand) {
    testing::ScratchFolder scratch;
    const std::string out = (scratch.path / "figures").string();
    const std::string gallery =
        "cd " + testing::source_dir() + " && " + testing::program_path() + " gallery --paper --out " + out;
    EXPECT_EQ(testing::shell(gallery + " pinch").code, 2);
    const testing::Outcome made = testing::shell(gallery);
    ASSERT_EQ(made.code, 0) << made.out;
    for (const auto& [name, columns] : {std::pair{"paper-fig1.png", 3}, {"paper-fig5.png", 3}, {"paper-fig6.png", 4}}) {
        std::ifstream in(out + "/" + name, std::ios::binary);
        std::string head(24, ' ');
        in.read(head.data(), 24);
        EXPECT_EQ(head.substr(1, 3), "PNG") << name;
        const int width = int(std::uint8_t(head[18])) << 8 | std::uint8_t(head[19]);
        EXPECT_EQ(width, 300 * columns) << name;
        EXPECT_NE(made.out.find(name), std::string::npos);
    }
}

}  // namespace
}  // namespace palpate
