#include "scenes/run/simulation.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "meshes/input_error.h"
#include "meshes/plain_numbers.h"
#include "scenes/run/finger_output.h"
#include "scenes/run/grasp.h"
#include "scenes/run/hardware.h"
#include "scenes/run/soft_series.h"

namespace palpate {

namespace {

const std::vector<std::string> finger_columns{
    "time_s",           "contact_force_N",   "force_x_N",          "force_y_N",           "force_z_N",
    "contact_area_mm2", "touching_samples",  "coupling_force_N",   "bone_x_mm",           "bone_y_mm",
    "bone_z_mm",        "newton_iterations", "multiplier_updates", "converged",           "residual_N",
    "limit_violation",  "limited_elements",  "penetration_um",     "fixed_penetration_um"};
/// Of a thimble: its configuration, joint angles wanted, sent and reached, and how well it matches.
std::vector<std::string> thimble_columns(const DeviceKind& kind) {
    std::vector<std::string> columns;
    for (std::size_t i = 0; i < kind.configuration_names.size(); ++i)
        columns.push_back(kind.configuration_names[i] + (kind.configuration_is_length[i] ? "_mm" : "_deg"));
    for (const char* what : {"q", "sent", "servo"})
        for (int j = 1; j <= kind.joint_count; ++j) columns.push_back(what + std::to_string(j) + "_deg");
    for (const char* column : {"matching_rms_mm", "constraint_active", "contact_matched", "commanded_force_N"})
        columns.emplace_back(column);
    return columns;
}
/// After these: new columns come at the end, where no reader counts.
const std::vector<std::string> output_columns{"torque_x_Nm", "torque_y_Nm", "torque_z_Nm",      "centre_x_mm",
                                              "centre_y_mm", "centre_z_mm", "bone_qw",          "bone_qx",
                                              "bone_qy",     "bone_qz",     "pressure_peak_kPa"};
const std::vector<std::string> step_columns = [] {
    std::vector<std::string> columns{"time_s"};
    for (const auto& [name, seconds] : step_systems) columns.push_back(std::string(name) + "_us");
    columns.push_back("total_us");
    return columns;
}();
constexpr double degrees = 57.29577951308232;

int thimble_of(const World& world, EntityId finger) {
    for (std::size_t row = 0; row < world.matchings.size(); ++row)
        if (world.matchings[row].finger == finger) return int(row);
    return -1;
}

void record_thimble(const Matching& m, const ThimbleReport& seen, std::vector<double>& out) {
    const DeviceKind& kind = *m.model.kind;
    for (std::ptrdiff_t i = 0; i < m.result.w.size(); ++i)
        out.push_back(m.result.w[i] * (kind.configuration_is_length[std::size_t(i)] ? 1e3 : degrees));
    for (const Coordinates* q : std::array<const Coordinates*, 3>{&m.result.q, &seen.sent, &seen.actual})
        for (int k = 0; k < kind.joint_count; ++k) out.push_back((*q)[k] * degrees);
    out.push_back(1e3 * m.result.rms_m);
    out.push_back(m.result.constraint_active);
    out.push_back(m.result.status != MatchingStatus::no_contact);
    out.push_back(m.force_N);
}

void record_finger(Simulation& s, std::size_t i) {
    const World& w = s.world;
    const EntityId finger = s.fingers[i];
    const ContactSurface& c = *w.contact_surfaces.find(finger);
    const SkinStatus& status = skin_status(w, finger);
    const Pose<double> bone = bone_pose(w, finger);
    const double fixed = fixed_skin_depth(s.fixed_skins[i], bone, w.shapes);
    std::vector<double>& out = s.finger_series[i].values;
    for (double v : {w.time, c.normal_force, c.total.x, c.total.y, c.total.z, 1e6 * c.touching_area, double(c.touching),
                     w.couplings.find(finger)->force_N, 1e3 * bone.position.x, 1e3 * bone.position.y,
                     1e3 * bone.position.z, double(status.newton_iterations), double(status.multiplier_updates),
                     double(status.converged), status.residual_N, status.limit_violation,
                     double(status.limited_elements), 1e6 * status.penetration_m, 1e6 * fixed})
        out.push_back(v);
    const int t = thimble_of(w, finger);
    ThimbleReport seen = t < 0        ? ThimbleReport{}
                         : s.hardware ? newest_report(*s.hardware, t)
                                      : ThimbleReport{{}, s.loops[t]->driver->actual(w.time), {}};
    if (t >= 0) seen.sent = sent_angles(s, std::size_t(t));
    if (t >= 0) record_thimble(w.matchings[t], seen, out);
    const FingerOutput felt = finger_output(c);
    for (double v : {felt.torque.x, felt.torque.y, felt.torque.z}) out.push_back(v);
    for (double v : {felt.centre.x, felt.centre.y, felt.centre.z}) out.push_back(1e3 * v);
    for (double v : {bone.rotation.w, bone.rotation.x, bone.rotation.y, bone.rotation.z}) out.push_back(v);
    out.push_back(1e-3 * felt.pressure_peak);
    if (s.hardware && s.finger_series[i].columns.back() == "command_age_ms") out.push_back(1e3 * seen.command_age);
}

/// One row of every series.
void record(Simulation& s, const StepInputs& inputs) {
    for (std::size_t i = 0; i < s.fingers.size(); ++i) record_finger(s, i);
    record_bodies(s);
    record_soft_objects(s);
    const StepProfile& p = s.world.profile;
    s.step_series.values.push_back(s.world.time);
    for (const auto& [name, seconds] : step_systems) s.step_series.values.push_back(1e6 * (p.*seconds));
    s.step_series.values.push_back(1e6 * p.total());
    if (s.governor) s.step_series.values.push_back(inputs.preset);
}

/// When the tracked poses of this step had come: of two hands, the older ones. 0 where a hand is not seen.
double oldest_arrival(const Simulation& s) {
    double oldest = HUGE_VAL;
    for (const FingerMotion& motion : s.scene.finger_motions)
        if (motion.followed_finger >= 0) oldest = std::min(oldest, s.live->mailbox.arrived_at(motion.hand));
    return std::isfinite(oldest) ? oldest : 0;
}

}  // namespace

Simulation::Simulation() = default;
Simulation::~Simulation() = default;
Simulation::Simulation(Simulation&&) noexcept = default;
Simulation& Simulation::operator=(Simulation&&) noexcept = default;

namespace {

/// Memory for the tables of the scene's whole duration, of which half the machine's is the most: steps in real time
/// shall not wait for all that came before to be moved. Says where more would be needed.
void reserve_series(Simulation& s) {
    const double steps = std::ceil(s.scene.duration / s.scene.spec.solver.dt) + 2,
                 memory = double(::sysconf(_SC_PHYS_PAGES)) * double(::sysconf(_SC_PAGESIZE));
    std::vector<Series*> all{&s.step_series};
    for (std::vector<Series>* of : {&s.finger_series, &s.body_series, &s.soft_series})
        for (Series& series : *of) all.push_back(&series);
    const auto numbers = [](const Series& series) { return series.columns.size() + 1; };  // armed: age of commands, too
    double row = 0;
    for (const Series* series : all) row += double(sizeof(double) * numbers(*series));
    const double rows = std::min(steps, 0.5 * memory / row);
    if (rows < steps) {
        PlainText text;
        text.precision(3);
        text
            << "duration_s: the tables of " << steps << " steps take " << 1e-9 * steps * row << " GB of memory, of "
            << 1e-9 * memory
            << " that this machine has; a shorter duration_s or a longer dt_ms takes less, and palpate view keeps none";
        s.scene.warnings.push_back(text.str());
    }
    for (Series* series : all) series->values.reserve(std::size_t(rows) * numbers(*series));
}

void prepare_series(Simulation& s) {
    for (const EntityId finger : s.fingers) {
        Series series{finger_columns, {}};
        if (const int t = thimble_of(s.world, finger); t >= 0)
            for (auto& column : thimble_columns(*s.world.matchings[std::size_t(t)].model.kind))
                series.columns.push_back(std::move(column));
        series.columns.insert(series.columns.end(), output_columns.begin(), output_columns.end());
        s.finger_series.push_back(std::move(series));
    }
    for (std::size_t b = 0; b < s.world.bodies.size(); ++b) s.body_series.push_back({body_columns(s), {}});
    for (std::size_t k = 0; k < s.world.soft.all.size(); ++k) s.soft_series.push_back({soft_columns(), {}});
    s.step_series.columns = step_columns;
    if (s.governor) s.step_series.columns.emplace_back("preset");
    if (s.keeps_series) reserve_series(s);
}

}  // namespace

Simulation make_simulation(Scene scene, int threads, bool keeps_series) {
    Simulation s;
    s.keeps_series = keeps_series;
    s.scene = std::move(scene);
    s.world = build_world(s.scene.spec);
    s.threads = std::make_unique<Threads>(threads);
    for (std::size_t row = 0; row < s.world.skins.size(); ++row) s.fingers.push_back(s.world.skins.owner(row));
    for (std::size_t row = 0; row < s.world.matchings.size(); ++row) {
        auto loop = std::make_unique<ThimbleLoop>();
        const DeviceModel& model = s.world.matchings[row].model;
        const Coordinates rest = model.kind->joints(model, model.rest).q;
        initialise(*loop, model, s.scene.loop, make_simulated_driver(s.scene.servo, rest));
        if (s.world.matchings[row].force_mode) use_force_mode(*loop);
        s.world.device_links[row].mailbox = &loop->mailbox;
        s.world.device_links[row].silence = s.scene.tracker_timeout;
        s.loops.push_back(std::move(loop));
    }
    s.finger_counts.assign(s.fingers.size(), {});
    for (const EntityId finger : s.fingers) s.fixed_skins.push_back(fixed_skin_of(s.world.skins.find(finger)->mesh));
    s.last_grips.resize(s.world.bodies.size() * s.fingers.size());
    if (s.scene.deadline > 0) s.governor = make_governor(s.scene.deadline, s.scene.preset, s.world.solver);
    prepare_series(s);
    return s;
}

StepInputs next_inputs(const Simulation& s) {
    StepInputs inputs;
    next_inputs(s, inputs);
    return inputs;
}

void next_inputs(const Simulation& s, StepInputs& inputs) {
    const double next = s.world.time + s.world.solver.dt;
    inputs.fingers.clear(), inputs.objects.clear();
    inputs.preset = s.governor ? s.governor->preset : -1;
    inputs.cuts.reset();
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const FingerMotion& motion = s.scene.finger_motions[i];
        if (!s.live || motion.followed_finger < 0) {
            inputs.fingers.push_back(tracked_pose(s.scene, int(i), next));
            continue;
        }
        inputs.fingers.push_back(placed(s.scene, int(i), s.live->mailbox.newest(motion.hand, motion.followed_finger)));
        inputs.fingers.back().time = next;
    }
    for (std::size_t i = 0; i < s.world.shapes.size(); ++i) {
        const bool moves = i < s.scene.object_motions.size() && !s.scene.object_motions[i].empty();
        inputs.objects.push_back(moves ? trajectory_pose(s.scene.object_motions[i], next) : s.world.shapes[i].pose);
    }
}

