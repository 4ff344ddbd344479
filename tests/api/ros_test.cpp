// What a node of ROS 2 says and hears, with stand-ins that have the fields of its messages.

#include "scenes/api/ros/convert.h"

#include <gtest/gtest.h>

#include <vector>

namespace {

struct Stamp {
    std::int32_t sec = 0;
    std::uint32_t nanosec = 0;
};
struct Header {
    Stamp stamp;
    std::string frame_id;
};
struct Vector3 {
    double x = 0, y = 0, z = 0;
};
struct Quaternion {
    double x = 0, y = 0, z = 0, w = 1;
};
struct WrenchStamped {
    Header header;
    struct {
        Vector3 force, torque;
    } wrench;
};
struct TransformStamped {
    Header header;
    std::string child_frame_id;
    struct {
        Vector3 translation;
        Quaternion rotation;
    } transform;
};
struct JointState {
    Header header;
    std::vector<std::string> name;
    std::vector<double> position;
};
struct Pose {
    Vector3 position;
    Quaternion orientation;
};

TEST(Ros, TimeIsWholeSecondsAndTheRest) {
    Stamp s;
    palpate::ros::to_stamp(1.25, s);
    EXPECT_EQ(1, s.sec);
    EXPECT_EQ(250000000u, s.nanosec);
    palpate::ros::to_stamp(2 - 1e-12, s);
    EXPECT_EQ(2, s.sec);
    EXPECT_EQ(0u, s.nanosec);
}

TEST(Ros, AWrenchIsInTheFrameOfItsFinger) {
    // A real finger that presses the plane below it; its bone turned by 90 degrees about z sees the same force.
    PalpateWorld world = 0;
    const char* scene =
        "dt_ms = 2\n[[object]]\nkind = \"plane\"\nfriction = 0.5\n[[finger]]\nname = \"index\"\nelements = 120\n"
        "device = { kind = \"chinello-3rrs\" }\ntrack = [ { t_s = 0, position_mm = [0, 0, 6.5], rotation_deg = [0, 0, "
        "90] } ]\n";
    ASSERT_EQ(PALPATE_OK, palpate_load_text(scene, nullptr, &world)) << palpate_last_error();
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 50));
    const double slid[7] = {0.0005, 0, 0.0065, std::sqrt(0.5), 0, 0, std::sqrt(0.5)};
    ASSERT_EQ(PALPATE_OK, palpate_set_finger_pose(world, 0, slid));
    ASSERT_EQ(PALPATE_OK, palpate_step(world, 10));
    PalpateFingerState state{};
    state.size = sizeof state;
    ASSERT_EQ(PALPATE_OK, palpate_get_finger(world, 0, &state));
    WrenchStamped w;
    palpate::ros::to_wrench(state, "index", w);
    EXPECT_EQ("index", w.header.frame_id);
    EXPECT_GT(w.wrench.force.z, 0.1);
    EXPECT_NEAR(state.force[2], w.wrench.force.z, 1e-3 * state.force[2]);
    // Friction holds it back along the world's -x: that is the finger's +y.
    ASSERT_LT(state.force[0], -0.01);
    EXPECT_NEAR(-state.force[0], w.wrench.force.y, 0.05 * -state.force[0]);
    TransformStamped t;
    palpate::ros::to_transform(state.bone_pose, state.time, "index", t);
    EXPECT_EQ("world", t.header.frame_id);
    EXPECT_NEAR(0.0065, t.transform.translation.z, 1e-3);
    EXPECT_NEAR(std::sqrt(0.5), t.transform.rotation.z, 1e-2);
    PalpateThimbleState thimble{};
    thimble.size = sizeof thimble;
    ASSERT_EQ(PALPATE_OK, palpate_get_thimble(world, 0, &thimble));
    JointState joints;
    palpate::ros::add_joints(thimble, "index", joints);
    ASSERT_EQ((std::vector<std::string>{"index_joint_1", "index_joint_2", "index_joint_3"}), joints.name);
    EXPECT_EQ(thimble.reached[1], joints.position[1]);
    palpate_destroy(world);
}

TEST(Ros, PosesOfTopicsAreMadeUnits) {
    double pose[7];
    Pose in{{1, 2, 3}, {0, 0, 2, 0}};
    ASSERT_TRUE(palpate::ros::from_pose(in, pose));
    EXPECT_EQ(3, pose[2]);
    EXPECT_EQ(0, pose[3]);
    EXPECT_EQ(1, pose[6]);
    in.orientation = {0, 0, 0, 0};
    EXPECT_FALSE(palpate::ros::from_pose(in, pose));
    in = {{NAN, 0, 0}, {0, 0, 0, 1}};
    EXPECT_FALSE(palpate::ros::from_pose(in, pose));
}

TEST(Ros, NamesOfTopics) {
    EXPECT_EQ("left_index", palpate::ros::topic_name("left index"));
    EXPECT_EQ("_finger_0", palpate::ros::topic_name("0finger 0"));
    EXPECT_EQ("_", palpate::ros::topic_name(""));
}

}  // namespace
