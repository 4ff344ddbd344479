#include "devices/loop/loop.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "devices/matching/platform_force.h"

namespace palpate {

std::vector<std::string> SlewLimits::validate() const {
    std::vector<std::string> wrong;
    check(velocity, slew_bounds::velocity, "the slew velocity", " rad/s", wrong);
    check(acceleration, slew_bounds::acceleration, "the slew acceleration", " rad/s^2", wrong);
    return wrong;
}

const char* name(ThimbleMode mode) {
    switch (mode) {
        case ThimbleMode::following:
            return "following";
        case ThimbleMode::holding:
            return "holding";
        case ThimbleMode::resting:
            return "resting";
        case ThimbleMode::fault:
            return "fault";
    }
    return "unknown";
}

namespace {

/// Largest speed for this period after which braking by A = `acceleration` dt per period still ends
/// within `distance`: the periods' speeds v, v - A, v - 2A, ... must add up to no more than distance / dt.
double braking_speed(double distance, double acceleration, double dt) {
    const double A = acceleration * dt, D = distance / dt;
    const double m = std::floor(std::sqrt(0.25 + 2 * D / A) - 0.5);
    return m * A + std::max(0.0, D - A * m * (m + 1) / 2) / (m + 1);
}

/// Commands come as often as ticks, at a phase of their own. Ticks are moved to shortly after they come, so that what a
/// finger feels is a few milliseconds old and not up to a period: once by a longer period, then by little. A command
/// that misses its tick waits for a period, so they come after nearly all steps: how long these take is learned,
/// upwards in steps that no single delay makes large.
void keep_pace(ThimbleLoop& loop, double waited, double step_took) {
    constexpr double up = 0.5e-3, down = 0.02;
    loop.latency.add(waited);
    const double period = loop.settings.period, longer = step_took - loop.step_takes;
    if (step_took > 0)
        loop.step_takes =
            std::min(loop.step_takes + (longer > 0 ? std::min(longer, up) : down * longer), 0.25 * period);
    const double late = waited - loop.step_takes - loop.settings.command_wait;
    if (late > 0.25 * period)
        loop.next_tick += period - std::fmod(late, period);
    else
        loop.next_tick -= std::clamp(0.2 * late, -0.02 * period, 0.02 * period);
}

}  // namespace

int limit_command(const Coordinates& target, const Coordinates& min, const Coordinates& max, const SlewLimits& limits,
                  double dt, Coordinates& q, Coordinates& velocity) {
    int altered = 0;
    for (int i = 0; i < q.size(); ++i) {
        if (!std::isfinite(q[i])) q[i] = 0.5 * (min[i] + max[i]), velocity[i] = 0;  // memory was damaged
        if (!std::isfinite(velocity[i])) velocity[i] = 0;
        const bool usable = i < target.size() && std::isfinite(target[i]);
        const double wanted = usable ? std::clamp(target[i], min[i], max[i]) : std::clamp(q[i], min[i], max[i]);
        if (!usable || wanted != target[i]) ++altered;
        const double distance = std::abs(wanted - q[i]);
        const double speed =
            std::min({limits.velocity, braking_speed(distance, limits.acceleration, dt), distance / dt});
        const double v = std::clamp(std::copysign(speed, wanted - q[i]), velocity[i] - limits.acceleration * dt,
                                    velocity[i] + limits.acceleration * dt);
        // From out of range, where it may have been found, it comes back as slowly, and goes no farther out.
        const double next = std::clamp(q[i] + std::clamp(v, -limits.velocity, limits.velocity) * dt,
                                       std::min(min[i], q[i]), std::max(max[i], q[i]));
        velocity[i] = (next - q[i]) / dt;
        q[i] = next;
    }
    return altered;
}

void initialise(ThimbleLoop& loop, const DeviceModel& model, const ThimbleLoopSettings& settings,
                std::unique_ptr<Driver> driver) {
    std::vector<std::string> wrong = validate(model);
    for (auto& w : settings.limits.validate()) wrong.push_back(w);
    if (!(settings.period >= 0.001 && settings.period <= 1))
        wrong.emplace_back("the period must be between 1 and 1000 ms");
    if (!driver) wrong.emplace_back("a thimble needs a driver");
    if (!wrong.empty()) {
        std::string all;
        for (const auto& w : wrong) all += w + "\n";
        throw std::invalid_argument(all);
    }
    loop.model = model;
    loop.settings = settings;
    loop.driver = std::move(driver);
    loop.rest_q = model.kind->joints(model, model.rest).q;
    loop.q = loop.rest_q;
    loop.velocity = Coordinates::Zero(loop.q.size());
}

bool use_force_mode(ThimbleLoop& loop) {
    const Coordinates rest = torques_for_force(loop.model, loop.model.rest, loop.model.max_force);
    loop.largest_torque = largest_torques(loop.model);
    loop.moving_torque = limit_torque(ForceModeSettings{}.moving_share * rest.cwiseAbs(), loop.largest_torque);
    loop.torque = loop.moving_torque;
    return loop.driver->limit_torque(loop.torque);
}

namespace {

/// The next tick's time; ticks that were missed are counted.
void schedule(ThimbleLoop& loop, double now) {
    const double period = loop.settings.period;
    ThimbleStatus& s = loop.status;
    // Ticks come up to 1 ns early.
    const double lateness = s.ticks ? std::max(0.0, now - loop.next_tick) : 0, missed = std::floor(lateness / period);
    s.worst_lateness = std::max(s.worst_lateness, lateness);
    s.misses += std::int64_t(missed);
    loop.next_tick = (s.ticks ? loop.next_tick + missed * period : now) + period;
    ++s.ticks;
}

/// Clears a fault for a while after it was asked for: a controller takes a moment to become active.
void rearm_if_asked(ThimbleLoop& loop, double now) {
    constexpr double patience = 0.5;
    if (loop.rearm_asked.exchange(false)) loop.rearm_until = now + patience;
    if (now >= loop.rearm_until) return;
    if (loop.status.mode != ThimbleMode::fault || rearm(loop, now)) loop.rearm_until = -1;
}

/// A command that comes just after its tick would wait for a period: where one is due, the tick waits a little for it.
bool awaits_command(ThimbleLoop& loop, double now) {
    constexpr double patience = 0.2, look_again = 0.25e-3;
    const double period = loop.settings.period;
    loop.has_come |= loop.mailbox.take(loop.incoming);
    const bool due = loop.status.mode == ThimbleMode::following && !loop.parked &&
                     std::abs(loop.commands_every - period) < patience * period;
    const double longer = now + look_again - loop.next_tick;
    if (loop.has_come || !due || loop.awaited + longer > patience * period) return false;
    loop.awaited += longer;
    loop.next_tick += longer;
    return true;
}

void take_command(ThimbleLoop& loop, double now) {
    if (const bool let_go = loop.let_go; let_go != loop.was_let_go) {
        loop.was_let_go = let_go;
        if (!let_go) loop.easing_since = now;  // as after arming
    }
    const ThimbleCommand& command = loop.incoming;
    const bool came = std::exchange(loop.has_come, false) && command.valid && command.q.size() == loop.q.size();
    if (came && !loop.was_let_go) {
        // Without contact the rest pose is commanded. The first approach to one may have a limit of its own, until the
        // platform has got there.
        const bool contact = (command.q - loop.rest_q).cwiseAbs().maxCoeff() > 1e-6;
        if (contact && !loop.in_contact) loop.touching_down = loop.settings.touch_velocity > 0;
        loop.in_contact = contact;
        const PoseStamps::Times times = loop.pose_stamps.of(command.sampled_at);
        loop.pose_at = times.arrived_at;
        loop.commands_every = command.sampled_at - loop.newest.sampled_at;
        loop.newest = command;
        loop.newest_at = now;
        if (command.sampled_at > 0) keep_pace(loop, now - command.sampled_at, times.done_at - command.sampled_at);
    }
    loop.status.age = loop.newest.valid ? now - loop.newest_at : HUGE_VAL;
}

void choose_mode(ThimbleLoop& loop) {
    ThimbleStatus& s = loop.status;
    if (s.mode == ThimbleMode::fault) return;
    const ThimbleMode wanted = loop.parked || s.age > loop.settings.rest_after ? ThimbleMode::resting
                               : s.age > loop.settings.hold_after              ? ThimbleMode::holding
                                                                               : ThimbleMode::following;
    if (!loop.parked && wanted != ThimbleMode::following && s.mode == ThimbleMode::following) ++s.stale;
    s.mode = wanted;
}

/// One period towards where the mode wants the joints.
void move(ThimbleLoop& loop, double now) {
    constexpr double longest_first_move = 3, there = 1e-3;
    const ThimbleMode mode = loop.status.mode;
    const Coordinates target = mode == ThimbleMode::following ? loop.newest.q
                               : mode == ThimbleMode::resting ? loop.rest_q
                                                              : loop.q;
    SlewLimits limits = loop.settings.limits;
    if (loop.easing_since >= 0) limits.velocity = std::min(limits.velocity, loop.settings.first_velocity);
    if (loop.touching_down) limits.velocity = std::min(limits.velocity, loop.settings.touch_velocity);
    loop.status.altered += limit_command(target, loop.model.joint_min, loop.model.joint_max, limits,
                                         loop.settings.period, loop.q, loop.velocity);
    const bool arrived =
        target.size() == loop.q.size() &&
        (loop.q - target.cwiseMax(loop.model.joint_min).cwiseMin(loop.model.joint_max)).cwiseAbs().maxCoeff() < there;
    if (arrived && mode == ThimbleMode::following) loop.touching_down = false;
    if (loop.easing_since >= 0 && (arrived || now - loop.easing_since > longest_first_move)) loop.easing_since = -1;
}

void send_torque(ThimbleLoop& loop) {
    const ThimbleMode mode = loop.status.mode;
    if (loop.torque.size() == 0 || mode == ThimbleMode::fault) return;
    const bool commanded = mode == ThimbleMode::following && loop.newest.torque.size() == loop.torque.size();
    if (mode != ThimbleMode::holding)
        loop.torque = limit_torque(commanded ? loop.newest.torque : loop.moving_torque, loop.largest_torque);
    loop.driver->limit_torque(loop.torque);
}

}  // namespace

bool tick(ThimbleLoop& loop, double now) {
    if (now < loop.next_tick - 1e-9 || awaits_command(loop, now)) return false;
    loop.awaited = 0;
    ThimbleStatus& s = loop.status;
    schedule(loop, now);
    rearm_if_asked(loop, now);
    take_command(loop, now);
    choose_mode(loop);
    move(loop, now);
    send_torque(loop);
    const double pose_at = s.mode == ThimbleMode::following ? loop.pose_at : 0;
    if (s.mode != ThimbleMode::fault && loop.driver->send(loop.q, now, pose_at) == DriverStatus::fault) {
        s.mode = ThimbleMode::fault;  // latched until rearm
        ++s.faults;
    }
    loop.reports.publish({loop.q, loop.driver->actual(now), s, loop.torque, loop.driver->command_age()});
    return true;
}

void park(ThimbleLoop& loop) { loop.parked = true; }

double time_to_rest(const ThimbleLoop& loop) {
    const double in_range = (loop.model.joint_max - loop.model.joint_min).maxCoeff(),
                 farthest = std::max(in_range, (loop.q - loop.rest_q).cwiseAbs().maxCoeff());
    const double speed = std::min(loop.settings.first_velocity, loop.settings.limits.velocity);
    return farthest / speed + 2 * speed / loop.settings.limits.acceleration;
}

bool at_rest(const ThimbleLoop& loop) { return (loop.q - loop.rest_q).cwiseAbs().maxCoeff() < 1e-6; }

bool rearm(ThimbleLoop& loop, double now) {
    if (!loop.driver->rearm()) return false;
    const Coordinates actual = loop.driver->actual(now);
    if (actual.size() == loop.q.size() && actual.allFinite()) loop.q = actual;
    loop.velocity.setZero();
    loop.newest = {};
    loop.in_contact = loop.touching_down = false;
    loop.easing_since = now;
    loop.status.mode = ThimbleMode::resting;
    return true;
}

}  // namespace palpate
