#include "engine/systems.h"

namespace palpate {

namespace {

template <class T>
Vec3<double> read_vec3(const LaneArray<T>& a, std::size_t index, int width, int lane) {
    const T* p = &a[3 * index * width + lane];
    return {double(p[0]), double(p[width]), double(p[2 * width])};
}

template <class T>
void extract(const SkinChunk<T>& c, int lane, Coupling& coupling, ContactSurface& out) {
    const SkinTopology& t = *c.topology;
    const int W = c.width;
    const Pose<double> bone = lane_bone(c, lane);
    Vec3<double> pull;  // both from the origin
    for (int d = 0; d < 3; ++d)
        pull[d] = double(c.scratch.bone_springs[(2 + d) * W + lane]) - double(c.state.bone[d * W + lane]);
    coupling.force_N = coupling.stiffness * norm(pull);
    out.total = {0, 0, 0};
    out.normal_force = out.touching_area = 0;
    out.touching = 0;
    const std::size_t S = t.samples.size();
    for (std::size_t s = 0; s < S; ++s) {
        const Vec3<double> x = node_position(c, t.samples[s], lane);
        Vec3<double> force{0, 0, 0};
        double normal_force = 0;
        for (int slot = 0; slot < c.slot_capacity; ++slot) {
            const ContactSlot& object = c.slots[slot];
            if (object.object < 0) continue;
            const std::size_t i = slot * S + s;
            const double f = c.state.normal_multiplier[i * W + lane];
            if (f <= 0) continue;
            force += f * surface_point(object.shape, object.pose, x).normal;
            if (c.has_friction && object.friction > 0) 
                force -= rotation_matrix(object.pose.rotation) * read_vec3(c.state.tangential_multiplier, i, W, lane);
            normal_force += f;
        }
        out.position[s] = inverse_transform(bone, x);
        out.force[s] = force;
        out.touches[s] = normal_force > 0;
        out.total += force;
        out.normal_force += normal_force;
        if (out.touches[s]) out.touching_area += out.area[s], ++out.touching;
    }
}

}  // namespace

void extract_contact(const Table<Skin>& skins, const std::vector<SkinChunk<double>>& double_chunks,
                     const std::vector<SkinChunk<float>>& float_chunks, Table<Coupling>& couplings,
                     Table<ContactSurface>& surfaces) {
    for (std::size_t row = 0; row < surfaces.size(); ++row) {
        const EntityId finger = surfaces.owner(row);
        const Skin& skin = *skins.find(finger);
        Coupling& coupling = *couplings.find(finger);
        if (skin.single_precision)
            extract(float_chunks[skin.chunk], skin.lane, coupling, surfaces[row]);
        else
            extract(double_chunks[skin.chunk], skin.lane, coupling, surfaces[row]);
    }
}

}  // namespace palpate
