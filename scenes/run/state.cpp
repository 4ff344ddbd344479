#include "scenes/run/state.h"

#include <cstring>
#include <type_traits>

#include "engine/skin/chunks/fields.h"

namespace palpate {

namespace {

constexpr std::uint64_t magic = 0x3265746174736c70;  // "plstate2"

}  // namespace

std::uint64_t checksum(const std::uint8_t* bytes, std::size_t size) {  // FNV-1a, of eight bytes at a time
    std::uint64_t sum = 1469598103934665603ull, word = 0;
    for (std::size_t i = 0; i < size; i += 8) {
        word = 0;
        std::memcpy(&word, bytes + i, std::min<std::size_t>(8, size - i));
        sum = (sum ^ word) * 1099511628211ull;
        sum ^= sum >> 29;
    }
    return (sum ^ size) * 1099511628211ull;
}

namespace {

/// Both directions are one text: `Writer` and `Reader` have the same calls.
class Writer {
  public:
    explicit Writer(std::vector<std::uint8_t>& out) : out_(&out) {}
    static constexpr bool reads = false;
    bool good() const { return true; }
    void refuse() {}
    void bytes(const void* data, std::size_t size) {
        const auto* p = static_cast<const std::uint8_t*>(data);
        out_->insert(out_->end(), p, p + size);
    }
    /// What resize may ask for; of no use here.
    bool count(std::uint64_t& n, std::size_t /*size of one*/) {
        bytes(&n, sizeof n);
        return true;
    }

  private:
    std::vector<std::uint8_t>* out_;
};

class Reader {
  public:
    Reader(const std::uint8_t* begin, std::size_t size) : at_(begin), end_(begin + size) {}
    static constexpr bool reads = true;
    bool good() const { return good_; }
    void refuse() { good_ = false; }
    bool at_end() const { return at_ == end_; }
    void bytes(void* data, std::size_t size) {
        if (size > std::size_t(end_ - at_)) good_ = false;
        if (!good_ || size == 0) return;
        std::memcpy(data, at_, size);
        at_ += size;
    }
    bool count(std::uint64_t& n, std::size_t size_of_one) {
        bytes(&n, sizeof n);
        if (good_ && n > std::size_t(end_ - at_) / size_of_one) good_ = false;
        return good_;
    }

