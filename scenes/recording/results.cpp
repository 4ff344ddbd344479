#include "scenes/recording/results.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"
#include "meshes/plain_numbers.h"
#include "scenes/load/result_files.h"
#include "scenes/recording/live_tables.h"
#include "scenes/recording/svg.h"
#include "scenes/run/stretches.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {

/// Tissue as it is now: where it is, what presses on it, and how it is stretched.
void write_tissue(const fs::path& path, TetMesh mesh, const ContactSurface& contact, const Pose<double>& bone,
                  const std::vector<Point>& now, const std::vector<Vec3<double>>& reactions) {
    const std::size_t n = mesh.nodes.size();
    VtuField displacement{"displacement_mm", 3, {}}, force{"contact_force_N", 3, std::vector<double>(3 * n)},
        pressure{"contact_pressure_kPa", 1, std::vector<double>(n)}, region{"region", 1, std::vector<double>(n)},
        low{"stretch_min", 1, {}}, high{"stretch_max", 1, {}};
    for (std::size_t i = 0; i < n; ++i) {
        const Point& r = mesh.nodes[i];
        const Vec3<double> rest = transform(bone, Vec3<double>{r[0], r[1], r[2]});
        for (int d = 0; d < 3; ++d) displacement.values.push_back(1e3 * (now[i][d] - rest[d]));
    }
    VtuField reaction{"bone_reaction_N", 3, {}};
    for (const Vec3<double>& f : reactions)
        for (int d = 0; d < 3; ++d) reaction.values.push_back(f[d]);
    for (int i : mesh.bone_nodes) region.values[i] = 1;
    for (std::size_t s = 0; s < mesh.pad_nodes.size(); ++s) {
        const int i = mesh.pad_nodes[s];
        region.values[i] = 2;
        for (int d = 0; d < 3; ++d) force.values[3 * i + d] = contact.force[s][d];
        pressure.values[i] = 1e-3 * pressure_on(contact, s);
    }
    for (const auto& t : mesh.tets) {
        const Vec3<double> sigma = principal_stretches(corners(mesh.nodes, t), corners(now, t));
        low.values.push_back(sigma.z);
        high.values.push_back(sigma.x);
    }
    mesh.nodes = now;
    write_vtu(path, mesh, {displacement, force, reaction, pressure, region}, {low, high});
}

/// A soft object, as a pad is written.
void write_soft(const fs::path& path, const World& world, const SoftObject& o) {
    const SkinChunk<double>& c = world.chunks.doubles[std::size_t(o.skin.chunk)];
    std::vector<Vec3<double>> held(o.skin.mesh.nodes.size(), {0, 0, 0});
    if (active_lanes(c) != 0)  // otherwise nothing pulls at it; a soft object is alone in its chunk
        for (const int node : o.skin.mesh.bone_nodes)
            for (int d = 0; d < 3; ++d) held[std::size_t(node)][d] = c.scratch.gradient[std::size_t(3 * node + d)];
    write_tissue(path, o.skin.mesh, o.surface, world.shapes[std::size_t(o.object)].pose, soft_positions(world, o),
                 held);
}

}  // namespace

void write_pad(const fs::path& path, const World& world, EntityId finger) {
    write_tissue(path, world.skins.find(finger)->mesh, *world.contact_surfaces.find(finger), bone_pose(world, finger),
                 finger_positions(world, finger), bone_reactions(world, finger));
}

void write_nodes(const fs::path& path, const World& world, EntityId finger) {
    const TetMesh& mesh = world.skins.find(finger)->mesh;
    const ContactSurface& contact = *world.contact_surfaces.find(finger);
    const Pose<double> bone = bone_pose(world, finger);
    const std::vector<Point> now = finger_positions(world, finger);
    const std::vector<Vec3<double>> reaction = bone_reactions(world, finger);
    std::vector<Vec3<double>> force(mesh.nodes.size(), {0, 0, 0});
    for (std::size_t s = 0; s < mesh.pad_nodes.size(); ++s) force[mesh.pad_nodes[s]] = contact.force[s];
    Series series{{"node", "rest_x_mm", "rest_y_mm", "rest_z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "contact_x_N",
                   "contact_y_N", "contact_z_N", "reaction_x_N", "reaction_y_N", "reaction_z_N"},
                  {}};
    for (std::size_t i = 0; i < mesh.nodes.size(); ++i) {
        const Point& r = mesh.nodes[i];
        const Vec3<double> rest = transform(bone, Vec3<double>{r[0], r[1], r[2]});
        series.values.push_back(double(i));
        for (int d = 0; d < 3; ++d) series.values.push_back(1e3 * rest[d]);
        for (int d = 0; d < 3; ++d) series.values.push_back(1e3 * (now[i][d] - rest[d]));
        for (int d = 0; d < 3; ++d) series.values.push_back(force[i][d]);
        for (int d = 0; d < 3; ++d) series.values.push_back(reaction[i][d]);
    }
    write_csv(path, series);
}

PadSeries::PadSeries(fs::path folder, double rate) : folder_(std::move(folder)), rate_(rate) {}

