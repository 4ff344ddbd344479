#include "scenes/picture/still.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "engine/contact/contact_edge.h"
#include "meshes/plain_numbers.h"

namespace palpate {

namespace {

using Eigen::Vector3d;

struct Look {
    Colour air, ink, soft, floor, grid, panel, line;
};
const Look& look_of(bool dark) {
    static const Look light{{0.945f, 0.955f, 0.97f}, {0.11f, 0.14f, 0.19f}, {0.36f, 0.40f, 0.46f},
                            {0.90f, 0.915f, 0.935f}, {0.74f, 0.78f, 0.83f}, {1, 1, 1},
                            {0.82f, 0.85f, 0.89f}};
    static const Look night{{0.105f, 0.125f, 0.155f}, {0.90f, 0.91f, 0.93f}, {0.62f, 0.66f, 0.72f},
                            {0.17f, 0.195f, 0.235f},  {0.29f, 0.33f, 0.39f}, {0.13f, 0.15f, 0.185f},
                            {0.25f, 0.28f, 0.33f}};
    return dark ? night : light;
}
constexpr Colour object_colours[] = {{0.36f, 0.58f, 0.77f}, {0.37f, 0.64f, 0.47f}, {0.56f, 0.55f, 0.78f},
                                     {0.31f, 0.60f, 0.64f}, {0.55f, 0.59f, 0.65f}, {0.64f, 0.61f, 0.31f}};
constexpr Colour arrow_colour{0.10f, 0.12f, 0.16f};
constexpr Colour hand_colour{0.90f, 0.76f, 0.67f};

std::string formatted(const char* format, double value) {
    char text[64];
    plain_snprintf(text, sizeof text, format, value);
    return text;
}

void write_scale(Image& image, int x, int y, int width, double most_kPa, const std::string& title, const Look& look) {
    image.write(x, y, title, look.ink);
    for (int i = 0; i < width; ++i) image.fill(x + i, y + 17, 1, 10, skin_colour(double(i) / (width - 1)));
    image.write(x, y + 30, "0", look.soft);
    const std::string end = formatted("%.3g kPa", most_kPa);
    image.write(x + width - text_width(end), y + 30, end, look.soft);
}

double peak_of(const World& world, EntityId finger) {
    const std::vector<double> p = node_pressures(world, finger);
    return p.empty() ? 0 : *std::max_element(p.begin(), p.end());
}

/// Whether a plane is a floor.
bool is_floor(const VirtualObject& o) {
    return o.shape.kind == ShapeKind::plane && transform(o.pose, Vec3<double>{0, 0, 1}).z - o.pose.position.z > 0.999;
}

Triangles tilted_plane(const VirtualObject& o, Colour colour, const Vector3d& near) {
    Triangles t;
    const Vec3<double> middle = inverse_transform(o.pose, Vec3<double>{near.x(), near.y(), near.z()});
    const Vector3d normal = as_eigen(transform(o.pose, Vec3<double>{0, 0, 1})) - as_eigen(o.pose.position);
    for (const auto& [u, v] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
        t.vertices.push_back(
            {as_eigen(transform(o.pose, Vec3<double>{middle.x + 0.03 * u, middle.y + 0.03 * v, 0})), normal, colour});
    t.faces = {{0, 1, 2}, {0, 2, 3}};
    return t;
}

}  // namespace

Painter::Painter(const Simulation& s, PictureSettings settings) : settings_(settings) {
    for (const HandParts& parts : hands_of(s.scene)) hands_.emplace_back(s, parts);
    if (settings_.scales.most == 0) settings_.scales = scales_of(s, nullptr);
    if (s.scene.scale_force > 0) most_force_ = s.scene.scale_force;
}

void Painter::choose_camera(const Simulation& s) {
    Vector3d middle = Vector3d::Zero();
    std::vector<Vector3d> seen;
    for (const EntityId finger : s.fingers) {
        const Vector3d at = as_eigen(bone_pose(s.world, finger).position);
        middle += at / double(s.fingers.size());
        seen.push_back(at);
    }
    double reach = 0.030;
    for (const Vector3d& x : seen) reach = std::max(reach, (x - middle).norm() + 0.030);
    // Objects that are held are seen whole; what is large, only in part.
    for (const VirtualObject& o : s.world.shapes)
        if (o.body >= 0 && (as_eigen(o.pose.position) - middle).norm() < 2 * reach)
            reach = std::max(reach, (as_eigen(o.pose.position) - middle).norm() + 0.028);
    reach_ = std::max(reach, reach_);
    camera_.target = middle + Vector3d(-0.10 * reach_, 0, 0.16 * reach_);
    camera_.eye = camera_.target + 4.4 * reach_ * Vector3d(0.70, -0.62, 0.30).normalized();
}

void Painter::paint_scene(const Simulation& s, Image& image, int top, int height) {
    const Look& look = look_of(settings_.dark);
    const int factor = settings_.samples;
    raster_ = std::make_unique<Raster>(camera_, factor * image.width, factor * height, look.air);
    Raster& r = *raster_;
    std::vector<Triangles> kept;
    kept.reserve(64 + 3 * s.world.shapes.size());
    std::vector<const Triangles*> shadows;
    auto keep = [&](Triangles t) -> const Triangles& {
        kept.push_back(std::move(t));
        shadows.push_back(&kept.back());
        return kept.back();
    };
    kept.reserve(kept.capacity() + 4 * s.fingers.size());
    Contacts contacts;
    for (std::size_t f = 0; f < s.fingers.size(); ++f) {
        r.opaque(keep(finger_triangles(s.world, s.fingers[f], most_)));
        Vector3d place, force;
        if (!centre_of_pressure(s.world, s.fingers[f], place, force)) continue;
        // Of a pad that faces away, its own finger is in front.
        if (force.dot((camera_.eye - place).normalized()) < 0.25 * force.norm()) contacts.place.push_back(place);
        const Vector3d from = place - 0.022 * std::min(1.0, force.norm() / most_force_) * force.normalized();
        r.opaque(arrow_triangles(from, place, 0.0009, arrow_colour));
    }
    if (settings_.thimbles)
        for (const Matching& m : s.world.matchings) r.opaque(keep(thimble_triangles(s.world, m)));
    std::vector<const Triangles*> hands, objects;
    for (HandPoser& hand : hands_) {
        const HandBones& bones = hand.pose(s);
        if (settings_.hand) hands.push_back(&keep(hand_triangles(hand.parts(), bones, hand_colour)));
    }
    double floor = 1e9, lowest = 1e9;
    for (const VirtualObject& o : s.world.shapes) {
        const auto row = std::size_t(&o - &s.world.shapes[0]);
        const Colour colour = object_colours[row % std::size(object_colours)];
        if (is_floor(o))
            floor = std::min(floor, o.pose.position.z);
        else if (o.shape.kind == ShapeKind::plane)
            objects.push_back(&keep(tilted_plane(o, colour, camera_.target)));
        else
            objects.push_back(&keep(object_triangles(s.world, o, colour, most_)));
        if (!is_floor(o))
            for (const Vertex& v : objects.back()->vertices) lowest = std::min(lowest, v.position.z());
    }
    if (floor > 1e8) {  // where the scene has none: below its objects as they were first
        if (floors_.empty()) floors_.push_back(lowest < 1e8 ? lowest : camera_.target.z() - 0.05);
        floor = floors_[0];
    }
    // The hand first: where it hides a contact, it is as clear as an object.
    r.floor(floor, shadows, look.floor, look.grid);
    int id = 0;
    for (const Triangles* t : objects) r.layer(*t, id++, 0.93, contacts);
    for (const Triangles* t : hands) r.layer(*t, 1000, 1.0, contacts);
    for (const Triangles* t : objects) {
        const std::vector<Vector3d> edges = sharp_edges(*t, t->vertices.size() > 20000 ? 75 : 50);
        for (std::size_t k = 0; k + 1 < edges.size(); k += 2)
            r.line(edges[k], edges[k + 1], {0.20f, 0.30f, 0.40f}, 0.7 * factor);
    }
    image.paste(r.image(factor), 0, top);
    write_names(s, image, top, height);
}

namespace {

struct Box {
    int x, y, width, height;
};
bool overlap(const Box& a, const Box& b) {
    return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}
/// The nearest place above or below, between two heights, where a box covers none that are taken.
Box free_place(Box wanted, const std::vector<Box>& taken, int top, int bottom) {
    for (int step = 0; step <= bottom - top; ++step)
        for (const int side : {1, -1}) {
            Box there = wanted;
            there.y += side * step;
            const bool inside = there.y >= top && there.y + there.height <= bottom;
            if (inside && std::none_of(taken.begin(), taken.end(), [&](const Box& b) { return overlap(there, b); }))
                return there;
        }
    wanted.y = std::clamp(wanted.y, top, std::max(top, bottom - wanted.height));
    return wanted;
}

}  // namespace

/// Names and forces over all, each whole and beside the others, with a line to its finger.
void Painter::write_names(const Simulation& s, Image& image, int top, int height) {
    const Look& look = look_of(settings_.dark);
    const View& view = raster_->view();
    struct Tag {
        std::string text;
        int to_x, to_y;
        Box box;
    };
    std::vector<Tag> tags;
    for (std::size_t f = 0; f < s.fingers.size(); ++f) {
        const Pose<double> bone = bone_pose(s.world, s.fingers[f]);
        const Vector3d at = view.pixel(view.in_view(as_eigen(transform(bone, Vec3<double>{-0.004, 0, 0.008}))));
        const double force = s.world.contact_surfaces.find(s.fingers[f])->normal_force;
        Tag tag{
            s.scene.spec.fingers[f].name, int(at.x()) / settings_.samples, top + int(at.y()) / settings_.samples, {}};
        if (force > 0.0005) tag.text += formatted(" %.2f N", force);
        // Beside the middle of the picture, on the finger's side.
        const int width = text_width(tag.text) + 8, gap = std::min(70, image.width / 8);
        const int x = tag.to_x > image.width / 2 ? tag.to_x + gap : tag.to_x - gap - width;
        tag.box = {std::clamp(x, 3, std::max(3, image.width - width - 3)), tag.to_y - 28, width, 18};
        tags.push_back(tag);
    }
    std::sort(tags.begin(), tags.end(), [](const Tag& a, const Tag& b) { return a.to_y < b.to_y; });
    std::vector<Box> taken;
    if (settings_.title)
        taken = {{0, 0, std::max(text_width(s.scene.title) + 20, 170), 42}, {0, 42, 170, 52}};  // and its scale
    for (Tag& tag : tags) {
        tag.box = free_place(tag.box, taken, top + 2, top + height - 2);
        taken.push_back(tag.box);
    }
    for (const Tag& tag : tags) {
        const Box& b = tag.box;
        const int from_x = b.x > tag.to_x ? b.x : b.x + b.width, steps = 200;
        for (int k = 0; k <= steps; ++k)
            image.set(from_x + (tag.to_x - from_x) * k / steps, b.y + 8 + (tag.to_y - b.y - 8) * k / steps, look.ink,
                      0.8);
        image.fill(tag.to_x - 1, tag.to_y - 1, 3, 3, look.ink);
    }
    for (const Tag& tag : tags) {
        image.fill(tag.box.x, tag.box.y, tag.box.width, 17, look.panel, 0.88);
        image.write(tag.box.x + 4, tag.box.y + 2, tag.text, look.ink);
    }
    names_.clear();
    for (const Tag& tag : tags) names_.push_back({tag.box.x, tag.box.y, tag.box.width, tag.box.height});
}

std::vector<std::string> fitting_names(std::vector<std::string> names, int width) {
    const auto fit = [&] {
        return std::all_of(names.begin(), names.end(), [&](const std::string& n) { return text_width(n) <= width; });
    };
    if (fit()) return names;
    for (std::string& name : names)
        for (const auto& [whole, part] : {std::pair{"right ", "R "}, {"left ", "L "}})
            if (name.starts_with(whole)) name = part + name.substr(std::strlen(whole));
    if (fit()) return names;
    std::size_t letters = 1;
    while (text_width(std::string(letters + 1, 'm')) <= width) ++letters;
    for (std::string& name : names) name.resize(std::min(name.size(), letters));
    return names;
}

double paint_pad(Image& image, const World& world, EntityId finger, const PadPlace& at) {
    const Look& look = look_of(at.dark);
    const ContactSurface& contact = *world.contact_surfaces.find(finger);
    const double peak = peak_of(world, finger), most = at.most > 0 ? at.most : round_up(std::max(1000.0, peak));
    const int side = at.height - 52, wide = std::min(at.width - 8, side), factor = at.samples;
    const int middle = at.x + at.width / 2;
    Camera below;
    below.field = 0;
    below.eye = {0, 0, -0.2}, below.target = {0, 0, 0}, below.up = {1, 0, 0};  // the tip points up
    below.half_height = std::max(0.0148, 0.0112 * side / wide);
    Raster r(below, factor * wide, factor * side, look.panel);
    r.opaque(finger_triangles(world, finger, most, true));
    const std::vector<Vec3<double>> edge = contact_outline(contact);
    const Vector3d lift(0, 0, -0.002);
    for (std::size_t k = 0; k + 1 < edge.size(); k += 2)
        r.line(as_eigen(edge[k]) + lift, as_eigen(edge[k + 1]) + lift, {0.05f, 0.05f, 0.10f}, 1.3 * factor, false);
    Vector3d place, force;
    if (centre_of_pressure(world, finger, place, force)) {
        const Vec3<double> c =
            inverse_transform(bone_pose(world, finger), Vec3<double>{place.x(), place.y(), place.z()});
        const Vector3d x = as_eigen(c) + lift;
        for (const Vector3d& arm : {Vector3d(0.0016, 0, 0), Vector3d(0, 0.0016, 0)}) {
            r.line(x - arm, x + arm, {1, 1, 1}, 2.6 * factor, false);
            r.line(x - arm, x + arm, {0, 0, 0}, 1.1 * factor, false);
        }
    }
    image.paste(r.image(factor), middle - wide / 2, at.top + 18);
    auto centred = [&](int y, const std::string& text, Colour colour) {
        image.write(middle - text_width(text) / 2, y, text, colour);
    };
    centred(at.top + 4, fitting_names({at.name}, at.width - 4)[0], look.ink);
    if (contact.normal_force > 0.0005) {
        const std::string newtons = formatted("%.2f N", contact.normal_force),
                          area = formatted(at.width > 130 ? "  %.0f mm2" : " %.0f", 1e6 * contact.touching_area);
        centred(at.top + side + 20, text_width(newtons + area) <= at.width - 4 ? newtons + area : newtons, look.ink);
        const int bar = std::min(at.width - 60, 90), bx = middle - bar / 2 - 20;
        for (int i = 0; i < bar; ++i) image.fill(bx + i, at.top + side + 37, 1, 8, skin_colour(double(i) / (bar - 1)));
        image.write(bx + bar + 4, at.top + side + 35, formatted(at.width > 130 ? "%.3g kPa" : "%.3g", 1e-3 * most),
                    look.soft);
    } else {
        centred(at.top + side + 20, at.width > 130 ? "does not touch" : "free", look.soft);
    }
    return most;
}

void Painter::paint_pads(const Simulation& s, Image& image, int top, int height) {
    const Look& look = look_of(settings_.dark);
    image.fill(0, top, image.width, height, look.panel);
    image.fill(0, top, image.width, 1, look.line);
    const int count = int(s.fingers.size()), cell = std::min(180, image.width / std::max(1, count));
    const int left = (image.width - cell * count) / 2;
    std::vector<std::string> names;
    for (const FingerSpec& finger : s.scene.spec.fingers) names.push_back(finger.name);
    names = fitting_names(names, cell - 4);
    for (int f = 0; f < count; ++f) {
        const EntityId finger = s.fingers[std::size_t(f)];
        const double own = peak_of(s.world, finger) > 0 ? 0 : most_;
        paint_pad(image, s.world, finger,
                  {left + f * cell, top, cell, height, names[std::size_t(f)],
                   settings_.scales.pads.empty() ? own : settings_.scales.pads[std::size_t(f)], settings_.dark,
                   settings_.samples});
    }
}

Image Painter::paint(const Simulation& s) {
    const Look& look = look_of(settings_.dark);
    // Scales that nobody has fixed grow, and never shrink, so that pictures of one run compare.
    for (const EntityId finger : s.fingers) {
        most_ = std::max(most_, round_up(std::max(1000.0, peak_of(s.world, finger))));
        if (s.scene.scale_force <= 0)
            most_force_ = std::max(most_force_, s.world.contact_surfaces.find(finger)->normal_force);
    }
    if (settings_.scales.most > 0) most_ = settings_.scales.most;
    choose_camera(s);
    Image image(settings_.width, settings_.height, look.air);
    const int pads = settings_.pads ? std::min(200, settings_.height / 3) : 0;
    paint_scene(s, image, 0, settings_.height - pads);
    if (pads > 0) paint_pads(s, image, settings_.height - pads, pads);
    if (!settings_.title) return image;
    image.write(12, 10, s.scene.title, look.ink);
    image.write(12, 26, formatted("%.2f s", s.world.time) + ", step " + formatted("%.3g ms", 1e3 * s.world.solver.dt),
                look.soft);
    write_scale(image, 12, 48, 150, 1e-3 * most_, "contact pressure", look);
    return image;
}

}  // namespace palpate
