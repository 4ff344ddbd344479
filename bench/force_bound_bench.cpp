// How much of a geometric match's force error any pose of the device could take away: a grid over the whole workspace,
// and descent from its best poses, at contacts of the scenes; beside what force matching takes away. Errors are sums
// over nodes of |F_i - Fbar_i|, with the pad solved statically against the platform.

#include <benchmark/benchmark.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "engine/build.h"
#include "scenes/run/simulation.h"

namespace palpate {
namespace {

const std::vector<std::string> bound_scenes{"edge", "ball", "soft_ball", "roll"};

struct Rendered {
    Eigen::VectorXd wanted;
    MatchingResult geometric;
};

struct Search {
    ForceMatcher matcher;
    DeviceModel model;
    const Eigen::VectorXd* wanted = nullptr;
    long solves = 0, unconverged = 0;

    /// Errors of these configurations; infinite where the solve did not converge.
    std::vector<double> errors(const std::vector<Coordinates>& all) {
        std::vector<double> out;
        const std::size_t lanes = matcher.lane_w.size();
        for (std::size_t first = 0; first < all.size(); first += lanes) {
            for (std::size_t k = 0; k < lanes; ++k) matcher.lane_w[k] = all[std::min(first + k, all.size() - 1)];
            solve_pads(matcher, model);
            for (std::size_t k = 0; k < lanes && first + k < all.size(); ++k) {
                const auto& c = matcher.chunks[k / std::size_t(matcher.chunks[0].width)];
                const bool converged = c.status[k % std::size_t(c.width)].converged;
                ++solves, unconverged += !converged;
                double sum = 0;
                for (std::ptrdiff_t i = 0; i < wanted->size(); i += 3)
                    sum += (matcher.forces.col(std::ptrdiff_t(k)).segment<3>(i) - wanted->segment<3>(i)).norm();
                out.push_back(converged ? sum : HUGE_VAL);
            }
        }
        return out;
    }
};

/// Distance of the platform's face to the undeformed pad [m]; negative: pressed.
double gap(const DeviceModel& model, const TetMesh& mesh, const Coordinates& w) {
    const Platform p = model.kind->platform(model, w);
    const Eigen::Vector3d normal = model.mount.linear() * p.normal, centre = model.mount * p.centre;
    double least = HUGE_VAL;
    for (int node : mesh.pad_nodes) {
        const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(mesh.nodes[std::size_t(node)].data()) - centre;
        const double height = d.dot(normal);
        if ((d - height * normal).norm() < model.disk_radius) least = std::min(least, height);
    }
    return least;
}

/// The last component moves the platform towards the pad: tilts of a grid, each pressed by 0 to 3 mm.
std::vector<Coordinates> grid(const DeviceModel& model, const TetMesh& mesh, double step) {
    std::vector<Coordinates> all;
    const Coordinates &low = model.kind->configuration_min, &high = model.kind->configuration_max;
    for (double a = low[0]; a <= high[0]; a += step)
        for (double b = low[1]; b <= high[1]; b += step) {
            Coordinates w = model.rest;
            w[0] = a, w[1] = b;
            Coordinates moved = w;
            moved[2] += 1e-4;
            const double here = gap(model, mesh, w), slope = (gap(model, mesh, moved) - here) / 1e-4;
            if (!std::isfinite(here) || std::abs(slope) < 0.1) continue;
            for (double depth = 0.05e-3; depth < 3e-3; depth += 0.1e-3) {
                moved[2] = w[2] + (-depth - here) / slope;
                if (inside_workspace(model, moved, 1e-7)) all.push_back(moved);
            }
        }
    return all;
}

double refine(Search& s, Coordinates w, double error) {
    Coordinates step(3);
    step << 0.02, 0.02, 0.05e-3;
    for (int halvings = 0; halvings < 6;) {
        std::vector<Coordinates> tried;
        for (int k = 0; k < 3; ++k)
            for (double sign : {-1.0, 1.0}) {
                Coordinates moved = w;
                moved[k] += sign * step[k];
                if (inside_workspace(s.model, moved, 1e-7)) tried.push_back(moved);
            }
        const std::vector<double> errors = s.errors(tried);
        const auto best = std::min_element(errors.begin(), errors.end());
        if (best != errors.end() && *best < error) {
            error = *best;
            w = tried[std::size_t(best - errors.begin())];
        } else {
            step *= 0.5, ++halvings;
        }
    }
    return error;
}

void force_bound(benchmark::State& state) {
    const std::string& name = bound_scenes[std::size_t(state.range(0))];
    Scene scene =
        load_scene(PALPATE_SOURCE_DIR "/scenes/" + name + ".toml", {"finger.index.device.method=constrained"});
    const FingerSpec finger = scene.spec.fingers[0];
    Simulation sim = make_simulation(std::move(scene), 2);
    const Matching& m = sim.world.matchings[0];
    const ContactSurface& surface = sim.world.contact_surfaces[0];
    std::vector<Rendered> all;
    while (sim.world.time < sim.scene.duration - 1e-9) {
        advance(sim);
        if (!m.fresh || m.result.status != MatchingStatus::matched || surface.touching == 0) continue;
        Rendered r;
        r.wanted.resize(std::ptrdiff_t(3 * surface.force.size()));
        const Mat3<double> R = rotation_matrix(surface.bone.rotation);
        for (std::size_t i = 0; i < surface.force.size(); ++i) {
            const Vec3<double> f = transposed_times(R, surface.force[i]);
            for (int d = 0; d < 3; ++d) r.wanted[std::ptrdiff_t(3 * i) + d] = f[d];
        }
        r.geometric = m.result;
        all.push_back(std::move(r));
    }
    MatchingSettings settings = m.settings;
    settings.force_norm = ForceNorm::sum;
    ForceMatcher matcher = build_force_matcher(finger, m.model, settings);
    std::vector<Coordinates> matched;
    for (const Rendered& r : all) {
        matcher.wanted = r.wanted;
        matched.push_back(match_forces(matcher, m.model, m.points, settings, m.model.rest, r.geometric).w);
    }
    settings.force_iterations = 60;
    const std::size_t every = std::max<std::size_t>(1, all.size() / 8);
    std::vector<std::array<double, 3>> errors((all.size() + every - 1) / every);
    std::atomic<long> solves{0}, unconverged{0};
    const std::vector<Coordinates> poses = grid(m.model, finger.mesh, 0.06);
    for (auto _ : state)
        oneapi::tbb::parallel_for(std::size_t(0), errors.size(), [&](std::size_t k) {
            const Rendered& r = all[k * every];
            Search s{build_force_matcher(finger, m.model, settings), m.model, &r.wanted};
            const double geometric = s.errors({r.geometric.w})[0], forces = s.errors({matched[k * every]})[0];
            const std::vector<double> of_grid = s.errors(poses);
            std::vector<std::size_t> order(poses.size());
            for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
            std::sort(order.begin(), order.end(), [&](auto a, auto b) { return of_grid[a] < of_grid[b]; });
            double best = std::min(geometric, refine(s, matched[k * every], forces));
            for (std::size_t i = 0; i < std::min<std::size_t>(4, order.size()); ++i)
                best = std::min(best, refine(s, poses[order[i]], of_grid[order[i]]));
            errors[k] = {geometric, forces, best};
            solves += s.solves, unconverged += s.unconverged;
        });
    double geometric = 0, forces = 0, best = 0;
    for (const auto& e : errors) {
        geometric += e[0], forces += e[1], best += e[2];
        std::printf("%-10s geometric %.4f N, force matching %.4f (%.1f %% less), best pose %.4f (%.1f %% less)\n",
                    name.c_str(), e[0], e[1], 100 * (1 - e[1] / e[0]), e[2], 100 * (1 - e[2] / e[0]));
    }
    state.counters["contacts"] = double(errors.size());
    state.counters["poses"] = double(poses.size());
    state.counters["geometric_N"] = geometric / double(errors.size());
    state.counters["matched_less"] = 1 - forces / geometric;
    state.counters["best_less"] = 1 - best / geometric;
    state.counters["unconverged"] = double(unconverged) / double(solves);
    state.SetLabel(name);
}
BENCHMARK(force_bound)->DenseRange(0, int(bound_scenes.size()) - 1)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace palpate
