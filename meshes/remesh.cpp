#include "meshes/remesh.h"

#include <Eigen/Geometry>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <algorithm>
#include <cmath>

namespace palpate {

namespace remeshing {

struct Traits : OpenMesh::DefaultTraits {
    typedef OpenMesh::Vec3d Point;
    typedef OpenMesh::Vec3d Normal;
    VertexAttributes(OpenMesh::Attributes::Status);
    EdgeAttributes(OpenMesh::Attributes::Status);
    FaceAttributes(OpenMesh::Attributes::Status);
    HalfedgeAttributes(OpenMesh::Attributes::Status);
};
using WorkMesh = OpenMesh::TriMesh_ArrayKernelT<Traits>;

}  // namespace remeshing

namespace {

using OpenMesh::Vec3d;
using remeshing::WorkMesh;

// Edges are split above and collapsed below these multiples of the wanted length (Botsch & Kobbelt 2004).
constexpr double longest = 4.0 / 3.0, shortest = 4.0 / 5.0;

Eigen::Vector3d to_eigen(const Vec3d& p) { return {p[0], p[1], p[2]}; }
Vec3d from_eigen(const Eigen::Vector3d& p) { return {p[0], p[1], p[2]}; }

WorkMesh to_work_mesh(const Surface& s) {
    WorkMesh mesh;
    std::vector<WorkMesh::VertexHandle> handle;
    for (const Point& p : s.vertices) handle.push_back(mesh.add_vertex({p[0], p[1], p[2]}));
    for (const auto& t : s.triangles) mesh.add_face(handle[t[0]], handle[t[1]], handle[t[2]]);
    return mesh;
}

Surface to_surface(const WorkMesh& mesh) {
    Surface s;
    for (auto v : mesh.vertices()) s.vertices.push_back({mesh.point(v)[0], mesh.point(v)[1], mesh.point(v)[2]});
    for (auto f : mesh.faces()) {
        std::array<int, 3> t{};
        int k = 0;
        for (auto v : mesh.fv_range(f)) t[k++] = v.idx();
        s.triangles.push_back(t);
    }
    return s;
}

Eigen::Vector3d middle(const WorkMesh& mesh, WorkMesh::EdgeHandle e) {
    const auto h = mesh.halfedge_handle(e, 0);
    return to_eigen(0.5 * (mesh.point(mesh.from_vertex_handle(h)) + mesh.point(mesh.to_vertex_handle(h))));
}

template <class Size>
void split_long_edges(WorkMesh& mesh, const Size& size) {
    const std::size_t count = mesh.n_edges();  // edges made by splits wait for the next round
    for (std::size_t i = 0; i < count; ++i) {
        const WorkMesh::EdgeHandle e{static_cast<int>(i)};
        if (mesh.status(e).deleted() || mesh.calc_edge_length(e) <= longest * size(middle(mesh, e))) continue;
        const auto h = mesh.halfedge_handle(e, 0);
        mesh.split(e, 0.5 * (mesh.point(mesh.from_vertex_handle(h)) + mesh.point(mesh.to_vertex_handle(h))));
    }
}

/// Whether moving the vertex to p turns one of its faces (other than those around `gone`) over.
bool flips_normal(const WorkMesh& mesh, WorkMesh::VertexHandle v, WorkMesh::VertexHandle gone, const Vec3d& p) {
    for (auto f : mesh.vf_range(v)) {
        Vec3d old_corner[3], new_corner[3];
        int k = 0;
        bool shared = false;
        for (auto u : mesh.fv_range(f)) {
            if (u == gone) shared = true;
            old_corner[k] = mesh.point(u);
            new_corner[k] = u == v ? p : mesh.point(u);
            ++k;
        }
        if (shared) continue;
        const Vec3d n0 = (old_corner[1] - old_corner[0]) % (old_corner[2] - old_corner[0]);
        const Vec3d n1 = (new_corner[1] - new_corner[0]) % (new_corner[2] - new_corner[0]);
        if ((n0 | n1) < 0.3 * n0.norm() * n1.norm()) return true;
    }
    return false;
}

template <class Size>
void collapse_short_edges(WorkMesh& mesh, const Size& size) {
    for (std::size_t i = 0; i < mesh.n_edges(); ++i) {
        const WorkMesh::EdgeHandle e{static_cast<int>(i)};
        if (mesh.status(e).deleted() || mesh.calc_edge_length(e) >= shortest * size(middle(mesh, e))) continue;
        const auto h = mesh.halfedge_handle(e, 0);
        const auto gone = mesh.from_vertex_handle(h), kept = mesh.to_vertex_handle(h);
        const Vec3d target = mesh.point(kept);
        bool too_long = false;
        for (auto u : mesh.vv_range(gone)) {
            const double wanted = size(to_eigen(0.5 * (mesh.point(u) + target)));
            too_long |= (mesh.point(u) - target).norm() > longest * wanted;
        }
        if (too_long || !mesh.is_collapse_ok(h) || flips_normal(mesh, gone, kept, target)) continue;
        mesh.collapse(h);
    }
    mesh.garbage_collection();
}

/// OpenMesh's own is compiled with assertions, in its library, and takes a tenth of all the time of a mesh.
int valence(const WorkMesh& mesh, WorkMesh::VertexHandle v) {
    int n = 0;
    const auto first = mesh.halfedge_handle(v);
    for (auto h = first; n == 0 || h != first; h = mesh.next_halfedge_handle(mesh.opposite_halfedge_handle(h))) ++n;
    return n;
}

/// Flips edges where that brings the valences nearer to six.
void equalise_valences(WorkMesh& mesh) {
    for (auto e : mesh.edges()) {
        if (!mesh.is_flip_ok(e)) continue;
        const auto h = mesh.halfedge_handle(e, 0), o = mesh.opposite_halfedge_handle(h);
        const auto a = mesh.from_vertex_handle(h), b = mesh.to_vertex_handle(h);
        const auto c = mesh.to_vertex_handle(mesh.next_halfedge_handle(h));
        const auto d = mesh.to_vertex_handle(mesh.next_halfedge_handle(o));
        auto off = [&](WorkMesh::VertexHandle v, int change) { return std::abs(valence(mesh, v) + change - 6); };
        const int before = off(a, 0) + off(b, 0) + off(c, 0) + off(d, 0);
        const int after = off(a, -1) + off(b, -1) + off(c, 1) + off(d, 1);
        if (after >= before) continue;
        const Vec3d pa = mesh.point(a), pb = mesh.point(b), pc = mesh.point(c), pd = mesh.point(d);
        const Vec3d n0 = (pb - pa) % (pc - pa), n1 = (pd - pa) % (pb - pa);
        const Vec3d m0 = (pd - pa) % (pc - pa), m1 = (pc - pb) % (pd - pb);
        const Vec3d n = n0 + n1;
        if ((n | m0) < 0.3 * n.norm() * m0.norm() || (n | m1) < 0.3 * n.norm() * m1.norm()) continue;
        mesh.flip(e);
    }
}

void smooth_and_project(WorkMesh& mesh, const TriangleTree& reference) {
    std::vector<Vec3d> target(mesh.n_vertices());
    for (auto v : mesh.vertices()) {
        Vec3d centre(0, 0, 0), normal(0, 0, 0);
        int n = 0;
        for (auto u : mesh.vv_range(v)) centre += mesh.point(u), ++n;
        centre /= n;
        for (auto f : mesh.vf_range(v)) normal += mesh.calc_face_normal(f);
        normal.normalize();
        const Vec3d p = mesh.point(v), q = centre + (normal | (p - centre)) * normal;
        target[v.idx()] = from_eigen(reference.nearest(to_eigen(p + 0.6 * (q - p))));
    }
    for (auto v : mesh.vertices())
        if (!flips_normal(mesh, v, WorkMesh::VertexHandle(), target[v.idx()])) mesh.point(v) = target[v.idx()];
}

/// Moves all vertices along their normals until the volume is the reference's: chords cut it.
void restore_volume(WorkMesh& mesh, double wanted) {
    for (int round = 0; round < 4; ++round) {
        const double missing = wanted - volume(to_surface(mesh));
        double area = 0;
        std::vector<Vec3d> normal(mesh.n_vertices(), Vec3d(0, 0, 0));
        for (auto f : mesh.faces()) {
            auto it = mesh.cfv_begin(f);
            const Vec3d a = mesh.point(*it++), b = mesh.point(*it++), c = mesh.point(*it);
            const Vec3d n = 0.5 * ((b - a) % (c - a));
            area += n.norm();
            for (auto v : mesh.fv_range(f)) normal[v.idx()] += n;
        }
        for (auto v : mesh.vertices()) mesh.point(v) += missing / area * normal[v.idx()].normalized();
    }
}

template <class Size>
void improve(WorkMesh& mesh, const TriangleTree& reference, const Size& size) {
    split_long_edges(mesh, size);
    collapse_short_edges(mesh, size);
    equalise_valences(mesh);
    smooth_and_project(mesh, reference);
}

/// Edges grow by at most so much per round: a coarse remesh in one go turns inside out.
constexpr double growth = 1.5;

}  // namespace

/// The surface after 0, 1, 2, ... rounds with edges of one length everywhere, the mean at first and `growth` times as
/// long each time: all that is remeshed to something longer has come through them.
struct Remesher::Grown {
    const TriangleTree& reference;
    std::vector<WorkMesh> after;
    double first = 0;

