#pragma once
// A chunk: the fingers of one archetype, one per SIMD lane. Arrays are [index][component][lane] of the
// scalar type T. Constant rest data, mutable state and scratch are separate types.

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "engine/skin/chunks/contact_slots.h"
#include "engine/skin/chunks/lane_array.h"
#include "engine/skin/chunks/skin_status.h"
#include "engine/skin/chunks/step_cut.h"
#include "engine/skin/chunks/topology.h"
#include "engine/skin/solver_settings.h"

namespace palpate {

class Threads;

inline constexpr int bone_spring_count = 3;  ///< virtual coupling, its damper, bone inertia

/// Rest shape, material and limits. Written once, at load; where all fingers of an archetype are alike, one memory of
/// all its chunks of one width (share_rest).
template <class T>
struct SkinRest {
    RestArray<T> shape_gradients;               ///< [element][node 1..3][xyz] of the rest shape [1/m]
    RestArray<T> volume;                        ///< [element] [m^3]
    RestArray<T> mu, lambda;                    ///< [element] Lame parameters [Pa]
    RestArray<T> patch_bulk;                    ///< [patch] 1 / sum of volume / lambda over its elements [Pa/m^3]
    RestArray<T> membrane_mu, membrane_lambda;  ///< [element] in plane stress [Pa]; empty without membranes
    RestArray<T> membrane_slopes;               ///< [element][corner 1..3][2] shape gradients along tangents [1/m]
    RestArray<T> limit_low, limit_high;         ///< [limit] bounds on principal stretches; empty without limits
    RestArray<T> limit_slopes;                  ///< [node of a limit patch][xyz] volume dF/dx [m^2]
    RestArray<T> limit_volume;                  ///< [limit patch] [m^3]
    RestArray<T> limit_penalty;                 ///< [limit] base penalty of the limits [Pa]; empty without limits
    RestArray<T> mass;                          ///< [node] [kg]
    RestArray<T> contact_penalty;               ///< [sample] [N/m]
    RestArray<T> corner_on_pad;     ///< [skin corner] 1: it counts in the normal at its node (corners_on_pad); 0
    RestArray<T> contact_area;      ///< [sample] share of the rest surface [m^2]; empty where objects are rigid
    RestArray<T> object_friction;   ///< [object] Coulomb coefficients; empty where fingers do not differ in them
    RestArray<T> tissue_stiffness;  ///< [1] 5 x Young's modulus x sample spacing: scale of Newton's damping [N/m]
    RestArray<T>
        rounding_stiffness;  ///< [1] what rounding of positions meets: that, or more where hardly compressible [N/m]
    RestArray<T> extent;     ///< [1] largest distance of a node from the bone's origin [m]
    RestArray<T> rest_position;  ///< [node][xyz] in the bone frame [m]
};

/// What a step reads and writes. Positions are relative to an origin of each lane near its finger, with the axes of
/// the world: in single precision a place in the room is known to 15 nm only, which contact would feel as force.
template <class T>
struct SkinState {
    LaneArray<double> origin;        ///< [xyz] [m] world, on a grid (rebase_lane)
    LaneArray<T> position;           ///< [node][xyz] [m] from the origin
    LaneArray<T> velocity;           ///< [node][xyz] [m/s]
    LaneArray<T> bone;               ///< [px py pz qw qx qy qz], position from the origin
    LaneArray<T> bone_velocity;      ///< [linear xyz, angular xyz] [m/s, rad/s]
    LaneArray<T> limit_multiplier;   ///< [limit][3x3] Lambda [Pa]; empty without limits
    LaneArray<T> normal_multiplier;  ///< [slot][sample] [N]
    LaneArray<T> contact_side;       ///< [slot][sample] face of a box or cylinder that it is on (sided_point); 0: none
    LaneArray<T>
        contact_offset;  ///< [slot][sample] below 0 while an overlap is being undone: gap at which it touches [m]
    LaneArray<T> tangential_multiplier;  ///< [slot][sample][xyz] in the object's frame [N]; empty without friction
    LaneArray<T> friction_radius;        ///< [slot][sample] [N]; empty without friction
    LaneArray<T> friction_normal;  ///< [slot][sample][xyz] of the tangent plane, object's frame; empty without friction
    LaneArray<T> svd_guess;        ///< [element][3x3] V of the last step: saves Jacobi sweeps; empty if corotational
    LaneArray<T> tangled_steps;    ///< [1] steps in a row of which each left the skin tangled (skin_step.h)
    LaneArray<T> matrix_kept;      ///< [1] 1: the blocks hold a matrix that may be kept (kept_matrix.h), 2: that was;
                                   ///< 0: none; -n: none is to be kept for n steps
    LaneArray<T> matrix_wait;      ///< [1] steps to wait if it is of no use, more where that is so again and again;
                                   ///< then it is tried again in a step whose number they divide
    LaneArray<T> matrix_limits;    ///< [1] the limits that it knows (Evaluation::limits_met)
    LaneArray<T> penalty_scale;    ///< [2] of limits, of contacts: grow where their multipliers converge slowly
};

/// An element that may be at a strain limit, or bears one's multiplier, in some lanes (bits).
struct NotedLimit {
    int limit;  ///< an element's number, or that of the elements and a patch's (SkinTopology::limit_count)
    unsigned lanes;
};

/// Work memory of a step. Of it, only what the step is given (bone_springs), what is read after it (gradient, and the
/// candidates, which hold its forces) and a matrix that is kept (blocks, contact_in_matrix) stay with the finger.
template <class T>
struct SkinScratch {
    /// Of a curved skin at the start of the step, at nodes: [sample][xyz] outward normals; [sample][xyz] how far it is
    /// outside the flat faces around [m]; [slot][sample] how much of that is towards the object [m].
    LaneArray<T> skin_normal, bulge, rise;

