#include <Eigen/Dense>
#include <cmath>
#include <cstdarg>

#include "meshes/plain_numbers.h"
#include "scenes/load/finger_mesh.h"
#include "scenes/studies/stress/cases.h"

namespace palpate::stress {

namespace {

TetMesh finger_mesh(int elements) {
    static FingerTemplates templates;
    FingerMeshRequest request;
    request.shape = finger_shape("index");
    request.elements = elements;
    std::string note;
    return make_finger_mesh(request, templates, note);
}

}  // namespace

std::string text(const char* format, ...) {
    char buffer[400];
    va_list arguments;
    va_start(arguments, format);
    plain_vsnprintf(buffer, sizeof buffer, format, arguments);
    va_end(arguments);
    return buffer;
}

/// A finger above a table, pad down; its lowest node at `height`.
SceneSpec press_spec(int elements, double height) {
    SceneSpec spec;
    FingerSpec f;
    f.name = "finger";
    f.mesh = finger_mesh(elements);
    f.has_limits = true;
    double lowest = 0;
    for (const Point& p : f.mesh.nodes) lowest = std::min(lowest, p[2]);
    f.start.position.z = height - lowest;
    spec.fingers.push_back(std::move(f));
    spec.objects.push_back({"table", {}, Pose<double>::identity()});
    return spec;
}

void aim(World& world, std::size_t finger, const Pose<double>& pose) {
    TrackerPose& t = world.tracker_poses[finger];
    t.incoming = {pose, world.time, true};
}

bool finite(const World& world) {
    auto all = [](const auto& chunks) {
        for (const auto& c : chunks)
            for (const auto x : c.state.position)
                if (!std::isfinite(x)) return false;
        return true;
    };
    return all(world.chunks.doubles) && all(world.chunks.floats);
}

/// Farthest node from its rest place on the bone, as a share of the finger's extent.
double off_rest(const World& world) {
    const Skin& skin = world.skins[0];
    const EntityId finger = world.skins.owner(0);
    const Pose<double> bone = bone_pose(world, finger);
    const auto x = finger_positions(world, finger);
    double farthest = 0, extent = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        const Point& r = skin.mesh.nodes[i];
        const Vec3<double> rest = transform(bone, Vec3<double>{r[0], r[1], r[2]});
        farthest = std::max(farthest, norm(Vec3<double>{x[i][0], x[i][1], x[i][2]} - rest));
        extent = std::max(extent, std::hypot(r[0], r[1], r[2]));
    }
    return farthest / extent;
}

int inverted_elements(const World& world) {
    const Skin& skin = world.skins[0];
    const auto x = finger_positions(world, world.skins.owner(0));
    int inverted = 0;
    for (const auto& t : skin.mesh.tets) {
        Eigen::Matrix3d D;
        for (int k = 0; k < 3; ++k)
            for (int d = 0; d < 3; ++d) D(d, k) = x[std::size_t(t[k + 1])][d] - x[std::size_t(t[0])][d];
        inverted += D.determinant() <= 0;
    }
    return inverted;
}

}  // namespace palpate::stress
