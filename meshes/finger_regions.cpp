#include "meshes/finger_regions.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "meshes/input_error.h"

namespace palpate {

void mark_pad(TetMesh& mesh) {
    const std::set<int> bone(mesh.bone_nodes.begin(), mesh.bone_nodes.end());
    std::set<int> pad;
    for (const auto& t : mesh.surface)
        for (int i : t)
            if (!bone.count(i)) pad.insert(i);
    mesh.pad_nodes.assign(pad.begin(), pad.end());
    if (mesh.bone_nodes.size() < 3)
        throw InputError("fewer than three bone nodes: the finger would not follow the hand; widen the bone region");
    if (mesh.pad_nodes.empty())
        throw InputError("no pad node is left: all surface nodes belong to the bone; narrow the bone region");
}

void mark_regions(TetMesh& mesh, const FingerRegions& r) {
    const auto box = bounds(mesh.nodes);
    const double length = box[1][0] - box[0][0], thickness = box[1][2] - box[0][2];
    mesh.bone_nodes.clear();
    for (int i = 0; i < int(mesh.nodes.size()); ++i) {
        const Point& p = mesh.nodes[i];
        const double along = p[0] - box[0][0], height = p[2] - box[0][2];
        const double beyond = std::max(0.0, along - r.phalanx_length * length + r.phalanx_radius * thickness);
        const double from_axis =
            std::hypot(beyond, p[1] - 0.5 * (box[0][1] + box[1][1]), height - r.phalanx_height * thickness);
        if (along < r.cut * length || height > r.nail * thickness || from_axis < r.phalanx_radius * thickness)
            mesh.bone_nodes.push_back(i);
    }
    mark_pad(mesh);
}

void mark_half_space(TetMesh& mesh, const Point& n, double offset) {
    mesh.bone_nodes.clear();
    for (int i = 0; i < int(mesh.nodes.size()); ++i) {
        const Point& p = mesh.nodes[i];
        if (n[0] * p[0] + n[1] * p[1] + n[2] * p[2] > offset) mesh.bone_nodes.push_back(i);
    }
    mark_pad(mesh);
}

}  // namespace palpate
