#include "scenes/viewer/page_model.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>

#include "engine/contact/contact_edge.h"
#include "scenes/run/stretches.h"
#include "scenes/viewer/bytes.h"

namespace palpate {

namespace {

/// Nodes of the surface, in the order of their first appearance in its triangles.
std::vector<int> skin_nodes(const TetMesh& mesh) {
    std::vector<int> nodes;
    std::vector<bool> seen(mesh.nodes.size(), false);
    for (const auto& t : mesh.surface)
        for (int i : t)
            if (!seen[std::size_t(i)]) seen[std::size_t(i)] = true, nodes.push_back(i);
    return nodes;
}

void put_floats(std::vector<std::uint8_t>& out, std::initializer_list<double> values) {
    for (double v : values) put(out, float(v));
}
void put_pose(std::vector<std::uint8_t>& out, const Pose<double>& p) {
    put_floats(out, {p.position.x, p.position.y, p.position.z, p.rotation.w, p.rotation.x, p.rotation.y, p.rotation.z});
}

/// Where a node is in the bone's frame, and the pressure on it in units [Pa].
void put_node(std::vector<std::uint8_t>& out, const Vec3<double>& x, double pressure, float unit) {
    for (int d = 0; d < 3; ++d) put_scaled<std::int16_t>(out, x[d], 2e-6);
    put_scaled<std::uint16_t>(out, pressure, double(unit));
}
/// The unit in which none of several numbers, and nothing below `least`, is out of a range.
float unit_for(const std::vector<double>& values, double least, double range) {
    double most = least;
    for (const double v : values)
        if (std::isfinite(v)) most = std::max(most, std::abs(v));
    return float(most / range * (1 + 1e-6));
}
constexpr double least_pressure = 1000, unsigned_range = 65535, signed_range = 32767;  // [Pa]
/// Pressure on every node of a mesh by what presses on its samples along normals [Pa].
std::vector<double> pressures(const TetMesh& mesh, const std::vector<Vec3<double>>& pressing,
                              std::span<const double> area) {
    std::vector<double> pressure(mesh.nodes.size(), 0.0);
    for (std::size_t k = 0; k < mesh.pad_nodes.size(); ++k)
        pressure[std::size_t(mesh.pad_nodes[k])] = norm(pressing[k]) / area[k];
    return pressure;
}

/// Per node, of the elements around it: largest departure of a principal stretch from 1, and whether one is at a limit.
struct Strains {
    std::vector<double> departure;
    std::vector<char> limited;
};
Strains strains_of(const TetMesh& mesh, const std::vector<Point>& now, const FingerSpec& f) {
    Strains s{std::vector<double>(mesh.nodes.size(), 0.0), std::vector<char>(mesh.nodes.size(), 0)};
    const std::vector<Vec3<double>> stretches = limited_stretches(mesh, now);
    for (std::size_t e = 0; e < mesh.tets.size(); ++e) {
        const auto& t = mesh.tets[e];
        const double low = f.element_low.empty() ? f.limit_low : f.element_low[e],
                     high = f.element_high.empty() ? f.limit_high : f.element_high[e];
        const Vec3<double>& sigma = stretches[e];
        const double departure = std::max(std::abs(sigma.x - 1), std::abs(sigma.z - 1));
        const bool limited = f.has_limits && (sigma.x > 0.999 * high || sigma.z < 1.001 * low);
        for (int i : t) {
            s.departure[std::size_t(i)] = std::max(s.departure[std::size_t(i)], departure);
            s.limited[std::size_t(i)] |= limited;
        }
    }
    return s;
}

void append_finger(std::vector<std::uint8_t>& out, const Simulation& s, std::size_t row) {
    const EntityId finger = s.fingers[row];
    const TetMesh& mesh = s.world.skins.find(finger)->mesh;
    const ContactSurface& contact = *s.world.contact_surfaces.find(finger);
    const Pose<double> bone = bone_pose(s.world, finger);
    const std::vector<Point> now = finger_positions(s.world, finger);
    const Strains strains = strains_of(mesh, now, s.scene.spec.fingers[row]);
    const std::vector<double> pressure = pressures(mesh, contact.pressing, contact.area);
    put_pose(out, bone);
    std::vector<double> forces;
    for (const Vec3<double>& f : contact.force)
        for (int d = 0; d < 3; ++d) forces.push_back(f[d]);
    const float pressure_unit = unit_for(pressure, least_pressure, unsigned_range),
                force_unit = unit_for(forces, 0.1, signed_range);
    put_floats(out, {contact.normal_force, contact.touching_area, pressure_unit, force_unit});
    for (int i : skin_nodes(mesh)) {
        const Point& x = now[std::size_t(i)];
        put_node(out, inverse_transform(bone, Vec3<double>{x[0], x[1], x[2]}), pressure[std::size_t(i)], pressure_unit);
        put_scaled<std::uint8_t>(out, strains.departure[std::size_t(i)], 0.01);
        put(out, std::uint8_t(strains.limited[std::size_t(i)]));
    }
    for (const double f : forces) put_scaled<std::int16_t>(out, f, double(force_unit));
    const std::vector<Vec3<double>> outline = contact_outline(contact);
    put(out, std::uint16_t(outline.size()));
    for (const Vec3<double>& x : outline)
        for (int d = 0; d < 3; ++d) put_scaled<std::int16_t>(out, x[d], 2e-6);
}

/// A soft object's skin, in the frame of its pose.
void append_soft(std::vector<std::uint8_t>& out, const World& world, const SoftObject& o) {
    const Pose<double>& pose = world.shapes[std::size_t(o.object)].pose;
    const std::vector<Point> now = soft_positions(world, o);
    const std::vector<double> pressure = pressures(o.skin.mesh, o.surface.pressing, o.surface.area);
    const float unit = unit_for(pressure, least_pressure, unsigned_range);
    put(out, unit);
    for (int i : skin_nodes(o.skin.mesh)) {
        const Point& x = now[std::size_t(i)];
        const Vec3<double> here = inverse_transform(pose, Vec3<double>{x[0], x[1], x[2]});
        put_floats(out, {here.x, here.y, here.z});
        put_scaled<std::uint16_t>(out, pressure[std::size_t(i)], double(unit));
    }
}

void append_thimble(std::vector<std::uint8_t>& out, const Matching& m) {
    const Platform p = m.model.kind->platform(m.model, m.result.w);
    const Eigen::Vector3d centre = m.model.mount * p.centre;
    const Eigen::Quaterniond q(Eigen::Matrix3d(m.model.mount.rotation() * p.rotation));
    put_floats(out, {centre.x(), centre.y(), centre.z(), q.w(), q.x(), q.y(), q.z()});
    for (int k = 0; k < m.model.kind->joint_count; ++k) put(out, float(m.result.q[k]));
    put(out, float(m.result.rms_m));
    put(out, std::uint32_t(m.result.status != MatchingStatus::no_contact));
    for (const auto& line : m.model.kind->skeleton(m.model, m.result.w))
        for (const Eigen::Vector3d& x : line) {
            const Eigen::Vector3d here = m.model.mount * x;
            for (int d = 0; d < 3; ++d) put_scaled<std::int16_t>(out, here[d], 1e-5);
        }
}

void append_rendered(std::vector<std::uint8_t>& out, const TetMesh& mesh, const ContactSurface& wanted,
                     const RenderedPad& pad) {
    const std::vector<double> pressure = pressures(mesh, pad.force, wanted.area);
    const float unit = unit_for(pressure, least_pressure, unsigned_range);
    put_floats(out, {pad.normal_force, unit});
    for (int i : skin_nodes(mesh)) {
        const Point& x = pad.position[std::size_t(i)];
        put_node(out, {x[0], x[1], x[2]}, pressure[std::size_t(i)], unit);
    }
    for (std::size_t k = 0; k < mesh.pad_nodes.size(); ++k)
        put(out, std::uint8_t((wanted.touches[k] ? 1 : 0) | (pad.touches[k] ? 2 : 0)));
}

nlohmann::json finger_json(const Skin& skin) {
    const std::vector<int> nodes = skin_nodes(skin.mesh);
    std::vector<int> number(skin.mesh.nodes.size(), -1);
    nlohmann::json rest = nlohmann::json::array(), triangles = nlohmann::json::array();
    for (std::size_t k = 0; k < nodes.size(); ++k) {
        number[std::size_t(nodes[k])] = int(k);
        for (double x : skin.mesh.nodes[std::size_t(nodes[k])]) rest.push_back(std::round(1e7 * x) / 1e7);
    }
    for (const auto& t : skin.mesh.surface)
        for (int i : t) triangles.push_back(number[std::size_t(i)]);
    nlohmann::json samples = nlohmann::json::array();
    for (int i : skin.mesh.pad_nodes) samples.push_back(number[std::size_t(i)]);
    return {{"name", skin.name}, {"rest", rest}, {"triangles", triangles}, {"samples", samples}};
}

nlohmann::json thimble_json(const Simulation& s, const Matching& m) {
    const auto row = std::find(s.fingers.begin(), s.fingers.end(), m.finger) - s.fingers.begin();
    nlohmann::json low = nlohmann::json::array(), high = nlohmann::json::array();
    for (int k = 0; k < m.model.kind->joint_count; ++k)
        low.push_back(m.model.joint_min[k]), high.push_back(m.model.joint_max[k]);
    nlohmann::json links = nlohmann::json::array();
    for (const auto& line : m.model.kind->skeleton(m.model, m.model.rest)) links.push_back(line.size());
    return {{"finger", row},    {"links", links},   {"kind", m.model.kind->name}, {"radius", m.model.disk_radius},
            {"joint_min", low}, {"joint_max", high}};
}

}  // namespace

void set_scales(nlohmann::json& model, const PictureScales& scales) {
    model["pressure_kPa"] = 1e-3 * scales.most;
    for (std::size_t k = 0; k < scales.pads.size(); ++k) model["fingers"][k]["pressure_kPa"] = 1e-3 * scales.pads[k];
}

nlohmann::json page_model(const Simulation& s) {
    // As ShapeKind has them.
    static const char* const kinds[] = {"plane", "box", "sphere", "capsule", "cylinder", "mesh"};
    nlohmann::json model{{"title", s.scene.title},
                         {"dt", s.world.solver.dt},
                         {"duration", s.scene.duration},
                         {"fingers", nlohmann::json::array()},
                         {"objects", nlohmann::json::array()},
                         {"thimbles", nlohmann::json::array()}};
    for (const Skin& skin : s.world.skins) model["fingers"].push_back(finger_json(skin));
    for (const VirtualObject& o : s.world.shapes) {
        model["objects"].push_back({{"name", o.name},
                                    {"kind", kinds[int(o.shape.kind)]},
                                    {"size", {o.shape.size.x, o.shape.size.y, o.shape.size.z}},
                                    {"friction", o.friction},
                                    {"gives_way", o.stiffness > 0 && o.soft < 0}});
        if (o.soft >= 0) {
            const nlohmann::json skin = finger_json(s.world.soft.all[std::size_t(o.soft)].skin);
            model["objects"].back()["kind"] = "soft";
            model["objects"].back()["vertices"] = skin["rest"];
            model["objects"].back()["triangles"] = skin["triangles"];
            continue;
        }
        if (!o.mesh) continue;
        nlohmann::json vertices = nlohmann::json::array(), triangles = nlohmann::json::array();
        for (const Point& p : o.mesh->surface.vertices)
            for (double x : p) vertices.push_back(std::round(1e6 * x) / 1e6);
        for (const auto& t : o.mesh->surface.triangles)
            for (int i : t) triangles.push_back(i);
        model["objects"].back()["vertices"] = vertices;
        model["objects"].back()["triangles"] = triangles;
    }
    for (const Matching& m : s.world.matchings) model["thimbles"].push_back(thimble_json(s, m));
    if (const PictureScales fixed = scales_of(s, nullptr); fixed.most > 0) set_scales(model, fixed);
    if (s.scene.scale_force > 0) model["force_N"] = s.scene.scale_force;
    model["hand_skin"] = hand_skin_json();
    model["hands"] = hands_json(s.scene);
    return model;
}

void note_step(SinceFrame& since, const Simulation& s) {
    since.longest_us = std::max(since.longest_us, 1e6 * s.world.profile.total());
    ++since.steps;
    since.converged.resize(s.fingers.size(), 0);
    for (std::size_t row = 0; row < s.fingers.size(); ++row)
        since.converged[row] += skin_status(s.world, s.fingers[row]).converged;
}

void append_frame(std::vector<std::uint8_t>& out, const Simulation& s, const std::vector<RenderedPad>& rendered_pads,
                  DrawnHands& hands, const SinceFrame& since) {
    put_floats(out, {s.world.time, since.longest_us, double(since.steps)});
    for (std::size_t row = 0; row < s.fingers.size(); ++row)
        put(out, float(row < since.converged.size() ? since.converged[row] : 0));
    for (std::size_t row = 0; row < s.fingers.size(); ++row) append_finger(out, s, row);
    for (const VirtualObject& o : s.world.shapes) {
        put_pose(out, o.pose);
        if (o.soft >= 0) append_soft(out, s.world, s.world.soft.all[std::size_t(o.soft)]);
    }
    for (std::size_t t = 0; t < s.world.matchings.size(); ++t) {
        const Matching& m = s.world.matchings[t];
        append_thimble(out, m);
        append_rendered(out, s.world.skins.find(m.finger)->mesh, *s.world.contact_surfaces.find(m.finger),
                        rendered_pads[t]);
    }
    hands.append(out, s);
}

}  // namespace palpate
