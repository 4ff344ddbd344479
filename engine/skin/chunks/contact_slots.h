#pragma once
// What the lanes of a chunk touch. Every lane has slots of its own: the objects near it fill its slots 0, 1, ... in the
// order of their rows, so that its sums over them depend neither on its neighbours nor on which object came first.
// Slot k of another lane may hold another object, of another kind. Slots that hold something in some lane are solved.

#include <array>
#include <vector>

#include "engine/contact/shape.h"

namespace palpate {

/// An object as one lane sees it in one step.
struct LaneContact {
    int object = -1;  ///< row of the object; -1: none; of another finger: its row after those of all objects
    Shape shape;
    Pose<double> pose;           ///< at the end of the step; of a body: as far as the solve has got
    Pose<double> start;          ///< at its beginning
    double friction = 0;         ///< Coulomb coefficient of this finger against it
    double stiffness = 0;        ///< pressure per depth of an object that gives way [Pa/m]; 0: rigid
    int body = -1;               ///< row of the body that moves it; -1: fixed or scripted; planes between fingers
                                 ///< come after all bodies
    Vec3<double> mass_centre{};  ///< of the body, in the object's frame [m]
    bool fresh = false;          ///< was not near in the step before
    int finger = -1;             ///< row of the finger on the other side of the plane that this is; -1: an object
    bool behind = false;         ///< it was behind nodes of the pad (nodes_behind) at the end of the last step
    int leapt = 0;               ///< nodes that have leapt through it, for as long as it is touched (nodes_leapt)
};

inline constexpr int shape_kind_count = 6;  ///< of ShapeKind

/// What lanes have in one slot, bit per lane. Written by begin_slots.
struct ContactSlot {
    unsigned lanes = 0;                                ///< that hold an object
    std::array<unsigned, shape_kind_count> of_kind{};  ///< of which this is the shape
    unsigned body_lanes = 0;                           ///< that a body moves
    unsigned soft_lanes = 0;                           ///< that gives way
    bool friction = false;                             ///< some lane rubs
    bool sided = false;                                ///< of some lane, samples remember their side
    bool recovers = false;                             ///< in some lane, an overlap is being undone
};

/// The slots of a chunk. Their arrays of numbers are fields of the chunk (fields.h).
struct ContactSlots {
    int capacity = 0;                       ///< slots with memory
    int used = 0;                           ///< slots that hold an object in some lane, written by begin_slots
    int width = 1;                          ///< of the chunk
    std::array<int, 16> count{};            ///< [lane] objects near it
    std::vector<LaneContact> lane_contact;  ///< [slot][lane]
    std::vector<ContactSlot> slot;          ///< [slot]

    LaneContact& at(int index, int lane) { return lane_contact[std::size_t(index * width + lane)]; }
    const LaneContact& at(int index, int lane) const { return lane_contact[std::size_t(index * width + lane)]; }
};

template <class T>
struct SkinChunk;
struct SolverSettings;

/// Puts an object into slot `slot` of a lane, before those that are there, without multipliers. Allocates where the
/// lane needs more slots than the chunk has; returns whether it did.
template <class T>
bool insert_contact(SkinChunk<T>& chunk, int lane, int slot, const LaneContact& contact);

/// Takes an object, and its multipliers, out of a lane.
template <class T>
void erase_contact(SkinChunk<T>& chunk, int lane, int slot);

/// Moves all contacts of a's lane, with their multipliers, to b's lane, which must have none.
template <class T>
void move_contacts(SkinChunk<T>& a, int lane_a, SkinChunk<T>& b, int lane_b);

/// Writes what the slots hold, as kernels read it, and where, and for each sample the side it is on and the overlap
/// that it begins with: at the start of a step.
template <class T>
void begin_slots(SkinChunk<T>& chunk, const SolverSettings& settings);

/// The motion that undid overlaps is no velocity: takes it from the nodes. Such lanes have not converged, and say how
/// deep they still are.
template <class T>
void end_slots(SkinChunk<T>& chunk, const SolverSettings& settings);

/// Writes where the slots' objects are, as each lane sees them: after a pose or an origin has changed.
template <class T>
void place_slots(SkinChunk<T>& chunk);

/// Whether something with sides (has_sides) is near some lane: normals of the skin decide which side it is on.
template <class T>
bool near_sides(const SkinChunk<T>& chunk);

/// Bits of the lanes that something is near to.
template <class T>
unsigned near_lanes(const SkinChunk<T>& chunk);

/// Bits of the lanes that are near a body, a soft object, or another finger: they are solved together with it.
template <class T>
unsigned coupled_lanes(const SkinChunk<T>& chunk);

/// Whether a body, another finger or a soft object is near some lane.
template <class T>
bool solved_with_others(const SkinChunk<T>& chunk);

}  // namespace palpate
