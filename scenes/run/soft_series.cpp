#include "scenes/run/soft_series.h"

#include <algorithm>

namespace palpate {

std::vector<std::string> soft_columns() {
    return {"time_s",   "contact_force_N",   "force_x_N", "force_y_N", "force_z_N",
            "area_mm2", "peak_pressure_kPa", "dent_mm",   "converged"};
}

double deepest_dent(const World& w, const SoftObject& o) {
    const Pose<double>& pose = w.shapes[std::size_t(o.object)].pose;
    const std::vector<Point> now = soft_positions(w, o);
    double deepest = 0;
    for (const int i : o.skin.mesh.pad_nodes) {
        const Point &r = o.skin.mesh.nodes[std::size_t(i)], &x = now[std::size_t(i)];
        const Vec3<double> here = inverse_transform(pose, Vec3<double>{x[0], x[1], x[2]});
        deepest = std::max(deepest, norm(here - Vec3<double>{r[0], r[1], r[2]}));
    }
    return deepest;
}

bool has_converged(const World& w, const SoftObject& o) {
    return w.chunks.doubles[std::size_t(o.skin.chunk)].status[std::size_t(o.skin.lane)].converged || w.step == 0;
}

void record_soft_objects(Simulation& s) {
    for (std::size_t k = 0; k < s.soft_series.size(); ++k) {
        const SoftObject& o = s.world.soft.all[k];
        const ContactSurface& c = o.surface;
        double peak = 0;
        for (std::size_t i = 0; i < c.force.size(); ++i) peak = std::max(peak, pressure_on(c, i));
        for (const double v : {s.world.time, c.normal_force, c.total.x, c.total.y, c.total.z, 1e6 * c.touching_area,
                               1e-3 * peak, 1e3 * deepest_dent(s.world, o), double(has_converged(s.world, o))})
            s.soft_series[k].values.push_back(v);
    }
}

}  // namespace palpate
