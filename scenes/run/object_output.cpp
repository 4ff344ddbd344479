#include "scenes/run/object_output.h"

#include "scenes/run/finger_output.h"

namespace palpate {

namespace {

/// What all that is tissue presses on an object with.
Vec3<double> pressed_by_tissue(const World& w, int object) {
    Vec3<double> force{0, 0, 0};
    const auto add = [&](const ContactSurface& c) {
        for (const ObjectContact& o : c.objects)
            if (o.object == object) force -= o.force;
    };
    for (const ContactSurface& c : w.contact_surfaces) add(c);
    for (const SoftObject& o : w.soft.all) add(o.surface);
    return force;
}

}  // namespace

ObjectOutput object_output(const World& w, std::size_t object) {
    const VirtualObject& shape = w.shapes[object];
    ObjectOutput out;
    if (shape.body >= 0) {
        const RigidBody& body = w.bodies[std::size_t(shape.body)];
        out.force = body.contact_force, out.torque = body.contact_torque;
    } else if (shape.soft >= 0) {
        const ContactSurface& surface = w.soft.all[std::size_t(shape.soft)].surface;
        const FingerOutput own = finger_output(surface);
        out.force = own.force, out.area = own.area, out.touching = own.touching;
        const Vec3<double> arm = surface.bone.position - shape.pose.position;
        out.torque = own.torque + cross(arm, own.force);
    } else {
        out.force = pressed_by_tissue(w, int(object));
    }
    return out;
}

}  // namespace palpate
