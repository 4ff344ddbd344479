#pragma once
// Every array of a chunk, once: how large it is, whose it is, what it is for, and when it exists. Allocating, growing,
// moving a finger, clearing a contact, carrying over and counting bytes follow from this table.

#include "engine/skin/chunks/chunk.h"

namespace palpate {

/// What an array is for.
enum class Role {
    rest,     ///< written at load
    state,    ///< from step to step
    input,    ///< written before the step, for it
    output,   ///< of the step, read after it
    scratch,  ///< nothing that outlives the step
    work,     ///< nothing that outlives solving its chunk and reading its contact: chunks may take turns with it
              ///< (work_memory.h)
};
/// What each of its parts belongs to.
enum class Owner { lane, slot, pair_of_slots };

struct Field {
    Role role;
    Owner owner;
    std::size_t size;  ///< numbers per lane, of each owner; 0: the chunk has no such array
    double first = 0;  ///< value of fresh numbers
};

/// Numbers of a field in each lane.
inline std::size_t numbers_per_lane(const Field& f, int slot_capacity) {
    const auto slots = std::size_t(slot_capacity);
    return f.size * (f.owner == Owner::lane ? 1 : f.owner == Owner::slot ? slots : slots * slots);
}

/// Whether a field goes with its finger.
inline bool stays_with_finger(const Field& f) { return f.role != Role::scratch && f.role != Role::work; }

/// How many of what a chunk has.
struct FieldSizes {
    std::size_t E, N, S;  ///< elements, nodes, samples
    std::size_t unknowns, everything;
    std::size_t decomposed;    ///< elements of a material that is a function of principal stretches
    std::size_t membranes;     ///< elements that may have one
    std::size_t limited;       ///< elements and patches with strain limits
    std::size_t samples;       ///< samples that can touch something
    std::size_t rubbing;       ///< samples that can rub
    std::size_t corners;       ///< samples at nodes, where something may touch them
    std::size_t curved;        ///< of a curved skin
    std::size_t body, linear;  ///< 1 where bodies, linear tissue are
    std::size_t pairs;         ///< of linear tissue
    template <class Chunk>
    explicit FieldSizes(const Chunk& c)
        : E(c.topology->elements.size()),
          N(std::size_t(c.topology->node_count)),
          S(c.topology->sample_count()),
          unknowns(c.topology->unknowns.size()),
          everything(3 * (N + 2)),
          decomposed(c.material == Material::corotational ? 0 : E),
          membranes(c.has_membranes ? E : 0),
          limited(c.has_limits ? c.topology->limit_count() : 0),
          samples(c.contacts.capacity > 0 ? S : 0),
          rubbing(c.has_friction ? S : 0),
          corners(c.contacts.capacity > 0 ? c.topology->samples.size() : 0),
          curved(c.topology->skin_edges.empty() ? 0 : c.topology->samples.size()),
          body(c.has_bodies ? 1 : 0),
          linear(c.linear.pairs.empty() ? 0 : 1),
          pairs(c.linear.pairs.size()) {}
};

/// Rest shape, material, limits.
template <class Chunk, class Visit>
void for_each_rest_field(Chunk& c, Visit visit) {
    using enum Role;
    using enum Owner;
    const FieldSizes n(c);
    auto& r = c.rest;
    visit(r.shape_gradients, Field{rest, lane, 9 * n.E});
    visit(r.volume, Field{rest, lane, n.E});
    visit(r.mu, Field{rest, lane, n.E});
    visit(r.lambda, Field{rest, lane, n.E});
    visit(r.patch_bulk, Field{rest, lane, c.topology->patches.size()});
    visit(r.membrane_mu, Field{rest, lane, n.membranes});
    visit(r.membrane_lambda, Field{rest, lane, n.membranes});
    visit(r.membrane_slopes, Field{rest, lane, 6 * n.membranes});
    visit(r.limit_low, Field{rest, lane, n.limited});
    visit(r.limit_high, Field{rest, lane, n.limited});
    visit(r.limit_penalty, Field{rest, lane, n.limited});
    visit(r.limit_slopes, Field{rest, lane, c.has_limits ? 3 * c.topology->limit_nodes.size() : 0});
    visit(r.limit_volume, Field{rest, lane, c.has_limits ? c.topology->limit_patches.size() : 0});
    visit(r.mass, Field{rest, lane, n.N});
    visit(r.contact_penalty, Field{rest, lane, n.S});
    visit(r.corner_on_pad, Field{rest, lane, c.topology->skin_corners.size()});
    visit(r.contact_area, Field{rest, lane, c.has_soft_objects ? n.S : 0});
    visit(r.object_friction, Field{rest, lane, std::size_t(c.own_frictions)});
    visit(r.tissue_stiffness, Field{rest, lane, 1});
    visit(r.rounding_stiffness, Field{rest, lane, 1});
    visit(r.extent, Field{rest, lane, 1});
    visit(r.rest_position, Field{rest, lane, 3 * n.N});
}

/// What a step reads and writes.
template <class Chunk, class Visit>
void for_each_state_field(Chunk& c, Visit visit) {
    using enum Role;
    using enum Owner;
    const FieldSizes n(c);
    auto& s = c.state;
    visit(s.origin, Field{state, lane, 3});
    visit(s.position, Field{state, lane, 3 * n.N});
    visit(s.velocity, Field{state, lane, 3 * n.N});
    visit(s.bone, Field{state, lane, 7});
    visit(s.bone_velocity, Field{state, lane, 6});
    visit(s.limit_multiplier, Field{state, lane, 9 * n.limited});
    visit(s.normal_multiplier, Field{state, slot, n.S});
    visit(s.contact_side, Field{state, slot, n.S});
    visit(s.contact_offset, Field{state, slot, n.S});
    visit(s.tangential_multiplier, Field{state, slot, 3 * n.rubbing});
    visit(s.friction_radius, Field{state, slot, n.rubbing});
    visit(s.friction_normal, Field{state, slot, 3 * n.rubbing});
    visit(s.svd_guess, Field{state, lane, 9 * n.decomposed});
    visit(s.tangled_steps, Field{state, lane, 1});
    visit(s.matrix_kept, Field{state, lane, 1});
    visit(s.matrix_wait, Field{state, lane, 1, 1});
    visit(s.matrix_limits, Field{state, lane, 1});
    visit(s.penalty_scale, Field{state, lane, 2, 1});
}

/// Work memory, inputs, outputs.
template <class Chunk, class Visit>
void for_each_scratch_field(Chunk& c, Visit visit) {
    using enum Role;
    using enum Owner;
    const FieldSizes n(c);
    auto& w = c.scratch;
    auto work_of = [&](std::size_t size) { return Field{work, lane, has_own_work(c) ? size : 0}; };
    visit(w.start_position, work_of(3 * n.N));
    visit(w.start_bone, Field{scratch, lane, 7});
    visit(w.inertia_target, work_of(3 * n.N));
    visit(w.bone_springs, Field{input, lane, 9 * std::size_t(bone_spring_count)});
    visit(w.coupling_reach, Field{input, lane, 2});
    visit(w.slot_kind, Field{scratch, slot, 1});
    visit(w.slot_size, Field{scratch, slot, 3});
    visit(w.slot_round, Field{scratch, slot, 1});
    visit(w.slot_friction, Field{scratch, slot, 1});
    visit(w.slot_stiffness, Field{scratch, slot, 1});
    visit(w.skin_normal, work_of(3 * n.corners));
    visit(w.bulge, work_of(3 * n.curved));
    visit(w.rise, Field{scratch, slot, n.curved});
    visit(w.slot_body, Field{scratch, slot, 1});
    visit(w.slot_frame, Field{scratch, slot, 24});
    visit(w.base_position, work_of(3 * n.N));
    visit(w.base_bone, Field{scratch, lane, 7});
    visit(w.gradient, Field{output, lane, n.everything});
    visit(w.pending, work_of(c.has_limits ? 3 * n.N : 0));
    visit(w.direction, work_of(n.everything));
    visit(w.permuted, work_of(3 * n.unknowns));
    auto of_matrix = [&](std::size_t size) { return c.keeps_matrix ? Field{state, lane, size} : work_of(size); };
    visit(w.blocks, of_matrix(9 * std::size_t(c.topology->block_count)));
    visit(w.factor, work_of(c.width > 1 ? 9 * std::size_t(c.topology->block_count) : 0));  // holds blocks, too
    visit(w.panels, work_of(c.width == 1 ? std::size_t(c.topology->supernodes.panel_scalars) : 0));
    visit(w.panel_work, work_of(c.width == 1 ? panel_work_scalars(c.topology->supernodes) : 0));
    visit(w.first_direction, work_of(n.samples > 0 || n.limited > 0 ? n.everything : 0));
    visit(w.sample_gradient, work_of(3 * n.samples));
    visit(w.sample_curvature, work_of(9 * n.samples));
    visit(w.contact_in_matrix, of_matrix(9 * n.S));  // goes to chunks that have met nothing, too
    visit(w.sample_residual, work_of(3 * n.samples));
    visit(w.limit_candidate, work_of(9 * n.limited));
    visit(w.normal_candidate, Field{output, slot, n.S});
    visit(w.tangential_candidate, Field{output, slot, 3 * n.rubbing});
    visit(w.contact_normal, Field{scratch, slot, 3 * n.rubbing});
    visit(w.svd, Field{scratch, lane, 9 * n.decomposed});
}

/// What is exchanged with bodies.
template <class Chunk, class Visit>
void for_each_exchange_field(Chunk& c, Visit visit) {
    using enum Role;
    using enum Owner;
    const FieldSizes n(c);
    auto& x = c.exchange;
    visit(x.centre, Field{scratch, slot, 3 * n.body});
    visit(x.slot_gradient, Field{scratch, slot, 3 * n.S * n.body});
    visit(x.slot_curvature, Field{scratch, slot, 9 * n.S * n.body});
    visit(x.columns, Field{scratch, slot, 18 * n.unknowns * n.body});
    visit(x.body_gradient, Field{scratch, slot, 6 * n.body});
    visit(x.body_rhs, Field{scratch, slot, 6 * n.body});
    visit(x.body_matrix, Field{scratch, pair_of_slots, 36 * n.body});
    visit(x.body_step, Field{scratch, slot, 6 * n.body});
}

/// Linear tissue.
template <class Chunk, class Visit>
void for_each_linear_field(Chunk& c, Visit visit) {
    using enum Role;
    using enum Owner;
    const FieldSizes n(c);
    auto& l = c.linear;
    visit(l.weight, Field{rest, lane, n.E * n.linear});
    visit(l.frame, Field{state, lane, 9 * n.linear});
    visit(l.arm, Field{state, lane, 3 * n.N * n.linear});
    visit(l.force, Field{state, lane, 3 * n.N * n.linear});
    visit(l.blocks, Field{state, lane, 9 * n.pairs});
    visit(l.energy, Field{state, lane, n.linear});
    visit(l.watched, Field{state, lane, n.limited * n.linear});
    visit(l.reach, Field{state, lane, n.linear});
    visit(l.bound, Field{state, lane, n.linear});
    visit(l.error, Field{state, lane, n.linear});
    visit(l.moved, Field{scratch, lane, 3 * n.N * n.linear});
    visit(l.moved_force, Field{scratch, lane, 3 * n.N * n.linear});
}

/// Calls visit(array, field) for every array of a chunk.
template <class Chunk, class Visit>
void for_each_field(Chunk& c, Visit visit) {
    for_each_rest_field(c, visit);
    for_each_state_field(c, visit);
    for_each_scratch_field(c, visit);
    for_each_exchange_field(c, visit);
    for_each_linear_field(c, visit);
}

/// Calls visit(array of a, array of b, field of a) for every array of two chunks.
template <class T, class Visit>
void for_each_field_of_both(SkinChunk<T>& a, SkinChunk<T>& b, Visit visit) {
    std::array<void*, 128> of_b;
    std::size_t k = 0;
    for_each_field(b, [&](auto& array, const Field&) { of_b.at(k++) = &array; });
    k = 0;
    for_each_field(a, [&](auto& array, const Field& f) {
        visit(array, *static_cast<std::remove_reference_t<decltype(array)>*>(of_b[k++]), f);
    });
}

}  // namespace palpate