    LaneArray<T> start_position;  ///< [node][xyz] at the beginning of the step
    LaneArray<T> start_bone;      ///< [7]
    LaneArray<T> inertia_target;  ///< [node][xyz] x^ of implicit Euler
    LaneArray<T> bone_springs;    ///< [spring][linear k, angular k, target 7 from the origin]: written by `couple`
    LaneArray<T> coupling_reach;  ///< [m; sine of half an angle] beyond which the first spring pulls no harder
    LaneArray<T> slot_kind;       ///< [slot] ShapeKind of the object; -1 where the lane has none
    LaneArray<T> slot_size;       ///< [slot][xyz] of its shape [m]
    LaneArray<T> slot_round;      ///< [slot] radius of its shape's edges [m]
    LaneArray<T> slot_friction;   ///< [slot] Coulomb coefficient
    LaneArray<T> slot_stiffness;  ///< [slot] of an object that gives way [Pa/m]; 0: rigid
    LaneArray<T> slot_body;       ///< [slot] 1 where a body moves it, else 0
    LaneArray<T> slot_frame;      ///< [slot][end, start of the step][rotation 3x3, position from the origin 3]
    LaneArray<T> base_position;   ///< [node][xyz] last accepted iterate
    LaneArray<T> base_bone;       ///< [7]
    LaneArray<T> gradient;        ///< [node, bone][xyz]
    LaneArray<T> pending;    ///< [node][xyz] change of the limits' forces by a multiplier update; empty without limits
    LaneArray<T> direction;  ///< [node, bone][xyz] Newton step
    LaneArray<T> permuted;   ///< [unknown][xyz] right-hand side in elimination order
    LaneArray<T> blocks;     ///< [block][3x3]
    LaneArray<T> factor;     ///< [block][3x3] Cholesky factor, where lanes are fingers, or a matrix being assembled
    LaneArray<T> first_direction;       ///< [node, bone][xyz] Newton's own, before contacts or limits were followed
    LaneArray<T> sample_gradient;       ///< [sample][xyz] contact's part of the gradient, bodies' apart
    LaneArray<T> sample_curvature;      ///< [sample][3x3] and of its curvature
    LaneArray<T> contact_in_matrix;     ///< [sample][3x3] what of it the blocks hold
    LaneArray<T> sample_residual;       ///< [sample][xyz]
    LaneArray<T> panels, panel_work;    ///< of the supernodal factor, for a finger alone in its chunk
    LaneArray<T> limit_candidate;       ///< [limit][3x3] updated multipliers: the limits' stress
    LaneArray<T> normal_candidate;      ///< [slot][sample] normal force [N]
    LaneArray<T> tangential_candidate;  ///< [slot][sample][xyz]
    LaneArray<T>
        contact_normal;  ///< [slot][sample][xyz] at the last evaluation, object's frame; empty without friction
    LaneArray<T> svd;    ///< [element][3x3] V at the last evaluation; empty if corotational
    std::vector<Vec3<double>> outward;  ///< lanes whose contact is being read: [lane][sample at a node], finger frame
    std::vector<unsigned char> changed_columns;  ///< [column] of the matrix: 1 = not what the factor was made from
    std::vector<int> factored;                   ///< [supernode] 1: by one of several threads, or it is as it was
    std::vector<NotedLimit> noted_limits;  ///< of the running evaluation; memory for every element where limits are
    /// [limit] Bits of the lanes whose multiplier, and whose candidate, may be other than zero: few are, and the others
    /// are not looked at. The first are counted as a step begins; the second go with limit_candidate.
    std::vector<std::uint16_t> loaded_limits, candidate_limits;
};

/// When the tissue of a lane is linearised: in steps whose number its period divides, which is a power of two, so that
/// lanes whose periods differ still do it in the same steps, whatever chunk they are in.
struct LinearisingPlan {
    int period = 2;       ///< [steps]; 1: too much moves
    bool tried = false;   ///< linearised in the last step
    bool linear = false;  ///< the last step began linear
};

/// Tissue linearised where it was in an earlier step, per lane (linear_tissue.h); all empty where that is not allowed.
template <class T>
struct LinearTissue {
    LaneArray<T> weight;       ///< [element] force error per squared change of the deformation gradient [N]
    LaneArray<T> frame;        ///< [3x3] rotation of the bone at the place of linearisation
    LaneArray<T> arm;          ///< [node][xyz] there, from the bone's position [m]
    LaneArray<T> force;        ///< [node][xyz] gradient of the tissue's energy there [N]
    LaneArray<T> blocks;       ///< [pair][3x3] and its Hessian [N/m]
    LaneArray<T> energy;       ///< [1] there [J]
    LaneArray<T> watched;      ///< [limit] 1 where near a strain limit, else 0; empty without limits
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

/// One lane's part in an iteration that fingers share with bodies.
struct LaneReport {
    double energy = 0, residual = 0, pending = 0, violation = 0, penetration = 0, contact_force = 0, coupling_force = 0,
           limited = 0;   ///< as in Evaluation
    double rounding = 0;  ///< force that rounding of positions makes [N]
    double slope = 0;     ///< of the direction [J]
    double bad_pivots = 0;
    double contact_residual = 0;  ///< squared norm of what contact did beyond its linearisation [N^2]
    double exactness = 0, alpha = 0, damping = 0, last_excess = 1e300,
           last_depth = 1e300;  ///< given to the lane: as in LaneProgress
    bool steps = false;         ///< and whether it needs a matrix
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
    std::vector<unsigned char> idle_columns;  ///< [slot] 1: they are all zero, for nothing touches the body
    LaneArray<T> body_gradient;               ///< [slot][6] gradient along the body's motions
    LaneArray<T> body_rhs;                    ///< [slot][6] condensed right-hand side
    LaneArray<T> body_matrix;                 ///< [slot][slot][6x6] condensed matrix (Schur complement)
    LaneArray<T> body_step;  ///< [slot][6] the bodies' part of the direction: written by the bodies' solve
};

/// Whether strain limits bear anything, so that nothing is spent where they do not. False says nothing.
struct LimitActivity {
    bool counted = false;           ///< SkinScratch::loaded_limits says which multipliers of the state are zero
    bool unloaded = false;          ///< all multipliers of the state are zero
    bool candidates_clear = false;  ///< all updated multipliers in the scratch memory are zero
    bool met = true;                ///< some element was at a limit, or had a multiplier, in the last evaluation
};

// clang-format off
/// The fingers of one archetype, one per lane. The states of a lane, their bits, and what changes them:
///
/// | state     | bit             | begins                                           | ends                            |
/// |-----------|-----------------|--------------------------------------------------|---------------------------------|
/// | empty     | not used_lanes  | built so, or its finger moved (exchange_lanes)   | a finger moves in               |
/// | active    | none of these   | an object near, a target that moves (wake_lanes) | settle_lanes                    |
/// | asleep    | asleep_lanes    | at rest, nothing near (settle_lanes)             | wake_lanes                      |
/// | unchanged | unchanged_lanes | asleep, and its target stays (wake_lanes)        | wake_lanes, every step          |
/// | rigid     | rigid_lanes     | at its rest shape, nothing near (settle_lanes)   | an object near (wake_lanes)     |
/// | linear    | linear_lanes    | linearised, and good enough (choose_tissue)      | choose_tissue: the error grows; |
/// |           |                 |                                                  | or a matrix was indefinite      |
/// | fine      | fine_lanes      | deep between nodes (choose_samples)              | choose_samples                  |
///
/// Asleep and rigid exclude each other, and are not solved. A lane that is reset becomes active, and not linear.
// clang-format on
template <class T>
struct SkinChunk {
    std::shared_ptr<const SkinTopology> topology;
    int width = 1;            ///< lanes: 1, 2, 4, 8 or 16
    unsigned used_lanes = 0;  ///< bit per lane that holds a finger
    Material material = Material::corotational;
    // What it is built with: fields that it does not need have no memory (fields.h).
    bool has_limits = false;
    bool has_membranes = false;
    bool has_friction = false;
    bool has_bodies = false;
    bool has_soft_objects = false;
    bool keeps_matrix = false;  ///< Newton matrices are kept from step to step: blocks go with their fingers
    int shared_work = -1;       ///< memory that it takes turns with (WorkMemory); -1: it has its own
    double edge_round = 0;      ///< edges of boxes and rims of cylinders are round for it with this radius [m]
    int own_frictions = 0;      ///< objects against which fingers have coefficients of their own; 0: they do not
    // Bits per lane (level_of_detail.cpp): what the step leaves out.
    unsigned asleep_lanes = 0;     ///< nothing is near, and nothing moves
    unsigned rigid_lanes = 0;      ///< nothing is near: the skin moves with its bone; its positions are not kept up
    unsigned unchanged_lanes = 0;  ///< asleep, and as they were when their contact was read last
    unsigned linear_lanes = 0;     ///< the tissue's forces are linear in the nodes' motion (linear_tissue.h)
    unsigned fine_lanes = ~0u;     ///< contact is decided between nodes, too, where the topology has such samples
    unsigned soft_lanes = 0;       ///< a soft object is near a finger, or a finger near a soft object (soft_objects.h)
    LimitActivity limits;
    std::array<double, 16> skin_mass{},
        skin_inertia{};                    ///< [lane] [kg], mean over axes through the bone's origin [kg m^2]
    std::array<int, 16> free_steps{};      ///< [lane] steps in a row with nothing near
    std::array<int, 16> coarse_steps{};    ///< [lane] steps in a row in which samples between nodes made no difference
    std::array<Sphere, 16> rest_reach{};   ///< [lane] around its samples at rest, bone frame
    std::array<Sphere, 16> reach{};        ///< [lane] around its samples; kept while it sleeps
    std::array<T, 9 * 16> still_spring{};  ///< [9][lane] coupling spring when the lane fell asleep
    std::vector<int> finger;               ///< [lane] row of the finger; -1 where empty
    std::vector<SkinStatus> status;        ///< [lane]
    StepCut cut;
    Threads* threads = nullptr;  ///< lent for a step (lend_threads); null: its matrix is factored by one thread
    ContactSlots contacts;
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
    /// Of elements that hold several layers: what they have more along the skin [Pa], and its normal; empty without.
    std::vector<double> membrane_young;
    std::vector<Point> membrane_normal;
    double poisson_ratio = 0.45;
    double density = 1050;  ///< [kg/m^3]
    bool has_limits = false;
    std::vector<double> limit_low, limit_high;  ///< [element] or one value
    int element_low_power = 2;                  ///< FingerSpec::element_low_power
    double limit_penalty_factor = 100;          ///< penalty = factor x Young's modulus
    double contact_penalty_factor = 30;         ///< penalty = factor x Young's modulus x sample spacing
};

/// Bits of as many lanes as a chunk may have.
inline constexpr std::uint16_t all_lanes = 0xffff;

/// Allocates every array of a chunk, with memory for a few objects near each lane: nothing is allocated later but by
/// insert_contact.
template <class T>
void allocate_chunk(SkinChunk<T>& chunk, std::shared_ptr<const SkinTopology> topology, int width, bool has_limits,
                    bool has_friction, int object_count, bool has_bodies = false, bool has_membranes = false);

/// Makes room for touching other fingers, which then costs no allocation in the step in which they come near: the chunk
/// stays as it is.
template <class T>
void make_room_for_fingers(SkinChunk<T>& c, bool with_friction);

/// Allocates what linear tissue needs.
template <class T>
void allocate_linear_tissue(SkinChunk<T>& chunk);

/// Writes one finger into a lane, at rest on the bone pose `bone`.
template <class T>
void set_lane(SkinChunk<T>& chunk, int lane, int finger, const SkinParameters& parameters, const Pose<double>& bone);

/// Gives every sample of every used lane its share of the rest surface: needed where objects give way.
template <class T>
void set_contact_areas(SkinChunk<T>& chunk, int lane, const TetMesh& mesh);

/// Gives a lane its own coefficient of friction against an object, one of `objects`; the others keep theirs.
template <class T>
void set_lane_friction(SkinChunk<T>& chunk, int lane, int object, double friction, const std::vector<double>& objects);

/// Bits of the lanes that the step solves.
template <class T>
unsigned active_lanes(const SkinChunk<T>& c) {
    return c.used_lanes & ~(c.asleep_lanes | c.rigid_lanes);
}

/// The lanes go on with tissue as it is.
template <class T>
void leave_linear_tissue(SkinChunk<T>& chunk, unsigned lanes);

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

/// Outward normals of a lane's pad, while its contact is read: [sample at a node], finger frame.
template <class T>
std::span<Vec3<double>> lane_outward(SkinChunk<T>& c, int lane) {
    const std::size_t samples = c.topology->samples.size();
    return std::span(c.scratch.outward).subspan(std::size_t(lane) * samples, samples);
}
template <class T>
std::span<const Vec3<double>> lane_outward(const SkinChunk<T>& c, int lane) {
    return lane_outward(const_cast<SkinChunk<T>&>(c), lane);
}

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
SkinChunk<T> spare_chunk(const SkinChunk<T>& like, int width);

/// Whether a finger of one chunk could live in the other.
template <class T>
bool alike(const SkinChunk<T>& a, const SkinChunk<T>& b);

/// The finger of a's lane, with its contacts, goes to b's lane; that of b's lane, if there is one, comes in return: it
/// must be near no object.
template <class T>
void exchange_lanes(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b);

/// Before rest data are written: they are no others' from now on.
template <class T>
void own_rest(SkinChunk<T>& chunk);

/// Lanes without a finger repeat lane 0, so that their arithmetic stays finite.
template <class T>
void fill_empty_lanes(SkinChunk<T>& chunk);

/// Bytes held by a chunk.
template <class T>
std::size_t memory_bytes(const SkinChunk<T>& chunk);

/// Gives every array of a chunk the size that it is described with (fields.h): new numbers begin with their first
/// value, old ones stay.
template <class T>
void resize_fields(SkinChunk<T>& chunk);

/// Whether a chunk has work memory of its own: what is solved together with bodies, or is linear, has; then solve_skins
/// does not read its contact.
template <class T>
bool has_own_work(const SkinChunk<T>& c) {
    return c.shared_work < 0 || c.has_bodies || !c.linear.pairs.empty();
}

/// Work memory of one of those that solve at the same time (work_memory.h): chunks that hold nothing else.
struct WorkMemory {
    std::vector<SkinChunk<double>> doubles;
    std::vector<SkinChunk<float>> floats;
    double read_s = 0;  ///< what reading contact took in this step [s]
};

/// All chunks of a world, by precision.
struct SkinChunks {
    std::vector<SkinChunk<double>> doubles;
    std::vector<SkinChunk<float>> floats;
    std::vector<WorkMemory> work;  ///< empty where every chunk has its own

    template <class Visit>
    void for_each(Visit visit) {
        for (auto& c : doubles) visit(c);
        for (auto& c : floats) visit(c);
    }
    template <class Visit>
    void for_each(Visit visit) const {
        for (const auto& c : doubles) visit(c);
        for (const auto& c : floats) visit(c);
    }
    int count() const { return int(doubles.size() + floats.size()); }
    /// Calls visit(chunk) for chunk `index` of doubles, then floats.
    template <class Visit>
    auto with(int index, Visit visit) {
        const int n = int(doubles.size());
        return index < n ? visit(doubles[std::size_t(index)]) : visit(floats[std::size_t(index - n)]);
    }
    /// Calls visit(chunk) for a finger's chunk.
    template <class Visit>
    auto with(bool single_precision, int row, Visit visit) {
        return single_precision ? visit(floats[std::size_t(row)]) : visit(doubles[std::size_t(row)]);
    }
    template <class Visit>
    auto with(bool single_precision, int row, Visit visit) const {
        return single_precision ? visit(floats[std::size_t(row)]) : visit(doubles[std::size_t(row)]);
    }
};

}  // namespace palpate
