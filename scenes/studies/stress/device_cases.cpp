// Extremes of matching: places where a device has no good answer.

#include <cmath>
#include <random>

#include "devices/matching/matching.h"
#include "scenes/studies/stress/cases.h"

namespace palpate::stress {

namespace {

using Eigen::Vector3d;

/// A patch of touching points about a place, and others beside it.
std::vector<MatchingPoint> patch(const Vector3d& centre, const Vector3d& normal, std::mt19937& random) {
    std::uniform_real_distribution<double> u(-1, 1);
    const Vector3d a = normal.unitOrthogonal(), b = normal.cross(a);
    std::vector<MatchingPoint> points;
    for (int i = 0; i < 33; ++i) {
        const double r = i < 14 ? 0.004 : 0.009;
        points.push_back({centre + r * u(random) * a + r * u(random) * b + (i < 14 ? 0 : 0.002) * normal, i < 14});
    }
    return points;
}

}  // namespace

/// S11
StressOutcome hard_matches(int effort, const std::atomic<bool>& stop) {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> u(-1, 1);
    long tried = 0, outside = 0, worse = 0, not_finite = 0, most = 0;
    std::string where;
    for (const std::string& kind : kind_names())
        for (const char* name : {"level", "edge", "unreachable", "flat", "equal bounds"}) {
            const std::string what = name;
            DeviceModel model = find_kind(kind)->defaults();
            const Vector3d seat(0, 0, model.kind->seat_height);
            // Equal bounds: the first joint cannot move at all from where it rests.
            if (what == "equal bounds")
                model.joint_min[0] = model.joint_max[0] = model.kind->joints(model, model.rest).q[0];
            Coordinates last = model.rest;
            for (int k = 0; k < 40 * effort && !stop; ++k) {
                std::vector<MatchingPoint> points;
                const double tilt = what == "edge" ? 0.8 * std::sin(0.05 * k) : what == "level" ? 0 : 1.5 * u(random);
                const Vector3d normal(std::sin(tilt), 0.3 * std::sin(tilt), -std::cos(tilt));
                Vector3d centre = seat;
                if (what == "unreachable") centre += 0.05 * Vector3d(u(random), u(random), u(random));
                points = patch(centre, normal.normalized(), random);
                if (what == "flat")  // one point, far away: any tilt serves as well as any other
                    for (std::size_t i = 1; i < points.size(); ++i)
                        points[i].touches = false, points[i].position.z() += 10;
                for (int method = 0; method < 4; ++method) {
                    MatchingSettings settings;
                    if (method == 3) settings.solver = MatchingSolver::least_squares;
                    const auto m = method == 3 ? MatchingMethod::constrained : MatchingMethod(method);
                    const MatchingResult r = match(m, model, points, settings, last);
                    ++tried;
                    most = std::max<long>(most, r.evaluations);
                    const bool finite = r.w.allFinite() && r.q.allFinite();
                    not_finite += !finite;
                    if (!finite) continue;
                    outside += joint_margins(model, r.q).minCoeff() < 0 || !inside_workspace(model, r.w, 1e-6);
                    if (m == MatchingMethod::constrained) {
                        const double before = matching_objective(model, points, settings, last, last).value;
                        const bool is_worse = r.residual > before * (1 + 1e-9) + 1e-12;
                        worse += is_worse;
                        if (is_worse) where = "; worse: " + kind + ", " + what;
                    }
                    if (method == 0) last = r.w;
                }
            }
        }
    return {outside == 0 && worse == 0 && not_finite == 0 && most <= 200,
            text("%ld matches of seven kinds, level, at the edge, out of reach, one far point, a joint that cannot "
                 "move: %ld outside, %ld worse than the last, %ld not finite, at most %ld evaluations",
                 tried, outside, worse, not_finite, most) +
                where};
}

}  // namespace palpate::stress