    explicit Grown(const TriangleTree& r) : reference(r), after{to_work_mesh(r.surface())} {
        const WorkMesh& mesh = after.front();
        for (auto e : mesh.edges()) first += mesh.calc_edge_length(e);
        first /= double(mesh.n_edges());
    }
    /// `Size`: a function as SizeField; a template, for one length everywhere is what most meshes have.
    template <class Size>
    WorkMesh remeshed(const Size& size, double smallest, double largest) {
        double bound = first;
        std::size_t round = 0;
        for (; bound <= smallest && bound < largest; ++round, bound *= growth) {
            if (round + 1 < after.size()) continue;
            WorkMesh next = after[round];
            improve(next, reference, [&](const Eigen::Vector3d&) { return bound; });
            after.push_back(std::move(next));
        }
        WorkMesh mesh = after[round];
        bound = std::min(bound, largest);
        for (int settled = 0; settled < 5; bound = std::min(largest, growth * bound)) {
            improve(mesh, reference, [&](const Eigen::Vector3d& x) { return std::min(size(x), bound); });
            settled += bound >= largest;
        }
        return mesh;
    }
};

Remesher::Remesher(const TriangleTree& reference) : grown_(std::make_unique<Grown>(reference)) {}
Remesher::~Remesher() = default;

Surface Remesher::operator()(double edge_length) {
    WorkMesh mesh = grown_->remeshed([&](const Eigen::Vector3d&) { return edge_length; }, edge_length, edge_length);
    restore_volume(mesh, volume(grown_->reference.surface()));
    return to_surface(mesh);
}

Surface Remesher::operator()(const SizeField& size) {
    double smallest = 1e300, largest = 0;
    for (const Point& p : grown_->reference.surface().vertices) {
        const double there = size({p[0], p[1], p[2]});
        smallest = std::min(smallest, there), largest = std::max(largest, there);
    }
    return to_surface(grown_->remeshed(size, smallest, largest));
}

Surface remesh(const TriangleTree& reference, double edge_length) { return Remesher(reference)(edge_length); }

}  // namespace palpate
