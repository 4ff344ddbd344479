// A scene as a node of ROS 2, in real time: palpate_bridge --ros-args -p scene:=hand
//
//   palpate/FINGER/wrench         geometry_msgs/WrenchStamped   what it feels, in its bone's frame
//   palpate/joint_states          sensor_msgs/JointState        of simulated thimbles
//   /tf                           fingers and objects in "world"
//   palpate/FINGER/tracked_pose   geometry_msgs/PoseStamped     taken: moves it, instead of its track
//   palpate/OBJECT/pose           geometry_msgs/PoseStamped     taken: moves an object that no forces move

#include <geometry_msgs/msg/pose_stamped.hpp>
#include <geometry_msgs/msg/wrench_stamped.hpp>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/joint_state.hpp>
#include <stdexcept>
#include <tf2_msgs/msg/tf_message.hpp>
#include <vector>

#include "scenes/api/ros/convert.h"

namespace {

using palpate::ros::topic_name;

void check(std::int32_t code) {
    if (code != PALPATE_OK) throw std::runtime_error(palpate_last_error());
}

class Bridge : public rclcpp::Node {
  public:
    Bridge() : Node("palpate") {
        const std::string scene = declare_parameter<std::string>("scene", "press");
        check(palpate_load(scene.c_str(), nullptr, &world_));
        PalpateWorldInfo info{};
        info.size = sizeof info;
        check(palpate_get_info(world_, &info));
        for (std::int32_t i = 0; i < info.finger_count; ++i) {
            fingers_.push_back(topic_name(text(PALPATE_TEXT_FINGER, i)));
            const std::string topic = "palpate/" + fingers_.back();
            wrenches_.push_back(create_publisher<geometry_msgs::msg::WrenchStamped>(topic + "/wrench", 10));
            listen(topic + "/tracked_pose",
                   [this, i](const double* pose) { palpate_set_finger_pose(world_, i, pose); });
        }
        for (std::int32_t i = 0; i < info.object_count; ++i) {
            objects_.push_back(topic_name(text(PALPATE_TEXT_OBJECT, i)));
            listen("palpate/" + objects_.back() + "/pose",
                   [this, i](const double* pose) { palpate_set_object_pose(world_, i, pose); });
        }
        thimbles_ = info.thimble_count;
        joints_ = create_publisher<sensor_msgs::msg::JointState>("palpate/joint_states", 10);
        frames_ = create_publisher<tf2_msgs::msg::TFMessage>("/tf", 10);
        timer_ = create_wall_timer(std::chrono::duration<double>(info.dt), [this] { step(); });
    }
    ~Bridge() override { palpate_destroy(world_); }

  private:
    std::string text(std::int32_t what, std::int32_t index) {
        char name[256] = "";
        check(palpate_get_text(world_, what, index, name, sizeof name, nullptr));
        return name;
    }
    template <class Set>
    void listen(const std::string& topic, Set set) {
        using Message = geometry_msgs::msg::PoseStamped;
        poses_.push_back(create_subscription<Message>(topic, 1, [set](const Message& message) {
            double pose[7];
            if (palpate::ros::from_pose(message.pose, pose)) set(pose);
        }));
    }
    void step() {
        check(palpate_step(world_, 1));
        tf2_msgs::msg::TFMessage frames;
        double time = 0;
        for (std::size_t i = 0; i < fingers_.size(); ++i) {
            PalpateFingerState state{};
            state.size = sizeof state;
            check(palpate_get_finger(world_, std::int32_t(i), &state));
            time = state.time;
            geometry_msgs::msg::WrenchStamped wrench;
            palpate::ros::to_wrench(state, fingers_[i], wrench);
            wrenches_[i]->publish(wrench);
            frames.transforms.emplace_back();
            palpate::ros::to_transform(state.bone_pose, time, fingers_[i], frames.transforms.back());
        }
        for (std::size_t i = 0; i < objects_.size(); ++i) {
            PalpateObjectState state{};
            state.size = sizeof state;
            check(palpate_get_object(world_, std::int32_t(i), &state));
            frames.transforms.emplace_back();
            palpate::ros::to_transform(state.pose, time, objects_[i], frames.transforms.back());
        }
        frames_->publish(frames);
        sensor_msgs::msg::JointState joints;
        palpate::ros::to_stamp(time, joints.header.stamp);
        for (std::int32_t i = 0; i < thimbles_; ++i) {
            PalpateThimbleState state{};
            state.size = sizeof state;
            check(palpate_get_thimble(world_, i, &state));
            palpate::ros::add_joints(state, fingers_[std::size_t(state.finger)], joints);
        }
        if (thimbles_ > 0) joints_->publish(joints);
    }

    PalpateWorld world_ = 0;
    std::int32_t thimbles_ = 0;
    std::vector<std::string> fingers_, objects_;
    std::vector<rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr> wrenches_;
    std::vector<rclcpp::SubscriptionBase::SharedPtr> poses_;
    rclcpp::Publisher<sensor_msgs::msg::JointState>::SharedPtr joints_;
    rclcpp::Publisher<tf2_msgs::msg::TFMessage>::SharedPtr frames_;
    rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace

int main(int argc, char** argv) {
    rclcpp::init(argc, argv);
    try {
        rclcpp::spin(std::make_shared<Bridge>());
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 2;
    }
    rclcpp::shutdown();
    return 0;
}