  private:
    const std::uint8_t *at_, *end_;
    bool good_ = true;
};

template <class Archive, class T>
void value(Archive& a, T& v) {
    static_assert(std::is_trivially_copyable_v<T> && !std::is_pointer_v<T>);
    a.bytes(&v, sizeof v);
}
template <class Archive, class T, class... More>
requires(sizeof...(More) > 0) void value(Archive& a, T& v, More&... more) {
    value(a, v);
    value(a, more...);
}

/// An array that has its size already.
template <class Archive, class Vector>
void array(Archive& a, Vector& v) {
    using T = typename Vector::value_type;
    static_assert(std::is_trivially_copyable_v<T>);
    std::uint64_t n = v.size();
    if (a.count(n, sizeof(T)) && n != v.size()) a.refuse();
    if (a.good()) a.bytes(v.data(), n * sizeof(T));
}
/// One that chunks share stays theirs where it is the same.
template <class Archive, class T>
void array(Archive& a, RestArray<T>& v) {
    LaneArray<T> numbers(v.begin(), v.end());
    array(a, numbers);
    if (!Archive::reads || std::equal(v.begin(), v.end(), numbers.begin())) return;
    v.own();
    std::copy(numbers.begin(), numbers.end(), v.data());
}
/// One that may grow and shrink.
template <class Archive, class Vector>
void growing(Archive& a, Vector& v) {
    std::uint64_t n = v.size();
    if (!a.count(n, 1)) return;
    if (Archive::reads) v.resize(n);
    if (!v.empty()) a.bytes(v.data(), n * sizeof v[0]);
}

template <class Archive>
void coordinates(Archive& a, Coordinates& q) {
    std::uint64_t n = std::uint64_t(q.size());
    if (!a.count(n, sizeof(double))) return;
    if (n > std::uint64_t(max_device_dimension)) return a.refuse();
    if (Archive::reads) q.resize(Eigen::Index(n));
    a.bytes(q.data(), n * sizeof(double));
}
template <class Archive, class Matrix>
void matrix(Archive& a, Matrix& m) {
    std::uint64_t rows = std::uint64_t(m.rows()), columns = std::uint64_t(m.cols());
    a.count(rows, 1), a.count(columns, 1);
    if (!a.good() || rows != std::uint64_t(m.rows()) || columns != std::uint64_t(m.cols())) return a.refuse();
    a.bytes(m.data(), rows * columns * sizeof(double));
}

/// Objects as the lanes of a chunk see them. Meshes are those of the world's shapes.
template <class Archive>
void exchange(Archive& a, ContactSlots& c, const Table<VirtualObject>& shapes) {
    value(a, c.capacity, c.used, c.width, c.count);
    growing(a, c.slot);
    std::uint64_t n = c.lane_contact.size();
    if (!a.count(n, sizeof(LaneContact))) return;
    if (Archive::reads) c.lane_contact.resize(n);
    for (LaneContact& own : c.lane_contact) {
        LaneContact contact = own;
        contact.shape.mesh = nullptr;
        value(a, contact);
        if (!Archive::reads || !a.good()) continue;
        if (contact.shape.kind == ShapeKind::mesh) {
            if (contact.object < 0 || std::size_t(contact.object) >= shapes.size()) return a.refuse();
            contact.shape.mesh = shapes[std::size_t(contact.object)].shape.mesh;
        }
        own = contact;
    }
}

template <class Archive, class T>
void exchange(Archive& a, SkinChunk<T>& c, const Table<VirtualObject>& shapes) {
    value(a, c.has_bodies, c.has_friction, c.keeps_matrix);  // fingers that came near each other may have brought them
    value(a, c.used_lanes, c.own_frictions, c.asleep_lanes, c.rigid_lanes, c.unchanged_lanes, c.linear_lanes,
          c.fine_lanes, c.limits, c.skin_mass, c.skin_inertia, c.free_steps, c.coarse_steps, c.rest_reach, c.reach,
          c.still_spring);
    array(a, c.finger);
    array(a, c.status);
    exchange(a, c.contacts, shapes);
    value(a, c.linear.plan, c.linear.due_lanes, c.linear.fresh_lanes, c.linear.left_lanes, c.linear.kept_lanes);
    if (!a.good()) return;
    if (Archive::reads) resize_fields(c);
    for_each_field(c, [&](auto& numbers, const Field& f) {
        if (stays_with_finger(f)) array(a, numbers);
    });
    if (!Archive::reads) return;
    // Factors are no part of it, nor which multipliers are zero.
    std::fill(c.scratch.changed_columns.begin(), c.scratch.changed_columns.end(), 1);
    c.limits.counted = false;
    for (auto* lanes : {&c.scratch.loaded_limits, &c.scratch.candidate_limits})
        std::fill(lanes->begin(), lanes->end(), all_lanes);
}

template <class Archive>
void exchange(Archive& a, MatchingResult& r) {
    coordinates(a, r.w);
    coordinates(a, r.q);
    value(a, r.status, r.residual, r.rms_m, r.evaluations, r.constraint_active, r.force_residual_N);
}

template <class Archive>
void exchange(Archive& a, ForceMatcher& m, const Table<VirtualObject>& shapes) {
    for (auto& chunk : m.chunks) exchange(a, chunk, shapes);
    for (Coordinates& w : m.lane_w) coordinates(a, w);
    matrix(a, m.forces);
    matrix(a, m.wanted);
    matrix(a, m.residual);
    matrix(a, m.moved);
    matrix(a, m.weight);
    matrix(a, m.jacobian);
    matrix(a, m.weighted);
    matrix(a, m.centre_forces);
    coordinates(a, m.centre);
    value(a, m.damping, m.warm, m.solves, m.unconverged);
}

template <class Archive>
void exchange(Archive& a, ContactSurface& c) {
    value(a, c.bone, c.rough, c.rough_steps, c.total, c.normal_force, c.touching_area, c.touching);
    array(a, c.position);
    if (!c.bulge.empty()) array(a, c.bulge);
    array(a, c.force);
    array(a, c.pressing);
    array(a, c.touches);
    array(a, c.gap);
    growing(a, c.objects);
    if (Archive::reads) std::fill(c.bears.begin(), c.bears.end(), char(1));
}

template <class Archive>
void exchange(Archive& a, ThimbleCommand& c) {
    value(a, c.time, c.valid, c.sampled_at);
    coordinates(a, c.q);
    coordinates(a, c.torque);
}

template <class Archive, class T>
void exchange_atomic(Archive& a, std::atomic<T>& v) {
    T plain = v;
    value(a, plain);
    if (Archive::reads) v = plain;
}

template <class Archive>
void exchange(Archive& a, ThimbleLoop& l) {
    exchange(a, l.newest);
    for (Coordinates* q : {&l.q, &l.velocity, &l.torque}) coordinates(a, *q);
    value(a, l.pose_at, l.newest_at, l.next_tick, l.resting_since, l.easing_since, l.rearm_until, l.in_contact,
          l.touching_down, l.was_let_go, l.status);
    exchange_atomic(a, l.parked);
    exchange_atomic(a, l.let_go);
    exchange_atomic(a, l.rearm_asked);
    ThimbleCommand waiting;
    bool waits = Archive::reads ? false : l.mailbox.peek(waiting);
    value(a, waits);
    if (waits) exchange(a, waiting);
    std::vector<double> driver = l.driver->state();
    growing(a, driver);
    if (!Archive::reads || !a.good()) return;
    for (ThimbleCommand gone; l.mailbox.take(gone);) {}
    if (waits) l.mailbox.publish(waiting);
    if (!l.driver->set_state(driver)) a.refuse();
}

template <class Archive>
void exchange(Archive& a, BodySolve& s) {
    growing(a, s.first_pair);
    array(a, s.wanted_pairs);
    value(a, s.deepest);
    std::uint64_t n = s.pairs.size();
    if (!a.count(n, 1)) return;
    if (Archive::reads) s.pairs.resize(n);
    for (BodyPair& p : s.pairs) {
        value(a, p.a, p.b, p.friction, p.penalty, p.near);
        growing(a, p.contacts);
    }
}

/// Soft objects, and what fingers press them with.
template <class Archive>
void exchange(Archive& a, SoftObjects& soft) {
    for (SoftObject& o : soft.all) {
        value(a, o.hold, o.entered_by, o.entered_at, o.entered_steps);
        exchange(a, o.surface);
    }
    for (SoftPair& p : soft.pairs) {
        value(a, p.friction, p.near);
        array(a, p.samples);
    }
}

template <class Archive>
void exchange(Archive& a, World& w) {
    value(a, w.time, w.step, w.solver, w.sampled_at, w.contact_growths);
    for (TrackerPose& t : w.tracker_poses) value(a, t);
    for (PoseFilter& f : w.pose_filters) value(a, f);
    for (Coupling& c : w.couplings) value(a, c);
    for (Skin& s : w.skins) value(a, s.chunk, s.lane);
    for (ContactSurface& c : w.contact_surfaces) exchange(a, c);
    for (VirtualObject& o : w.shapes) value(a, o.pose, o.previous, o.body, o.held_body);
    for (RigidBody& b : w.bodies) value(a, b);
    exchange(a, w.body_solve);
    growing(a, w.finger_pairs.near);
    growing(a, w.finger_pairs.before);
    exchange(a, w.soft);
    w.chunks.for_each([&](auto& chunk) { exchange(a, chunk, w.shapes); });
    for (Matching& m : w.matchings) {
        value(a, m.next, m.fresh, m.solved_at, m.since_last, m.force_N, m.solves, m.constrained_solves, m.failures,
              m.contact_solves, m.beside_N, m.beside_solves);
        exchange(a, m.result);
        exchange(a, m.geometric);
        coordinates(a, m.q);
        coordinates(a, m.torque);
    }
    for (ForceMatcher& m : w.force_matchers) exchange(a, m, w.shapes);
    for (DeviceLink& l : w.device_links) value(a, l.retreat, l.retreats);
}

template <class Archive>
void exchange(Archive& a, Simulation& s) {
    exchange(a, s.world);
    for (auto& loop : s.loops) exchange(a, *loop);
    array(a, s.finger_counts);
    if (!s.governor) return;
    Governor& g = *s.governor;
    value(a, g.preset, g.patience, g.in_time, g.longest, g.since_up, g.missed, g.cut_short, g.changes);
    array(a, g.steps);
}

/// What must be the same for a state to fit: the scene as it was built, with its settings.
std::uint64_t fingerprint(const Simulation& s) {
    std::vector<std::uint8_t> what;
    Writer a(what);
    const auto number = [&](double v) { value(a, v); };
    const World& w = s.world;
    for (std::size_t n :
         {w.skins.size(), w.shapes.size(), w.bodies.size(), w.matchings.size(), w.pose_filters.size(),
          w.force_matchers.size(), sizeof(RigidBody), sizeof(LaneContact), sizeof(Coupling), sizeof(SolverSettings),
          sizeof(FeatureContact), sizeof(FingerPair), w.soft.all.size(), w.soft.pairs.size(), sizeof(SoftSample)})
        number(double(n));
    // Steps and solve as the scene says: those of the moment are part of the state, where a governor changes presets.
    const SolverSettings& solve = s.scene.spec.solver;
    for (double v : {solve.dt, double(solve.newton_iterations), solve.unbalanced_share, solve.tolerance,
                     solve.multiplier_tolerance, double(solve.contact_iterations), double(solve.stiffness_steps),
                     double(solve.sample_refinement), double(solve.inertia), double(s.governor.has_value())})
        number(v);
    number(w.finger_pairs.on);
    number(w.finger_pairs.friction);
    const auto tissue = [&](const FingerSpec& f) {
        a.bytes(f.name.data(), f.name.size());
        a.bytes(f.mesh.nodes.data(), f.mesh.nodes.size() * sizeof f.mesh.nodes[0]);
        a.bytes(f.mesh.tets.data(), f.mesh.tets.size() * sizeof f.mesh.tets[0]);
        a.bytes(f.mesh.patches.data(), f.mesh.patches.size() * sizeof f.mesh.patches[0]);
        a.bytes(f.mesh.limit_patches.data(), f.mesh.limit_patches.size() * sizeof f.mesh.limit_patches[0]);
        for (const LimitShare& s : f.mesh.limit_shares)
            for (double v : {double(s.tet), double(s.patch), s.share}) number(v);
        if (f.element_low_power != 2) number(f.element_low_power);
        if (f.mesh.curved_skin) number(1);
        a.bytes(f.mesh.membrane_patches.data(), f.mesh.membrane_patches.size() * sizeof f.mesh.membrane_patches[0]);
        for (double v : {f.young_modulus, f.poisson_ratio, f.density, f.limit_low, f.limit_high, f.coupling.stiffness,
                         f.coupling.damping, double(f.has_limits), double(f.material)})
            number(v);
        a.bytes(f.element_young.data(), f.element_young.size() * sizeof(double));
        a.bytes(f.element_membrane.data(), f.element_membrane.size() * sizeof(double));
    };
    for (const FingerSpec& f : s.scene.spec.fingers) tissue(f);
    for (const ObjectSpec& o : s.scene.spec.objects)
        if (o.tissue) tissue(*o.tissue);
    for (const ObjectSpec& o : s.scene.spec.objects) {
        a.bytes(o.name.data(), o.name.size());
        for (double v : {o.shape.size.x, o.shape.size.y, o.shape.size.z, o.friction, o.stiffness,
                         o.body ? o.body->mass : 0, double(o.shape.kind)})
            number(v);
        if (!o.mesh) continue;
        const Surface& surface = o.mesh->surface;
        a.bytes(surface.vertices.data(), surface.vertices.size() * sizeof surface.vertices[0]);
        a.bytes(surface.triangles.data(), surface.triangles.size() * sizeof surface.triangles[0]);
    }
    for (const Matching& m : w.matchings) {
        a.bytes(m.model.kind->name.data(), m.model.kind->name.size());
        for (double v : {double(m.method), m.period, double(m.force_mode)}) number(v);
    }
    w.chunks.for_each([&](const auto& c) {
        number(c.width);
        number(double(sizeof(c.still_spring[0])));
        number(double(c.topology->samples.size()));
        number(double(c.topology->sample_count()));
    });
    return checksum(what.data(), what.size());
}

struct Header {
    std::uint64_t magic, fingerprint, size, sum;
};

}  // namespace

void append_state(std::vector<std::uint8_t>& out, Simulation& s) {
    const std::size_t begin = out.size();
    out.resize(begin + sizeof(Header));
    Writer writer(out);
    exchange(writer, s);
    const std::uint8_t* body = out.data() + begin + sizeof(Header);
    const std::size_t size = out.size() - begin - sizeof(Header);
    const Header header{magic, fingerprint(s), size, checksum(body, size)};
    std::memcpy(out.data() + begin, &header, sizeof header);
}

bool restore_state(Simulation& s, const std::uint8_t* bytes, std::size_t size, std::string& why) {
    Header header{};
    if (size >= sizeof header) std::memcpy(&header, bytes, sizeof header);
    if (header.magic != magic) {
        const bool older = ((header.magic ^ magic) & 0x00ffffffffffffff) == 0;
        why = older ? "the saved state is of another version of palpate" : "these bytes are no saved state";
        return false;
    }
    if (header.size != size - sizeof header || checksum(bytes + sizeof header, header.size) != header.sum) {
        why = "the saved state is damaged or cut off";
        return false;
    }
    if (header.fingerprint != fingerprint(s)) {
        why = "the state was saved of another scene, or of this one with other settings";
        return false;
    }
    Reader reader(bytes + sizeof header, header.size);
    exchange(reader, s);
    if (reader.good() && reader.at_end()) return true;
    why = "the saved state is of another version of palpate";
    return false;
}

}  // namespace palpate
