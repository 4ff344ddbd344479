#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <map>
#include <optional>

#include "engine/skin/solve/solve_skin.h"
#include "scenes/load/key.h"
#include "scenes/program/commands.h"
#include "scenes/program/interruption.h"
#include "scenes/program/progress.h"
#include "scenes/run/simulation.h"

namespace palpate {

namespace {

template <class T>
void explain_chunks(const Simulation& s, const std::vector<SkinChunk<T>>& chunks, const char* precision) {
    for (const SkinChunk<T>& c : chunks) {
        std::vector<std::string> names;
        for (int row : c.finger) {
            const int soft = row - int(s.fingers.size());  // their numbers come after those of fingers
            if (row >= 0)
                names.push_back(soft < 0 ? s.scene.spec.fingers[std::size_t(row)].name
                                         : "object " + s.world.soft.all[std::size_t(soft)].skin.name);
        }
        if (names.empty()) names = {"spare, for fingers that touch while others do not"};
        std::printf("  chunk of %d %s, %s: %s; %zu elements, %d nodes, %zu samples, %d factor blocks, %.2f MB\n",
                    c.width, c.width == 1 ? "lane" : "lanes", precision, joined(names).c_str(),
                    c.topology->elements.size(), c.topology->node_count, c.topology->sample_count(),
                    c.topology->pattern.block_count, double(memory_bytes(c)) / 1e6);
    }
}

void line(bool built, const char* system, const std::string& why) {
    std::printf("%-10s %-16s %s\n", built ? "built" : "not built", system, why.c_str());
}

/// A step of the chunk in which every finger's skin moves, with one iteration and with two [us].
template <class T>
std::array<double, 2> predict_chunk(const SkinChunk<T>& chunk, SolverSettings settings) {
    std::array<double, 2> us{};
    for (int iterations = 1; iterations <= 2; ++iterations) {
        settings.newton_iterations = iterations;
        std::vector<double> times;
        for (int k = 0; k < 15; ++k) {
            SkinChunk<T> c = chunk;
            c.shared_work = -1;  // with memory of its own
            resize_fields(c);
            for (std::size_t i = 0; i < c.state.velocity.size(); ++i) c.state.velocity[i] = T(0.01 * double(i % 7));
            const auto start = std::chrono::steady_clock::now();
            solve_skin(c, settings);
            times.push_back(1e6 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        }
        std::nth_element(times.begin(), times.begin() + 7, times.end());
        us[std::size_t(iterations - 1)] = times[7];
    }
    return us;
}

/// What the dear systems will cost, from single solves of this scene's chunks and matches of its devices.
void predict(Simulation& s) {
    advance(s);  // couplings have aimed
    std::array<double, 2> skin{};
    auto add = [&](const auto& chunks) {
        std::map<std::pair<const SkinTopology*, int>, std::array<double, 2>> known;  // what is alike takes as long
        for (const auto& c : chunks) {
            if (!c.used_lanes) continue;
            auto [us, fresh] = known.try_emplace({c.topology.get(), c.width});
            if (fresh) us->second = predict_chunk(c, s.world.solver);
            for (std::size_t k = 0; k < 2; ++k) skin[k] += us->second[k];
        }
    };
    add(s.world.chunks.doubles);
    add(s.world.chunks.floats);
    const int most = s.world.solver.newton_iterations;
    const double each = std::max(skin[1] - skin[0], 0.0);
    std::printf("\npredicted on this machine, one thread, all fingers moving and none touching [us]:\n");
    std::printf("%-18s %10.1f with one iteration, %.1f more for each further one", "solve_skin", skin[0], each);
    if (most <= 20) std::printf("; %.1f with the %d of these settings", skin[0] + (most - 1) * each, most);
    std::printf("\n");
    double matches = 0;
    int forces = 0;
    for (Matching m : s.world.matchings) {
        forces += m.method == MatchingMethod::force;
        double lowest = 1e300;
        const ContactSurface& surface = *s.world.contact_surfaces.find(m.finger);
        for (const auto& p : surface.position) lowest = std::min(lowest, p.z);
        for (std::size_t i = 0; i < m.points.size(); ++i) {
            const Vec3<double>& p = surface.position[i];
            m.points[i] = {m.model.mount.inverse() * Eigen::Vector3d(p.x, p.y, p.z), p.z < lowest + 1e-3};
        }
        Coordinates w =
            match(m.method, m.model, m.points, m.settings, m.model.rest).w;  // others start from the last one
        const auto start = std::chrono::steady_clock::now();
        for (int k = 0; k < 10; ++k) w = match(m.method, m.model, m.points, m.settings, w).w;
        const double us = 1e5 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        matches += us * std::min(1.0, s.world.solver.dt / m.period);
    }
    if (!s.world.matchings.empty())
        std::printf("%-18s %10.1f a step on average%s\n", "match_devices", matches,
                    forces ? ", and 500 to 800 a finger in each rendering step for the method \"force\"" : "");
}

/// What each system costs in the first second of the scene.
void measure(Simulation& s, const std::atomic<bool>& stop) {
    s.scene.duration = std::min(s.scene.duration, 1.0);
    Progress progress("explain");
    run(s, stop, [&](const StepInputs&, double share) { progress.show(share, s.world.step, s.world.time); });
    progress.clear();
    std::printf("\nmeasured over %zu steps of %.3g ms [us]:\n%-18s %10s %10s\n", s.step_series.rows(),
                1e3 * s.world.solver.dt, "", "mean", "p99");
    for (const std::string& column : s.step_series.columns) {
        if (!column.ends_with("_us")) continue;
        std::vector<double> us = s.step_series.column(column);
        std::sort(us.begin(), us.end());
        double sum = 0;
        for (double v : us) sum += v;
        std::printf("%-18s %10.1f %10.1f\n", column.substr(0, column.size() - 3).c_str(), sum / double(us.size()),
                    us[std::size_t(0.99 * double(us.size() - 1))]);
    }
}

/// What is left out while the scene runs, where it adds little.
void explain_detail(const Simulation& s) {
    const SolverSettings& v = s.world.solver;
    if (v.detail_error <= 0 && v.detail_tolerance <= 0 && v.detail_penetration <= 0)
        return line(false, "  less detail",
                    "all fingers in full, unless asleep: set level_of_detail = \"auto\" in [solver]");
    std::vector<std::string> linear;
    for (std::size_t i = 0; i < s.fingers.size(); ++i)
        if (v.detail_error > 0 && s.scene.spec.fingers[i].material == Material::corotational)
            linear.push_back(s.scene.spec.fingers[i].name);
    char text[160];
    std::snprintf(text, sizeof text, ", while it adds at most %.3g %% of the contact force", 100 * v.detail_error);
    line(
        !linear.empty(), "  linear tissue",
        linear.empty() ? "needs level_of_detail_error above 0 and corotational tissue" : "of " + joined(linear) + text);
    std::snprintf(text, sizeof text, "near nothing, within %.3g mm of its rest shape", 1e3 * v.detail_tolerance);
    line(v.detail_tolerance > 0, "  rigid skin", text);
    if (v.sample_refinement <= 1) return;
    std::snprintf(text, sizeof text, "left out while they would be less than %.3g mm deep", 1e3 * v.detail_penetration);
    line(v.detail_penetration > 0, "  fine samples", text);
}

int explain(const std::string& file, const std::vector<std::string>& overrides, bool measured,
            const std::atomic<bool>& stop) {
    std::optional<EndsAtOnce> loading(std::in_place);
    Simulation s = make_simulation(load_scene(file, overrides), 1);
    loading.reset();
    const SceneSpec& spec = s.scene.spec;
    std::vector<std::string> limited, rubbing, bodies, moving, devices, following;
    for (std::size_t i = 0; i < spec.fingers.size(); ++i) {
        if (spec.fingers[i].has_limits) limited.push_back(spec.fingers[i].name);
        if (s.scene.finger_motions[i].followed_finger >= 0) following.push_back(spec.fingers[i].name);
    }
    for (std::size_t i = 0; i < spec.objects.size(); ++i) {
        if (spec.objects[i].friction > 0) rubbing.push_back(spec.objects[i].name);
        if (!s.scene.object_motions[i].empty()) moving.push_back(spec.objects[i].name);
        if (spec.objects[i].body) bodies.push_back(spec.objects[i].name);
    }
    for (const Matching& m : s.world.matchings) devices.push_back(s.world.skins.find(m.finger)->name);

    std::printf("%s (%s): %zu fingers, %zu objects\n\nThe step, in order:\n", s.scene.title.c_str(), file.c_str(),
                spec.fingers.size(), spec.objects.size());
    line(true, "read_trackers",
         following.empty() ? "poses from the scene's keyframes" : "recorded hand drives " + joined(following));
    line(true, "couple", "each finger's bone behind a viscoelastic coupling");
    line(!spec.objects.empty(), "detect_contacts",
         spec.objects.empty() ? "no [[object]]: add one and fingers can touch it"
                              : std::to_string(spec.objects.size()) + " objects; each finger has those near it");
    line(s.world.finger_pairs.on, "  each other",
         s.world.finger_pairs.on   ? "fingers that come near each other touch"
         : spec.fingers.size() < 2 ? "one finger: there is no other"
                                   : "fingers pass through each other: [contact] fingers = true lets them touch");
    line(true, "solve_skin", "chunks run in parallel:");
    explain_chunks(s, s.world.chunks.doubles, "double");
    explain_chunks(s, s.world.chunks.floats, "float");
    line(!limited.empty(), "  strain limits",
         limited.empty() ? "no [limits]: add limits = { low = 0.6, high = 1.4 }" : "for " + joined(limited));
    line(!rubbing.empty(), "  friction",
         rubbing.empty() ? "no object has friction: add friction = 0.5" : "on " + joined(rubbing));
    line(!moving.empty(), "  moving objects",
         moving.empty() ? "no script moves an object: add [[object.track]] keyframes" : joined(moving));
    explain_detail(s);
    line(!bodies.empty(), "solve_bodies",
         bodies.empty() ? "forces move no object: add mass_g to one" : joined(bodies) + ", with the fingers near them");
    line(true, "extract_contact", "touching samples, forces and area per pad");
    const bool wanted = !spec.thimbles.empty();
    line(!devices.empty(), "match_devices",
         !devices.empty() ? "for " + joined(devices)
         : wanted         ? "devices are named, but nothing can be touched: add an [[object]]"
                          : "no finger has a device: add device = { kind = \"chinello-3rrs\" }");
    line(!s.loops.empty(), "publish",
         s.loops.empty() ? "no thimble"
                         : "mailboxes of " + std::to_string(s.loops.size()) + " simulated thimbles, ticked every " +
                               std::to_string(int(1e3 * s.scene.loop.period + 0.5)) + " ms");
    std::printf("\nmemory of all skins: %.2f MB\n", double(skin_memory_bytes(s.world)) / 1e6);
    for (std::size_t i = 0; i < spec.fingers.size(); ++i)
        std::printf("%s: %s\n", spec.fingers[i].name.c_str(), s.scene.mesh_notes[i].c_str());
    predict(s);
    if (measured) {
        Simulation fresh = make_simulation(load_scene(file, overrides), 1);
        measure(fresh, stop);
    }
    return 0;
}

}  // namespace

Action add_explain_command(const Command& program, const std::atomic<bool>& stop) {
    struct Arguments {
        std::string scene;
        std::vector<std::string> overrides;
        bool measured = false;
    };
    const Command c = program.subcommand("explain", "say what a scene builds, for whom and why");
    auto a = std::make_shared<Arguments>();
    c.scene("scene", a->scene, "scene file (.toml) or bare name").required();
    c.option("--set", a->overrides, "override a value of the scene").repeatable();
    c.flag("--measure", a->measured, "also run its first second, and say what each system costs (one thread)");
    return [a, &stop] { return explain(a->scene, a->overrides, a->measured, stop); };
}

}  // namespace palpate
