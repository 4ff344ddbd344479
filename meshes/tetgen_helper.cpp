// Runs TetGen once: request on standard input, reply on standard output. A process of its own, because
// TetGen crashes, loops and allocates without bound on hostile input, and because it is AGPL-3.

#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <tetgen.h>
#include <unistd.h>

#include <cstddef>
#include <vector>

#include "meshes/tetgen_protocol.h"

namespace {

bool read_all(void* data, std::size_t size) {
    for (char* p = static_cast<char*>(data); size > 0;) {
        const ssize_t n = read(STDIN_FILENO, p, size);
        if (n <= 0) return false;
        p += n;
        size -= std::size_t(n);
    }
    return true;
}

bool write_all(const void* data, std::size_t size) {
    for (const char* p = static_cast<const char*>(data); size > 0;) {
        const ssize_t n = write(STDOUT_FILENO, p, size);
        if (n <= 0) return false;
        p += n;
        size -= std::size_t(n);
    }
    return true;
}

void limit(int resource, double value) {
    const rlimit r{rlim_t(value), rlim_t(value)};
    setrlimit(resource, &r);
}

}  // namespace

int main() {
    // Who waits for the mesh may be ended by a signal, and would leave this at work until its time limit.
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    palpate::TetgenRequest request;
    if (!read_all(&request, sizeof request)) return 1;
    request.switches[sizeof request.switches - 1] = 0;
    limit(RLIMIT_CORE, 0);
    limit(RLIMIT_FSIZE, 0);
    limit(RLIMIT_CPU, request.cpu_limit_s + 1);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    limit(RLIMIT_AS, request.memory_limit_bytes);
#endif
    std::vector<double> vertices(3 * std::size_t(request.vertex_count));
    std::vector<std::int32_t> triangles(3 * std::size_t(request.triangle_count));
    std::vector<double> holes(3 * std::size_t(request.hole_count));
    if (!read_all(vertices.data(), vertices.size() * sizeof(double)) ||
        !read_all(triangles.data(), triangles.size() * sizeof(std::int32_t)) ||
        !read_all(holes.data(), holes.size() * sizeof(double)))
        return 1;

    tetgenio in, out;
    in.firstnumber = 0;
    in.numberofpoints = request.vertex_count;
    in.pointlist = new REAL[vertices.size()];
    std::copy(vertices.begin(), vertices.end(), in.pointlist);
    in.numberoffacets = request.triangle_count;
    in.facetlist = new tetgenio::facet[request.triangle_count];
    for (int i = 0; i < request.triangle_count; ++i) {
        tetgenio::facet& f = in.facetlist[i];
        tetgenio::init(&f);
        f.numberofpolygons = 1;
        f.polygonlist = new tetgenio::polygon[1];
        tetgenio::init(&f.polygonlist[0]);
        f.polygonlist[0].numberofvertices = 3;
        f.polygonlist[0].vertexlist = new int[3]{triangles[3 * i], triangles[3 * i + 1], triangles[3 * i + 2]};
    }
    if (!holes.empty()) {
        in.numberofholes = request.hole_count;
        in.holelist = new REAL[holes.size()];
        std::copy(holes.begin(), holes.end(), in.holelist);
    }
    palpate::TetgenReply reply;
    try {
        tetrahedralize(request.switches, &in, &out);
        reply.node_count = out.numberofpoints;
        reply.tet_count = out.numberoftetrahedra;
    } catch (int code) { reply.status = code ? code : -1; } catch (...) {
        reply.status = -1;
    }
    bool sent = write_all(&reply, sizeof reply);
    if (sent && reply.status == 0)
        sent = write_all(out.pointlist, sizeof(double) * 3 * std::size_t(reply.node_count)) &&
               write_all(out.tetrahedronlist, sizeof(int) * 4 * std::size_t(reply.tet_count));
    _exit(sent ? 0 : 1);  // TetGen's destructors may free twice
}
