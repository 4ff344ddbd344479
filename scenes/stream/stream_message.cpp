#include "scenes/stream/stream_message.h"

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "scenes/run/finger_output.h"
#include "scenes/run/hardware.h"
#include "scenes/run/object_output.h"

namespace palpate {

namespace {

std::string quoted(const std::string& name) {
    return nlohmann::json(name).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

void put(std::string& out, double v) {
    if (!std::isfinite(v)) {
        out += "null";
        return;
    }
    char text[32];
    out.append(text, std::to_chars(text, text + sizeof text, v).ptr);
}
void put_short(std::string& out, double v) {
    char text[32];
    if (!std::isfinite(v)) v = 0;
    out.append(text, std::to_chars(text, text + sizeof text, v, std::chars_format::general, 7).ptr);
}
void put(std::string& out, std::int64_t v) {
    char text[24];
    out.append(text, std::to_chars(text, text + sizeof text, v).ptr);
}

template <class Numbers>
void put_list(std::string& out, const Numbers& numbers) {
    out += '[';
    bool first = true;
    for (double v : numbers) {
        if (!first) out += ',';
        first = false;
        put(out, v);
    }
    out += ']';
}
void put(std::string& out, const Vec3<double>& v) { put_list(out, std::array{v.x, v.y, v.z}); }
void put(std::string& out, const Pose<double>& p) {
    put_list(out, std::array{p.position.x, p.position.y, p.position.z, p.rotation.w, p.rotation.x, p.rotation.y,
                             p.rotation.z});
}
void put_samples(std::string& out, const std::vector<Vec3<double>>& samples) {
    out += '[';
    for (std::size_t s = 0; s < samples.size(); ++s) {
        out += s ? ",[" : "[";
        put_short(out, samples[s].x), out += ',';
        put_short(out, samples[s].y), out += ',';
        put_short(out, samples[s].z), out += ']';
    }
    out += ']';
}

void put_samples(std::string& out, const StreamNumbers::Samples& samples) {
    out += ",\"samples\":{\"positions\":";
    put_samples(out, samples.positions);
    out += ",\"forces\":";
    put_samples(out, samples.forces);
    out += '}';
}

/// ,"key":value
template <class Value>
void field(std::string& out, const char* key, const Value& value) {
    ((out += ",\"") += key) += "\":";
    put(out, value);
}

void put_finger(const StreamNumbers::Finger& f, const StreamNames& names, std::size_t i, bool samples,
                std::string& out) {
    (out += "{\"name\":") += names.fingers[i];
    field(out, "tracked", f.tracked);
    field(out, "age", f.age);
    field(out, "pose", f.bone);
    field(out, "force", f.force);
    field(out, "torque", f.torque);
    field(out, "normal_force", f.normal_force);
    if (std::isfinite(f.centre.x))
        field(out, "centre", f.centre);
    else
        out += ",\"centre\":null";
    field(out, "area", f.area);
    field(out, "touching", std::int64_t(f.touching));
    out += f.converged ? ",\"converged\":true" : ",\"converged\":false";
    if (samples) put_samples(out, f.samples);
    if (names.thimbles[i] >= 0) {
        (out += ",\"thimble\":{\"kind\":") += names.kinds[std::size_t(names.thimbles[i])];
        out += ",\"configuration\":", put_list(out, f.configuration);
        out += ",\"wanted\":", put_list(out, f.wanted);
        out += ",\"sent\":", put_list(out, f.sent);
        out += ",\"reached\":", put_list(out, f.reached);
        out += '}';
    }
    out += '}';
}

}  // namespace

StreamNames stream_names(const Simulation& s) {
    StreamNames names;
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        names.fingers.push_back(quoted(s.world.skins[i].name));
        names.thimbles.push_back(-1);
        for (std::size_t t = 0; t < s.world.matchings.size(); ++t)
            if (s.world.matchings[t].finger == s.fingers[i]) names.thimbles.back() = int(t);
    }
    for (const Matching& m : s.world.matchings) names.kinds.push_back(quoted(m.model.kind->name));
    for (const VirtualObject& o : s.world.shapes) names.objects.push_back(quoted(o.name)), names.soft.push_back(o.soft);
    return names;
}

namespace {

void take_samples(const ContactSurface& c, StreamNumbers::Samples& out) {
    out.positions.resize(c.position.size());
    for (std::size_t k = 0; k < c.position.size(); ++k) out.positions[k] = sample_place(c, k);
    out.forces = c.force;
}

}  // namespace

void take_numbers(const Simulation& s, const StreamNames& names, bool samples, StreamNumbers& out) {
    const World& w = s.world;
    out.time = w.time;
    out.step = w.step;
    out.samples = samples;
    out.fingers.resize(s.fingers.size());
    for (std::size_t i = 0; i < s.fingers.size(); ++i) {
        StreamNumbers::Finger& f = out.fingers[i];
        const ContactSurface& c = w.contact_surfaces[i];
        const FingerOutput o = finger_output(c);
        const TrackerPose& tracker = w.tracker_poses[i];
        f.tracked = tracker.accepted > 0 ? tracker.newest.pose : w.skins[i].start, f.age = tracker.silent;
        f.bone = o.bone, f.force = o.force, f.torque = o.torque, f.centre = o.centre;
        f.normal_force = o.normal_force, f.area = o.area, f.touching = o.touching;
        f.converged = skin_status(w, s.fingers[i]).converged;
        if (samples) take_samples(c, f.samples);
        if (names.thimbles[i] < 0) continue;
        const auto t = std::size_t(names.thimbles[i]);
        f.configuration = w.matchings[t].result.w, f.wanted = w.matchings[t].result.q;
        f.reached = s.hardware ? newest_report(*s.hardware, int(t)).actual : s.loops[t]->driver->actual(w.time);
        f.sent = sent_angles(s, t);
    }
    out.objects.resize(w.shapes.size());
    for (std::size_t i = 0; i < w.shapes.size(); ++i) {
        const VirtualObject& shape = w.shapes[i];
        StreamNumbers::Object& o = out.objects[i];
        o.pose = shape.pose, o.velocity = o.spin = {0, 0, 0}, o.force = object_output(w, i).force;
        if (samples && shape.soft >= 0) take_samples(w.soft.all[std::size_t(shape.soft)].surface, o.samples);
        if (shape.body < 0) continue;
        const RigidBody& b = w.bodies[std::size_t(shape.body)];
        o.velocity = b.velocity;
        o.spin = angular_velocity(b, shape.pose.rotation);
    }
}

void append_line(const StreamNumbers& n, const StreamNames& names, bool samples, std::string& out) {
    out += "{\"palpate\":";
    put(out, std::int64_t(stream_version));
    field(out, "time", n.time);
    field(out, "step", n.step);
    out += ",\"fingers\":[";
    for (std::size_t i = 0; i < n.fingers.size(); ++i) {
        if (i) out += ',';
        put_finger(n.fingers[i], names, i, samples && n.samples, out);
    }
    out += "],\"objects\":[";
    for (std::size_t i = 0; i < n.objects.size(); ++i) {
        ((out += i ? ",{\"name\":" : "{\"name\":")) += names.objects[i];
        field(out, "pose", n.objects[i].pose);
        field(out, "velocity", n.objects[i].velocity);
        field(out, "spin", n.objects[i].spin);
        field(out, "force", n.objects[i].force);
        if (samples && n.samples && names.soft[i] >= 0) put_samples(out, n.objects[i].samples);
        out += '}';
    }
    out += "]}\n";
}

}  // namespace palpate
