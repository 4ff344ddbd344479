#include "scenes/run/fixed_skin.h"

#include <algorithm>
#include <set>

namespace palpate {

FixedSkin fixed_skin_of(const TetMesh& mesh) {
    FixedSkin skin;
    const std::set<int> bone(mesh.bone_nodes.begin(), mesh.bone_nodes.end());
    std::set<int> fixed;
    for (const auto& t : mesh.surface)
        for (int i : t)
            if (bone.contains(i)) fixed.insert(i);
    for (int i : fixed) {
        const Point& p = mesh.nodes[std::size_t(i)];
        skin.nodes.push_back({p[0], p[1], p[2]});
        skin.centre += (1.0 / double(fixed.size())) * skin.nodes.back();
    }
    for (const Vec3<double>& x : skin.nodes) skin.radius = std::max(skin.radius, norm(x - skin.centre));
    return skin;
}

double fixed_skin_depth(const FixedSkin& skin, const Pose<double>& bone, const Table<VirtualObject>& shapes) {
    if (skin.nodes.empty()) return 0;
    double depth = 0;
    const Vec3<double> centre = transform(bone, skin.centre);
    for (const VirtualObject& o : shapes) {
        if (o.stiffness > 0 || o.soft >= 0 || surface_point(o.shape, o.pose, centre).distance > skin.radius) continue;
        for (const Vec3<double>& x : skin.nodes)
            depth = std::max(depth, -surface_point(o.shape, o.pose, transform(bone, x)).distance);
    }
    return depth;
}

}  // namespace palpate
