#pragma once
// From a plain description of a scene to a World that holds just what the description names.

#include <optional>
#include <string>
#include <vector>

#include "engine/world.h"

namespace palpate {

struct FingerSpec {
    std::string name;
    TetMesh mesh;  ///< finger frame [m], with bone and pad nodes
    Material material = Material::corotational;
    double young_modulus = 30e3;  ///< [Pa]
    double poisson_ratio = 0.45;
    double density = 1050;  ///< [kg/m^3]
    bool has_limits = false;
    double limit_low = 0.6, limit_high = 1.4;
    int element_low_power = 2;  ///< where patches are limited, elements are by this power of their own lower limit
    /// Of elements that differ, [element]; empty where all are alike.
    std::vector<double> element_young, element_low, element_high;
    /// What elements that hold several layers have more along the skin than across it [Pa], and the skin's normal
    /// there, [element]; empty where none does (laminate.h).
    std::vector<double> element_membrane;
    std::vector<Point> element_normal;
    double skin_modulus = 0;  ///< Young's modulus across the outermost layer [Pa]: what the gap beside a contact opens
                              ///< against; 0: young_modulus
    bool single_precision = false;
    Coupling coupling;                      ///< its tracker is set by build_world
    std::optional<PoseFilter> filter = {};  ///< of its tracked pose
    Pose<double> start = Pose<double>::identity();
};

struct ObjectSpec {
    std::string name;
    Shape shape;
    Pose<double> pose = Pose<double>::identity();
    double friction = 0;
    double stiffness = 0;                   ///< pressure on skin per depth [Pa/m]; 0: rigid
    std::optional<RigidBody> body = {};     ///< present: forces move it
    std::optional<FingerSpec> tissue = {};  ///< present: it is soft; mesh in the object's frame, bone nodes are fixed
    std::shared_ptr<const DistanceMesh> mesh = nullptr;  ///< of a shape of kind mesh
};

struct ThimbleSpec {
    int finger = 0;  ///< index into fingers
    DeviceModel model;
    MatchingMethod method = MatchingMethod::constrained;
    MatchingSettings settings;
    double period = 0.020;    ///< [s]
    bool force_mode = false;  ///< position mode otherwise
};

/// Bounds of what a finger is made of and what draws it, by the names above and in Coupling; validate() and readers of
/// files hold to these alone.
namespace finger_bounds {
inline constexpr Range young_modulus{1, 1e9}, poisson_ratio{0, 0.4999}, density{1, 1e5};
inline constexpr Range limit_low{0.011, 0.9999}, limit_high{1.0001, 99.99};
}  // namespace finger_bounds
namespace coupling_bounds {
inline constexpr Range stiffness{1, 1e8}, angular_stiffness{1e-6, 1e6}, damping{0, 1e6}, angular_damping{0, 1e4};
inline constexpr Range max_force{1e-3, 1e5}, max_torque{1e-6, 1e4}, max_speed{1e-3, 1e3}, max_spin{1e-2, 1e4};
}  // namespace coupling_bounds
inline constexpr Range friction_bounds{0, 100};

struct SceneSpec {
    SolverSettings solver;
    std::vector<FingerSpec> fingers;
    std::vector<ObjectSpec> objects;
    Vec3<double> gravity{0, 0, -9.81};  ///< on bodies [m/s^2]
    std::vector<PairFriction> pair_frictions;
    std::vector<FingerFriction> finger_frictions;
    std::vector<ThimbleSpec> thimbles;
    bool fingers_touch = false;  ///< each other
    double skin_friction = 0.5;  ///< Coulomb coefficient of one finger against another
    /// Sentences about what is wrong; empty if nothing is.
    std::vector<std::string> validate() const;
};

/// Fingers with the same connectivity and precision share chunks, as wide as the processor allows;
/// thimbles are built only for fingers that can touch something. Throws std::invalid_argument with the
/// sentences of validate().
World build_world(const SceneSpec& spec);

/// Samples of soft objects along every edge of their faces: more than fingers have, where bodies may touch them.
int tissue_refinement(const SceneSpec& spec);

/// A force matcher for one of a scene's fingers.
ForceMatcher build_force_matcher(const FingerSpec& finger, const DeviceModel& model, const MatchingSettings& settings);

/// A soft object's nodes [m], world frame.
std::vector<Point> soft_positions(const World& world, const SoftObject& object);

/// One finger's nodes [m], world frame.
std::vector<Point> finger_positions(const World& world, EntityId finger);
/// One finger's reactions [N], world frame: at each bone node the force with which the bone holds the skin (inertia
/// included); zero at free nodes.
std::vector<Vec3<double>> bone_reactions(const World& world, EntityId finger);
/// One finger's bone pose, world frame.
Pose<double> bone_pose(const World& world, EntityId finger);
/// What the last solve reported for one finger.
const SkinStatus& skin_status(const World& world, EntityId finger);
/// Bytes held by all chunks.
std::size_t skin_memory_bytes(const World& world);

}  // namespace palpate
