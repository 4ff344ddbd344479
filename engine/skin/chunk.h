#pragma once
// A chunk: the fingers of one archetype, one per SIMD lane. Arrays are [index][component][lane] of the
// scalar type T. Constant rest data, mutable state and scratch are separate types.

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <new>
#include <vector>

#include "engine/contact/shape.h"
#include "engine/skin/topology.h"

namespace palpate {

template <class T>
struct CacheAligned {
    using value_type = T;
    CacheAligned() = default;
    template <class U>
    CacheAligned(const CacheAligned<U>&) {}
    T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
    friend bool operator==(const CacheAligned&, const CacheAligned&) { return true; }
};
template <class T>
using LaneArray = std::vector<T, CacheAligned<T>>;

/// At most this many objects can touch one chunk in the same step; more are counted, nearest first.
inline constexpr int max_contact_slots = 4;
inline constexpr int bone_spring_count = 3;  ///< virtual coupling, its damper, bone inertia

/// Rest shape, material and limits. Written once, at load.
template <class T>
struct SkinRest {
    LaneArray<T> shape_gradients;        ///< [element][node 1..3][xyz] of the rest shape [1/m]
    LaneArray<T> volume;                 ///< [element] [m^3]
    LaneArray<T> mu, lambda;             ///< [element] Lame parameters [Pa]
    LaneArray<T> limit_low, limit_high;  ///< [element] bounds on principal stretches; empty without limits
    LaneArray<T> limit_penalty;          ///< [element] base penalty of the limits [Pa]; empty without limits
    LaneArray<T> mass;                   ///< [node] [kg]
    LaneArray<T> contact_penalty;        ///< [sample] [N/m]
    LaneArray<T> contact_area;           ///< [sample] share of the rest surface [m^2]; empty where objects are rigid
    LaneArray<T> object_friction;        ///< [object] Coulomb coefficients; empty where fingers do not differ in them
    LaneArray<T> tissue_stiffness;       ///< [1] 5 x Young's modulus x sample spacing: scale of Newton's damping [N/m]
    LaneArray<T>
        rounding_stiffness;  ///< [1] what rounding of positions meets: that, or more where hardly compressible [N/m]
    LaneArray<T> extent;     ///< [1] largest distance of a node from the bone's origin [m]
    LaneArray<T> rest_position;  ///< [node][xyz] in the bone frame [m]
};

/// What a step reads and writes. Positions are relative to an origin of each lane near its finger, with the axes of
/// the world: in single precision a place in the room is known to 15 nm only, which contact would feel as force.
template <class T>
struct SkinState {
    LaneArray<double> origin;            ///< [xyz] [m] world, on a grid (rebase_lane)
    LaneArray<T> position;               ///< [node][xyz] [m] from the origin
    LaneArray<T> velocity;               ///< [node][xyz] [m/s]
    LaneArray<T> bone;                   ///< [px py pz qw qx qy qz], position from the origin
    LaneArray<T> bone_velocity;          ///< [linear xyz, angular xyz] [m/s, rad/s]
    LaneArray<T> limit_multiplier;       ///< [element][3x3] Lambda [Pa]; empty without limits
    LaneArray<T> normal_multiplier;      ///< [slot][sample] [N]
    LaneArray<T> tangential_multiplier;  ///< [slot][sample][xyz] in the object's frame [N]; empty without friction
    LaneArray<T> friction_radius;        ///< [slot][sample] [N]; empty without friction
    LaneArray<T> friction_normal;  ///< [slot][sample][xyz] of the tangent plane, object's frame; empty without friction
    LaneArray<T> svd_guess;        ///< [element][3x3] V of the last step: saves Jacobi sweeps
    LaneArray<T> tangled_steps;    ///< [1] steps in a row of which each left the skin tangled (newton.h)
    LaneArray<T> penalty_scale;    ///< [2] of limits, of contacts: grow where their multipliers converge slowly
};

/// Work memory of a step; nothing in it outlives the step but the candidates, which hold its forces.
template <class T>
struct SkinScratch {
    LaneArray<T> start_position;  ///< [node][xyz] at the beginning of the step
    LaneArray<T> start_bone;      ///< [7]
    LaneArray<T> inertia_target;  ///< [node][xyz] x^ of implicit Euler
    LaneArray<T> bone_springs;    ///< [spring][linear k, angular k, target 7 from the origin]: written by `couple`
    LaneArray<T> slot_frame;      ///< [slot][end, start of the step][rotation 3x3, position from the origin 3]
    LaneArray<T> base_position;   ///< [node][xyz] last accepted iterate
    LaneArray<T> base_bone;       ///< [7]
    LaneArray<T> gradient;        ///< [node, bone][xyz]
    LaneArray<T> pending;    ///< [node][xyz] change of the limits' forces by a multiplier update; empty without limits
    LaneArray<T> direction;  ///< [node, bone][xyz] Newton step
    LaneArray<T> permuted;   ///< [unknown][xyz] right-hand side in elimination order
    LaneArray<T> blocks;     ///< [block][3x3]
    LaneArray<T> factor;     ///< [block][3x3] Cholesky factor, where lanes are fingers
    LaneArray<T> first_direction;       ///< [node, bone][xyz] Newton's own, before contacts were followed
    LaneArray<T> sample_gradient;       ///< [sample][xyz] contact's part of the gradient, bodies' apart
    LaneArray<T> sample_curvature;      ///< [sample][3x3] and of the matrix
    LaneArray<T> sample_residual;       ///< [sample][xyz]
    LaneArray<T> panels, panel_work;    ///< of the supernodal factor, for a finger alone in its chunk
    LaneArray<T> limit_candidate;       ///< [element][3x3] updated multipliers: the limits' stress
    LaneArray<T> normal_candidate;      ///< [slot][sample] normal force [N]
    LaneArray<T> tangential_candidate;  ///< [slot][sample][xyz]
    LaneArray<T>
        contact_normal;  ///< [slot][sample][xyz] at the last evaluation, object's frame; empty without friction
    LaneArray<T> svd;    ///< [element][3x3] V at the last evaluation
};

/// When the tissue of a lane is linearised: in steps whose number its period divides, which is a power of two, so that
/// lanes whose periods differ still do it in the same steps, whatever chunk they are in.
struct LinearisingPlan {
    int period = 2;       ///< [steps]; 1: too much moves
    bool tried = false;   ///< linearised in the last step
    bool linear = false;  ///< the last step began linear
};

/// Tissue linearised where it was in an earlier step, per lane (linear.h); all empty where that is not allowed.
template <class T>
struct LinearTissue {
    LaneArray<T> weight;       ///< [element] force error per squared change of the deformation gradient [N]
    LaneArray<T> frame;        ///< [3x3] rotation of the bone at the place of linearisation
    LaneArray<T> arm;          ///< [node][xyz] there, from the bone's position [m]
    LaneArray<T> force;        ///< [node][xyz] gradient of the tissue's energy there [N]
    LaneArray<T> blocks;       ///< [pair][3x3] and its Hessian [N/m]
    LaneArray<T> energy;       ///< [1] there [J]
    LaneArray<T> watched;      ///< [element] 1 where near a strain limit, else 0; empty without limits
    LaneArray<T> reach;        ///< [1] a change of the others' deformation gradients below this meets no limit
    LaneArray<T> bound;        ///< [1] force error allowed in this step [N]
    LaneArray<T> error;        ///< [1] force error at the last evaluation, estimated [N]
    LaneArray<T> moved;        ///< scratch: [node][xyz] from there, turned back with the bone; zero at bone nodes
    LaneArray<T> moved_force;  ///< scratch: [node][xyz] gradient, turned back
    std::vector<TissuePair> pairs;
    std::array<LinearisingPlan, 16> plan{};  ///< [lane]
    unsigned due_lanes = 0;                  ///< bit per lane to be linearised at the next evaluation
    unsigned fresh_lanes = 0;                ///< linearised at the last evaluation
    unsigned left_lanes = 0;                 ///< went on with tissue as it is at the last evaluation: another potential
    unsigned kept_lanes = 0;                 ///< lanes whose linearisation still holds
};

/// Elasticity of a chunk (isotropic.h).
enum class Material { corotational, saint_venant_kirchhoff, neo_hookean };

struct Sphere {
    Vec3<double> centre{0, 0, 0};
    double radius = 0;  ///< [m]
};

/// An object as one chunk sees it in one step.
struct ContactSlot {
    int object = -1;  ///< row of the object; -1 = empty
    Shape shape;
    Pose<double> pose;           ///< at the end of the step; of a body: as far as the solve has got
    Pose<double> start;          ///< at its beginning
    double friction = 0;         ///< Coulomb coefficient; where fingers differ in it, the largest
    double stiffness = 0;        ///< pressure per depth of an object that gives way [Pa/m]; 0: rigid
    int body = -1;               ///< row of the body that moves it; -1 = fixed or scripted
    Vec3<double> mass_centre{};  ///< of the body, in the object's frame [m]
    unsigned near_lanes = 0;     ///< bit per lane that may touch it in this step
};

/// One lane's part in an iteration that fingers share with bodies.
struct LaneReport {
    double energy = 0, residual = 0, pending = 0, violation = 0, penetration = 0, contact_force = 0, coupling_force = 0,
           limited = 0;   ///< as in Evaluation
    double rounding = 0;  ///< force that rounding of positions makes [N]
    double slope = 0;     ///< of the direction [J]
    double bad_pivots = 0;
    double surprise = 0;  ///< squared norm of what contact did beyond its linearisation [N^2]
    double exactness = 0, alpha = 0, damping = 0, last_excess = 1e300,
           last_depth = 1e300;  ///< orders, per lane: as in LaneProgress
};

/// What a chunk exchanges with the bodies it touches; all empty in scenes without bodies. Columns are the 6 motions of
/// a body: moved along xyz, turned about xyz through its centre of mass.
template <class T>
struct BodyExchange {
    std::array<LaneReport, 16> lanes;
    LaneArray<T> centre;          ///< [slot][xyz] centre of mass from the origin at the last evaluation
    LaneArray<T> slot_gradient;   ///< [slot][sample][xyz] contact's gradient
    LaneArray<T> slot_curvature;  ///< [slot][sample][3x3]
    LaneArray<T> columns;         ///< [slot][6][unknown][xyz] L^-1 times the coupling block of the Newton matrix
    LaneArray<T> body_gradient;   ///< [slot][6] gradient along the body's motions
    LaneArray<T> body_rhs;        ///< [slot][6] condensed right-hand side
    LaneArray<T> body_matrix;     ///< [slot][slot][6x6] condensed matrix (Schur complement)
    LaneArray<T> body_step;       ///< [slot][6] the bodies' part of the direction: written by the bodies' solve
};

/// What the solve reports for one finger.
struct SkinStatus {
    int newton_iterations = 0;
    int multiplier_updates = 0;
    int backtracks = 0;
    bool converged = false;
    bool reset = false;          ///< diverged, and was put back to rest on its target
    double residual_N = 0;       ///< norm of the force residual
    double limit_violation = 0;  ///< worst relative excess over a strain limit
    double penetration_m = 0;    ///< worst
    double contact_force_N = 0;  ///< sum of normal forces
    int limited_elements = 0;    ///< elements at a strain limit
};

/// Settings of the solve; each approximation has a name.
struct SolverSettings {
    double dt = 0.005;                   ///< [s]
    int newton_iterations = 200;         ///< most linear solves in one step
    double tolerance = 1e-7;             ///< force residual, relative to the forces acting
    double multiplier_tolerance = 1e-5;  ///< pending change of multipliers, relative to the forces acting
    double multiplier_gate = 0.1;        ///< update multipliers once the residual is below this share of the change
    int contact_iterations = 3;          ///< most linear solves that follow contacts along one Newton direction
    double contact_share = 0.3;          ///< follow while contact leaves more than this share of the residual
    double limit_tolerance = 1e-3;       ///< relative excess allowed over a strain limit
    double contact_tolerance = 2e-6;     ///< penetration allowed [m]
    int sample_refinement = 1;           ///< 1: contact is decided at nodes; n: at n times as many points along edges
    bool inertia = true;                 ///< false: static equilibrium
    double sleep_speed = 1e-6;           ///< a finger near no object, slower than this and with a still target, sleeps
                                         ///< [m/s]; 0 = never
    double detail_penetration = 0;       ///< samples between nodes count only where they would be deeper in an object
                                         ///< than this [m]; 0: always
    double detail_error = 0;      ///< tissue stays linear while this adds no larger a force error, relative to the
                                  ///< contact force; 0 = never
    double detail_tolerance = 0;  ///< skin near no object, off its rest shape by less than this, moves with its
                                  ///< bone as one [m]; 0 = never
    /// Sentences about what is wrong; empty if nothing is.
    std::vector<std::string> validate() const;
};

/// Whether strain limits bear anything, so that nothing is spent where they do not. False says nothing.
struct LimitActivity {
    bool unloaded = false;          ///< all multipliers of the state are zero
    bool candidates_clear = false;  ///< all updated multipliers in the scratch memory are zero
    bool met = true;                ///< some element was at a limit, or had a multiplier, in the last evaluation
};

template <class T>
struct SkinChunk {
    std::shared_ptr<const SkinTopology> topology;
    int width = 1;            ///< lanes: 1, 2, 4, 8 or 16
    unsigned used_lanes = 0;  ///< bit per lane that holds a finger
    Material material = Material::corotational;
    bool has_limits = false;
    bool has_friction = false;
    // Bits per lane (detail.cpp): what the step leaves out.
    unsigned asleep_lanes = 0;     ///< nothing is near, and nothing moves
    unsigned rigid_lanes = 0;      ///< nothing is near: the skin moves with its bone; its positions are not kept up
    unsigned unchanged_lanes = 0;  ///< asleep, and as they were when their contact was read last
    unsigned linear_lanes = 0;     ///< the tissue's forces are linear in the nodes' motion (linear.h)
    unsigned fine_lanes = ~0u;     ///< contact is decided between nodes, too, where the topology has such samples
    LimitActivity limits;
    std::array<double, 16> skin_mass{},
        skin_inertia{};                    ///< [lane] [kg], mean over axes through the bone's origin [kg m^2]
    std::array<int, 16> calm_steps{};      ///< [lane] steps in a row with nothing near
    std::array<int, 16> coarse_steps{};    ///< [lane] steps in a row in which samples between nodes made no difference
    std::array<Sphere, 16> rest_reach{};   ///< [lane] around its samples at rest, bone frame
    std::array<Sphere, 16> reach{};        ///< [lane] around its samples; kept while it sleeps
    std::array<T, 9 * 16> still_spring{};  ///< [9][lane] coupling spring when the lane fell asleep
    std::vector<int> finger;               ///< [lane] row of the finger; -1 where empty
    std::vector<SkinStatus> status;        ///< [lane]
    std::array<ContactSlot, max_contact_slots> slots;
    std::vector<Pose<double>>
        lane_poses;         ///< [lane] of the object in slot 0, where every lane sees another; else empty
    int slot_capacity = 0;  ///< slots with memory: no more than the scene has objects
    SkinRest<T> rest;
    SkinState<T> state;
    SkinScratch<T> scratch;
    BodyExchange<T> exchange;
    LinearTissue<T> linear;
};

/// What one finger brings to its lane.
struct SkinParameters {
    const TetMesh* mesh = nullptr;      ///< rest shape in the bone frame; same connectivity as the topology
    std::vector<double> young_modulus;  ///< [element] or one value [Pa]
    double poisson_ratio = 0.45;
    double density = 1050;  ///< [kg/m^3]
    bool has_limits = false;
    std::vector<double> limit_low, limit_high;  ///< [element] or one value
    double limit_penalty_factor = 100;          ///< penalty = factor x Young's modulus
    double contact_penalty_factor = 30;         ///< penalty = factor x Young's modulus x sample spacing
};

/// Allocates every array of a chunk: nothing is allocated later.
template <class T>
void allocate_chunk(SkinChunk<T>& chunk, std::shared_ptr<const SkinTopology> topology, int width, bool has_limits,
                    bool has_friction, int object_count, bool has_bodies = false);

/// Allocates what linear tissue needs.
template <class T>
void allocate_linear_tissue(SkinChunk<T>& chunk);

/// Writes one finger into a lane, at rest on the bone pose `bone`.
template <class T>
void set_lane(SkinChunk<T>& chunk, int lane, int finger, const SkinParameters& parameters, const Pose<double>& bone);

/// Gives every sample of every used lane its share of the rest surface: needed where objects give way.
template <class T>
void set_contact_areas(SkinChunk<T>& chunk, int lane, const TetMesh& mesh);

/// The slots that hold an object, in the order of the objects: sums over them do not depend on which came first, nor on
/// what else is near the chunk.
struct SlotOrder {
    std::array<int, max_contact_slots> slot;
    int count = 0;
    const int* begin() const { return slot.data(); }
    const int* end() const { return slot.data() + count; }
};
template <class T>
SlotOrder occupied_slots(const SkinChunk<T>& chunk);

/// Gives a lane its own coefficient of friction against an object, one of `objects`; the others keep theirs.
template <class T>
void set_lane_friction(SkinChunk<T>& chunk, int lane, int object, double friction, const std::vector<double>& objects);

/// Coulomb coefficient of one lane against the object of a slot.
template <class T>
double lane_friction(const SkinChunk<T>& c, int slot, int lane) {
    const ContactSlot& s = c.slots[slot];
    return c.rest.object_friction.empty()
               ? s.friction
               : double(c.rest.object_friction[std::size_t(s.object) * c.width + std::size_t(lane)]);
}

/// Writes where the slots' objects are, as each lane sees them: after a pose or an origin has changed.
template <class T>
void place_slots(SkinChunk<T>& chunk);

/// Bits of the lanes that the step solves.
template <class T>
unsigned active_lanes(const SkinChunk<T>& c) {
    return c.used_lanes & ~(c.asleep_lanes | c.rigid_lanes);
}

/// The lanes go on with tissue as it is.
template <class T>
void leave_linear_tissue(SkinChunk<T>& chunk, unsigned lanes);

/// Bits of the lanes that something is near to.
template <class T>
unsigned near_lanes(const SkinChunk<T>& c) {
    unsigned lanes = 0;
    for (const ContactSlot& s : c.slots)
        if (s.object >= 0) lanes |= s.near_lanes;
    return lanes;
}

/// Whether a lane's coupling target is that at which it fell asleep, to the last bit.
template <class T>
bool same_target(const SkinChunk<T>& c, int lane) {
    for (int i = lane; i < 9 * c.width; i += c.width)
        if (c.scratch.bone_springs[std::size_t(i)] != c.still_spring[std::size_t(i)]) return false;
    return true;
}

/// Moves a lane's origin to its bone where the bone has left it behind.
template <class T>
void rebase_lane(SkinChunk<T>& chunk, int lane);

/// Origin of a lane, world [m].
template <class T>
Vec3<double> lane_origin(const SkinChunk<T>& chunk, int lane);
/// A node of a lane, world [m]: where the skin of a rigid lane is, too.
template <class T>
Vec3<double> node_position(const SkinChunk<T>& chunk, int node, int lane);
/// The bone of a lane, world.
template <class T>
Pose<double> lane_bone(const SkinChunk<T>& chunk, int lane);

/// Memory for further fingers of the archetype of `like`; it holds none yet.
template <class T>
SkinChunk<T> spare_chunk(const SkinChunk<T>& like, int width, int object_count, bool has_bodies);

/// Whether a finger of one chunk could live in the other.
template <class T>
bool alike(const SkinChunk<T>& a, const SkinChunk<T>& b);

/// The finger of a's lane, with its contacts, goes to b's lane; that of b's lane, if there is one, comes in return: it
/// must be near no object. Returns false, and does nothing, where b has no slot left for an object that is near.
template <class T>
bool exchange_lanes(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b);

/// Lanes without a finger repeat lane 0, so that their arithmetic stays finite.
template <class T>
void fill_empty_lanes(SkinChunk<T>& chunk);

/// Bytes held by a chunk.
template <class T>
std::size_t memory_bytes(const SkinChunk<T>& chunk);

}  // namespace palpate
