#pragma once
// Every component, and the World. The step (step.cpp) lists the systems that read and write them.

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "devices/loop/command.h"
#include "devices/matching/matching.h"
#include "engine/bodies/body_solve.h"
#include "engine/bodies/finger_pairs.h"
#include "engine/bodies/pose_filter.h"
#include "engine/bodies/soft_objects.h"
#include "engine/ecs/table.h"
#include "engine/skin/chunks/chunk.h"
#include "engine/thimbles/force_matching.h"

namespace palpate {

/// Tracker: pose of one tracked finger. `incoming` is written from outside before a step, the rest by
/// read_trackers.
struct TrackerPose {
    struct Sample {
        Pose<double> pose = Pose<double>::identity();  ///< world
        double time = -1;                              ///< [s]
        bool valid = false;
    };
    Sample incoming;
    Sample newest;                                     ///< newest valid sample
    Pose<double> previous = Pose<double>::identity();  ///< at the step before
    std::int64_t accepted = 0;
    std::int64_t not_finite = 0;  ///< rejected: NaN, infinite or zero quaternion
    std::int64_t backward = 0;    ///< rejected: older than the newest
    std::int64_t missing = 0;     ///< steps without a valid sample
    double silent = 0;            ///< since the last accepted sample, or the beginning [s]
};

/// Finger: viscoelastic virtual coupling between tracked pose and bone, and the bone's inertia.
struct Coupling {
    EntityId tracker;
    double stiffness = 2000;                         ///< [N/m]
    double damping = 4;                              ///< [N s/m]
    double angular_stiffness = 2;                    ///< [N m/rad]
    double angular_damping = 0.004;                  ///< [N m s/rad]
    double max_force = 50;                           ///< the target is pulled no farther than this force [N]
    double max_torque = 4;                           ///< nor turned by more than this torque [N m]
    double max_speed = 5;                            ///< of the target; faster ones are teleports [m/s]
    double max_spin = 50;                            ///< of the target, likewise [rad/s]
    double bone_mass = 0.004;                        ///< [kg]
    double bone_inertia = 4e-7;                      ///< about any axis [kg m^2]
    Pose<double> target = Pose<double>::identity();  ///< written by couple
    Pose<double> last_target = Pose<double>::identity();
    bool started = false;
    std::int64_t slowed = 0;  ///< steps in which the target was slowed down: teleports
    double force_N = 0;       ///< written by extract_contact
};

/// Finger: where its skin lives. Written at load.
struct Skin {
    std::string name;
    bool single_precision = false;  ///< in chunks.floats rather than chunks.doubles
    int chunk = 0, lane = 0;
    TetMesh mesh;  ///< rest shape in the finger frame, for output
    Pose<double> start = Pose<double>::identity();
};

/// Contact of one finger with one object, or with another finger.
struct ObjectContact {
    int object = -1;                ///< row; -1: none
    int finger = -1;                ///< row; -1: none
    Vec3<double> force{0, 0, 0};    ///< on the skin, world frame [N]
    double normal_force = 0;        ///< sum over samples [N]
    double friction_force = 0;      ///< sum of the samples' friction [N]
    double friction_available = 0;  ///< sum of the samples' Coulomb limits [N]
    double slip = 0;                ///< way over the object in this step, mean by normal force [m]; over a finger: of
                                    ///< both over the plane between them
};

/// Finger: its contact this step, written by extract_contact. Arrays are [sample], nodes alone: forces of samples
/// between nodes count to the nodes around them.
struct ContactSurface {
    RestArray<double> area;                        ///< share of the rest surface [m^2], written at load
    Pose<double> bone = Pose<double>::identity();  ///< finger frame -> world
    std::vector<Vec3<double>> position;            ///< of the nodes, where forces act, finger frame [m]
    std::vector<Vec3<double>> bulge;               ///< from there to the skin that touches [m]; empty: it is flat
    std::vector<Vec3<double>> force;               ///< on the skin, world frame [N]
    std::vector<Vec3<double>> pressing;            ///< what of it is along the objects' normals, world frame [N]
    std::vector<char> touches;                     ///< 1 in C_O, 0 in N_O
    std::vector<char> bears;                       ///< 1: some force may be other than zero
    std::vector<double> gap;                       ///< of samples beside those that touch, to what is nearest [m]
    RestArray<std::array<int, 3>> faces;           ///< of the pad, three samples each, outward; written at load
    RestArray<std::array<int, 3>> rim_faces;       ///< with some nodes in the pad, nodes of the mesh; written at load
    RestArray<std::array<int, 3>> back_faces;      ///< with none in it, the same
    double longest_edge = 0;                       ///< of those faces at rest [m], written at load
    double modulus = 0;                            ///< E / (1 - nu^2) of the tissue [Pa], written at load
    bool rough = false;                            ///< forces are far from balanced: not to be rendered
    std::int64_t rough_steps = 0;
    Vec3<double> total{0, 0, 0};  ///< sum of forces [N]
    double normal_force = 0;      ///< sum of normal forces [N]
    double touching_area = 0;     ///< of the skin in contact, as it is deformed (contact_edge.h) [m^2]
    int touching = 0;
    std::vector<ObjectContact> objects;  ///< those near it, in the order of their rows; then the fingers near it
};

/// Normal force on a sample over its area: friction presses nothing [Pa].
inline double pressure_on(const ContactSurface& contact, std::size_t sample) {
    return contact.area[sample] > 0 ? norm(contact.pressing[sample]) / contact.area[sample] : 0;
}

/// Object: shape, pose and friction. Fixed, moved by a script before the step, or by its body in the step.
struct VirtualObject {
    std::string name;
    Shape shape;
    Pose<double> pose = Pose<double>::identity();      ///< at the end of this step
    Pose<double> previous = Pose<double>::identity();  ///< at the end of the last one
    double friction = 0;   ///< Coulomb coefficient against skin; against another object the geometric mean of both
    double stiffness = 0;  ///< pressure on skin per depth, where the object gives way [Pa/m]; 0: rigid
    int body = -1;         ///< row of its body; -1: fixed or scripted
    int soft = -1;         ///< row among soft objects; -1: not of tissue
    int held_body = -1;    ///< row of a body that stays where it is until its release; -1: none
    std::shared_ptr<const DistanceMesh> mesh = nullptr;  ///< of a shape of kind mesh
};

/// An object of tissue: a skin, what holds it, and its contact, as fingers have them (soft_objects.h). Its shape among
/// the objects is that at rest, and touches nothing.
struct SoftObject {
    int object = -1;  ///< row
    Skin skin;
    Coupling hold;  ///< of its fixed nodes to the object's pose
    ContactSurface surface;
    std::vector<std::array<int, 3>> faces;     ///< of its surface that can be touched, outward
    int entered_by = -1;                       ///< row of the first object that came in between its samples; -1: none
    double entered_at = 0;                     ///< then [s]
    std::int64_t entered_steps = 0;            ///< steps in which any was in there
    std::vector<Vec3<double>> nodes;           ///< scratch: [node] world [m]
    Vec3<double> low{0, 0, 0}, high{0, 0, 0};  ///< scratch: bounds of its faces, world [m]
};
struct SoftObjects {
    std::vector<SoftObject> all;
    std::vector<SoftPair> pairs;  ///< every finger with every soft object
    SoftWork work;
};

/// Thimble: contact surface matching for one finger. Result written by match_devices.
struct Matching {
    EntityId finger;
    DeviceModel model;
    MatchingMethod method = MatchingMethod::constrained;
    MatchingSettings settings;
    double period = 0.020;              ///< [s]
    double next = 0;                    ///< simulation time of the next solve [s]
    bool fresh = false;                 ///< solved in this step
    double solved_at = 0;               ///< simulation time of the last solve [s]
    double since_last = 0;              ///< time from the solve before to the last; before the first, a period [s]
    std::vector<MatchingPoint> points;  ///< scratch, [sample]
    MatchingResult result, geometric;   ///< geometric: what force matching started from
    bool force_mode = false;            ///< the platform is pushed with the contact's force, not to its place
    double force_N = 0;                 ///< in force mode: commanded along the platform's normal
    Coordinates q, torque;              ///< in force mode: what is sent [rad], [N m]
    std::int64_t solves = 0, constrained_solves = 0, failures = 0, contact_solves = 0;
    double beside_N = 0;             ///< what presses on the skin from where the platform cannot, in the last solve
    std::int64_t beside_solves = 0;  ///< solves with contact of that kind
};

/// Thimble: the mailbox of its device loop. Where its finger's tracker falls silent, the thimble must not go on
/// pressing what the finger touched last: it is led to its rest configuration, and back once the tracker is heard
/// again.
struct DeviceLink {
    ThimbleMailbox* mailbox = nullptr;  ///< owned by the loop
    double silence = 2;                 ///< of the tracker that is waited for [s]
    double retreat_time = 2;            ///< for the way to rest [s]
    double return_time = 1;             ///< for the way back [s]
    double retreat = 0;                 ///< share of the way to rest, 0 to 1; written by publish
    std::int64_t retreats = 0;          ///< times it was led to rest
};

/// By when a step is to end. Its iterations are cut short for that (step_cut.h), with room for the systems that follow
/// them, as long as they took in the step before.
struct StepDeadline {
    double limit = 0;        ///< wall time of a step [s]; 0: none
    std::vector<int> given;  ///< `cuts` of a step that is repeated, whatever the clock says; empty: it is none
    std::vector<int> cuts;   ///< [chunk, doubles and floats, then bodies] pass at which the last step's iteration was
                             ///< cut short; -1: it was not; empty without deadline
    bool cut_short = false;  ///< any of them was
};

/// Wall time of the systems of one step [s]; the fields follow step.cpp one to one. Where bodies are solved beside
/// fingers that touch none, solve_bodies is what they take beyond solve_skin.
struct StepProfile {
    double read_trackers = 0, couple = 0, begin_bodies = 0, detect_contacts = 0, choose_detail = 0, gather_lanes = 0,
           solve_skin = 0, solve_bodies = 0, extract_contact = 0, match_devices = 0, publish = 0, end_objects = 0;
    double total() const;
};
/// The systems by name, in the order of the step.
inline constexpr std::pair<const char*, double StepProfile::*> step_systems[] = {
    {"read_trackers", &StepProfile::read_trackers},
    {"couple", &StepProfile::couple},
    {"begin_bodies", &StepProfile::begin_bodies},
    {"detect_contacts", &StepProfile::detect_contacts},
    {"choose_detail", &StepProfile::choose_detail},
    {"gather_lanes", &StepProfile::gather_lanes},
    {"solve_skin", &StepProfile::solve_skin},
    {"solve_bodies", &StepProfile::solve_bodies},
    {"extract_contact", &StepProfile::extract_contact},
    {"match_devices", &StepProfile::match_devices},
    {"publish", &StepProfile::publish},
    {"end_objects", &StepProfile::end_objects}};
inline double StepProfile::total() const {
    double sum = 0;
    for (const auto& [name, seconds] : step_systems) sum += this->*seconds;
    return sum;
}

/// Coulomb coefficient of two objects against each other, where it is not the geometric mean of theirs.
struct PairFriction {
    int a = 0, b = 0;  ///< rows of objects
    double friction = 0;
};

/// Coulomb coefficient of one finger against one object, where it is not the object's.
struct FingerFriction {
    int finger = 0, object = 0;  ///< rows
    double friction = 0;
};

struct World {
    SolverSettings solver;
    double time = 0;  ///< simulated [s]
    std::int64_t step = 0;