void follow_live(Simulation& s, std::shared_ptr<LiveHands> live) {
    const auto& motions = s.scene.finger_motions;
    if (std::none_of(motions.begin(), motions.end(), [](const auto& m) { return m.followed_finger >= 0; }))
        throw InputError(s.scene.file.string() +
                         ": no finger follows a hand (follow = \"index\"); see scenes/recorded_hand.toml");
    s.live = std::move(live);
    if (!s.pace) s.pace.emplace().due = device_clock();
}

void advance(Simulation& s) { advance(s, next_inputs(s)); }

void advance(Simulation& s, const StepInputs& inputs) {
    World& w = s.world;
    for (std::size_t i = 0; i < s.fingers.size(); ++i)
        w.tracker_poses.find(w.couplings.find(s.fingers[i])->tracker)->incoming = inputs.fingers[i];
    for (std::size_t i = 0; i < w.shapes.size(); ++i)
        if (w.shapes[i].body < 0) w.shapes[i].pose = inputs.objects[i];
    if (s.governor && inputs.preset >= 0) w.solver = settings_of(*s.governor, inputs.preset);
    w.deadline.limit = s.governor && !inputs.cuts ? s.governor->deadline : 0;
    if (inputs.cuts)
        w.deadline.given = *inputs.cuts;
    else
        w.deadline.given.clear();
    if (s.hardware) {
        w.sampled_at = device_clock();
        const double arrived_at = s.live ? oldest_arrival(s) : w.sampled_at;
        for (auto& loop : s.loops) loop->pose_stamps.add(w.sampled_at, arrived_at);
    }
    step(w, *s.threads);
    if (s.hardware)
        for (auto& loop : s.loops) loop->pose_stamps.done(device_clock());
    count_detail(w, s.detail);
    if (s.governor) {
        const bool cut_short = std::any_of(s.fingers.begin(), s.fingers.end(),
                                           [&](EntityId finger) { return skin_status(w, finger).cut_short; });
        govern(*s.governor, w.profile.total(), cut_short);
    }
    if (!s.hardware)
        for (auto& loop : s.loops) tick(*loop, w.time);
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const SkinStatus& status = skin_status(w, s.fingers[i]);
        FingerCounts& counts = s.finger_counts[i];
        counts.resets += status.reset;
        counts.wrong_side_steps += status.wrong_sides > 0;
        counts.extended_steps += status.extra_iterations > 0;
        counts.cut_short_steps += status.cut_short;
        counts.uphill_steps += status.uphill_steps;
    }
    if (s.keeps_series) record(s, inputs);
}

void run(Simulation& s, const std::atomic<bool>& stop, const std::function<void(const StepInputs&, double)>& after_step,
         const std::function<void(StepInputs&)>& before_step) {
    const auto steps = std::int64_t(std::llround(s.scene.duration / s.world.solver.dt));
    for (std::int64_t k = 0; k < std::max<std::int64_t>(1, steps) && !stop; ++k) {
        StepInputs inputs = next_inputs(s);
        if (before_step) before_step(inputs);
        advance(s, inputs);
        if (after_step) after_step(inputs, double(k + 1) / double(steps));
        if (s.pace) wait_for_real_time(*s.pace, s.world.solver.dt);
    }
    if (s.hardware) return disarm(s);
    for (auto& loop : s.loops) park(*loop);
    // Half a second more for the thimbles alone, to reach their rest pose.
    for (double t = s.world.time; t < s.world.time + s.scene.loop.rest_within; t += 0.25 * s.scene.loop.period)
        for (auto& loop : s.loops) tick(*loop, t);
}

}  // namespace palpate