void PadSeries::record(const Simulation& s) {
    if (s.world.time + 1e-9 < next_) return;
    if (times_.empty()) refuse_colliding_pads(s.scene);
    for (const EntityId finger : s.fingers)
        write_pad(folder_ / result_file::finger_pad(s.world.skins.find(finger)->name, times_.size()), s.world, finger);
    times_.push_back(s.world.time);
    next_ = s.world.time + 1 / rate_;
}

void PadSeries::finish(const Simulation& s) const {
    for (const Skin& skin : s.world.skins) {
        PlainText out;
        out << "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\"><Collection>\n";
        for (std::size_t k = 0; k < times_.size(); ++k)
            out << "<DataSet timestep=\"" << times_[k] << "\" file=\"" << escaped(result_file::finger_pad(skin.name, k))
                << "\"/>\n";
        out << "</Collection></VTKFile>\n";
        write_file(folder_ / result_file::finger_pads(skin.name), out.str());
    }
}

namespace {

/// Share of steps by duration, on forty bins up to the slowest.
Curve histogram(const std::string& name, const std::vector<double>& values) {
    constexpr int bins = 40;
    const double most = values.empty() ? 1 : *std::max_element(values.begin(), values.end()) * (1 + 1e-9) + 1e-9;
    std::vector<double> count(bins, 0.0);
    for (double v : values) count[std::size_t(bins * std::max(0.0, v) / most)] += 100.0 / double(values.size());
    Curve c{name, {}, {}};
    for (int i = 0; i < bins; ++i)  // steps, not slopes
        for (int side : {0, 1}) c.x.push_back(most * (i + side) / bins), c.y.push_back(count[std::size_t(i)]);
    return c;
}

/// Over time, per finger: force, area, largest pressure, and each joint of the thimbles; then how long steps took.
std::vector<Plot> plots_of(const Simulation& s) {
    auto of_fingers = [](const std::string& title, const std::string& quantity) {
        return Plot{title, "time [s]", quantity, {}, {}, false};
    };
    std::vector<Plot> plots{of_fingers("Contact force", "force [N]"), of_fingers("Contact area", "area [mm2]"),
                            of_fingers("Pressure peak", "pressure [kPa]")};
    constexpr const char* columns[] = {"contact_force_N", "contact_area_mm2", "pressure_peak_kPa"};
    std::vector<Plot> joints;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const Series& series = s.finger_series[i];
        const auto settled = settled_steps(series);
        auto settled_only = [&](const char* column) {
            std::vector<double> values = series.column(column);
            std::size_t count = 0;
            for (std::size_t k = 0; k < values.size(); ++k)
                if (settled[k]) values[count++] = values[k];
            values.resize(count);
            return values;
        };
        const auto time = settled_only("time_s");
        const std::string& name = s.scene.spec.fingers[i].name;
        const std::size_t left_out = series.rows() - time.size();
        const std::string label = left_out ? name + " (" + std::to_string(left_out) + " unsettled)" : name;
        for (std::size_t p = 0; p < plots.size(); ++p)
            plots[p].curves.push_back({p == 0 ? label : name, time, settled_only(columns[p])});
        for (const Matching& m : s.world.matchings)
            for (int j = 1; m.finger == s.fingers[i] && j <= m.model.kind->joint_count; ++j) {
                const std::string number = std::to_string(j);
                if (joints.size() < std::size_t(j))
                    joints.push_back(of_fingers("Joint " + number + " of the thimbles, as sent", "angle [degrees]"));
                joints[std::size_t(j - 1)].curves.push_back(
                    {name, series.column("time_s"), series.column("sent" + number + "_deg")});
            }
    }
    plots.insert(plots.end(), joints.begin(), joints.end());
    Plot steps = of_fingers("Step time", "wall time [us]");
    const auto time = s.step_series.column("time_s");
    steps.curves.push_back({"whole step", time, s.step_series.column("total_us")});
    steps.curves.push_back({"skin solve", time, s.step_series.column("solve_skin_us")});
    if (!s.world.bodies.empty())
        steps.curves.push_back({"skin and bodies", time, s.step_series.column("solve_bodies_us")});
    plots.push_back(std::move(steps));
    plots.push_back({"Steps by duration", "wall time [us]", "share of steps [%]", {}, {}, false});
    plots.back().curves.push_back(histogram("whole step", s.step_series.column("total_us")));
    return plots;
}

}  // namespace

void write_results(const fs::path& folder, const Simulation& s, const Summary& summary, const PictureSettings& picture,
                   bool live) {
    auto add = [&](const std::string& name) { return folder / name; };
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        const std::string& name = s.scene.spec.fingers[i].name;
        write_nodes(add(result_file::finger_nodes(name)), s.world, s.fingers[i]);
        write_pad(add(result_file::finger_mesh(name)), s.world, s.fingers[i]);
    }
    for (const SoftObject& o : s.world.soft.all) write_soft(add(result_file::object_mesh(o.skin.name)), s.world, o);
    if (!live)
        for (const NamedSeries& table : tables_of(s)) write_csv(add(table.file), *table.series);
    write_svg(add("plots.svg"), plots_of(s));
    if (picture.painted) write_png(add("picture.png"), Painter(s, picture).paint(s));
    write_file(add("summary.txt"), to_text(summary));
    write_file(add("summary.json"), to_json(summary).dump(2) + "\n");
}

}  // namespace palpate