    EntityPool fingers, objects, trackers, thimbles;
    Table<TrackerPose> tracker_poses;        ///< per tracker
    Table<PoseFilter> pose_filters;          ///< per tracker that has one
    Table<Coupling> couplings;               ///< per finger
    Table<Skin> skins;                       ///< per finger, same rows as couplings and contact_surfaces
    Table<ContactSurface> contact_surfaces;  ///< per finger
    Table<VirtualObject> shapes;             ///< per object
    Table<RigidBody> bodies;                 ///< per object that forces move
    Vec3<double> gravity{0, 0, -9.81};       ///< on bodies [m/s^2]
    std::vector<PairFriction> pair_frictions;
    BodySolve body_solve;
    FingerPairs finger_pairs;
    SoftObjects soft;
    Table<Matching> matchings;           ///< per thimble
    Table<ForceMatcher> force_matchers;  ///< per thimble that matches forces
    Table<DeviceLink> device_links;      ///< per thimble with a device
    SkinChunks chunks;

    StepDeadline deadline;
    StepProfile profile;
    double sampled_at = 0;  ///< when the step's tracked poses were read [s of a steady clock]; 0: simulated time
    std::int64_t contact_growths = 0;  ///< times that a finger needed memory for more objects near it than ever before,
                                       ///< or fingers near each other did
};

}  // namespace palpate
