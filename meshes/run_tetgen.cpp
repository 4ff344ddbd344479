#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/tetgen_protocol.h"
#include "meshes/tetrahedralise.h"

extern char** environ;

namespace palpate {

namespace {

using Clock = std::chrono::steady_clock;

/// The program, or the shared library, that this code is in.
std::filesystem::path own_file() {
    Dl_info info;
    return dladdr(reinterpret_cast<const void*>(&own_file), &info) && info.dli_fname ? info.dli_fname : "";
}

/// The helper lies beside the running program, or where it was built or installed.
std::string helper_path() {
    std::error_code error;
    const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
    const auto library = own_file().parent_path();
    for (const auto& folder :
         {self.parent_path(), library, library / "../bin", library / "../../bin",
          std::filesystem::path(PALPATE_HELPER_BUILD_DIR), std::filesystem::path(PALPATE_HELPER_INSTALL_DIR)})
        if (std::filesystem::exists(folder / "palpate-tetgen", error)) return (folder / "palpate-tetgen").string();
    // A program that embeds this, where palpate is installed under another prefix.
    std::istringstream folders(std::getenv("PATH") ? std::getenv("PATH") : "");
    for (std::string folder; std::getline(folders, folder, ':');)
        if (!folder.empty() && std::filesystem::exists(std::filesystem::path(folder) / "palpate-tetgen", error))
            return (std::filesystem::path(folder) / "palpate-tetgen").string();
    throw InputError("the mesher's helper 'palpate-tetgen' was not found beside the program; install palpate again");
}

/// A running helper: one close-on-exec socket, and the duty to reap it.
class Helper {
  public:
    Helper() {
        int ends[2];
        if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
            throw InputError(std::string("cannot create a socket for the mesher: ") + std::strerror(errno));
        socket_ = ends[0];
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
        posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
        posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
        std::string path = helper_path();
        char* argv[] = {path.data(), nullptr};
        const int error = posix_spawn(&pid_, path.c_str(), &actions, nullptr, argv, environ);
        posix_spawn_file_actions_destroy(&actions);
        close(ends[1]);
        if (error != 0) {
            close(socket_);
            throw InputError(std::string("cannot start the mesher's helper: ") + std::strerror(error));
        }
    }
    ~Helper() {
        close(socket_);
        if (pid_ > 0) {
            kill(pid_, SIGKILL);
            wait_status();
        }
    }
    Helper(const Helper&) = delete;
    Helper& operator=(const Helper&) = delete;

    bool send_all(const void* data, std::size_t size, Clock::time_point deadline) {
        return transfer(POLLOUT, size, deadline, [&, p = static_cast<const char*>(data)](std::size_t n) mutable {
            const ssize_t sent = send(socket_, p, n, MSG_NOSIGNAL | MSG_DONTWAIT);
            if (sent > 0) p += sent;
            return sent;
        });
    }
    bool receive_all(void* data, std::size_t size, Clock::time_point deadline) {
        return transfer(POLLIN, size, deadline, [&, p = static_cast<char*>(data)](std::size_t n) mutable {
            const ssize_t got = recv(socket_, p, n, MSG_DONTWAIT);
            if (got > 0) p += got;
            return got;
        });
    }
    bool timed_out() const { return timed_out_; }

    /// How the helper ended, in words.
    std::string ending() {
        kill(pid_, timed_out_ ? SIGKILL : SIGCONT);
        const int status = wait_status();
        if (timed_out_) return "it ran past the time limit";
        if (WIFSIGNALED(status)) {
            if (WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL) return "it ran past the time limit";
            return std::string("it crashed (") + strsignal(WTERMSIG(status)) + ") or met the memory limit";
        }
        return "it gave no answer";
    }

  private:
    int wait_status() {
        int status = 0;
        while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {}
        pid_ = -1;
        return status;
    }
    template <class Move>
    bool transfer(short event, std::size_t size, Clock::time_point deadline, Move move) {
        while (size > 0) {
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
            pollfd p{socket_, event, 0};
            const int ready = left > 0 ? poll(&p, 1, int(left)) : 0;
            if (ready < 0 && errno == EINTR) continue;
            if (ready == 0) timed_out_ = true;
            if (ready <= 0) return false;
            const ssize_t n = move(size);
            if (n < 0 && (errno == EAGAIN || errno == EINTR)) continue;
            if (n <= 0) return false;
            size -= std::size_t(n);
        }
        return true;
    }
    int socket_ = -1;
    pid_t pid_ = -1;
    bool timed_out_ = false;
};

}  // namespace

TetMesh run_tetgen(const Surface& surface, const std::string& switches, const TetrahedraliseSettings& settings,
                   const std::vector<Point>& holes, SurfaceUse use) {
    if (!holes.empty()) use = SurfaceUse::object;                                           // of several parts
    if (auto wrong = check_surface(surface, use); !wrong.empty()) throw InputError(wrong);  // TetGen crashes on such
    TetgenRequest request;
    request.vertex_count = int(surface.vertices.size());
    request.triangle_count = int(surface.triangles.size());
    request.hole_count = int(holes.size());
    request.cpu_limit_s = settings.time_limit_s;
    request.memory_limit_bytes = settings.memory_limit_MiB * 1048576;
    std::strncpy(request.switches, (switches + "Q").c_str(), sizeof request.switches - 1);

    Helper helper;
    const auto deadline = Clock::now() + std::chrono::milliseconds(long(1000 * settings.time_limit_s));
    TetgenReply reply;
    const bool answered =
        helper.send_all(&request, sizeof request, deadline) &&
        helper.send_all(surface.vertices.data(), surface.vertices.size() * sizeof(Point), deadline) &&
        helper.send_all(surface.triangles.data(), surface.triangles.size() * 3 * sizeof(int), deadline) &&
        helper.send_all(holes.data(), holes.size() * sizeof(Point), deadline) &&
        helper.receive_all(&reply, sizeof reply, deadline);
    if (!answered) throw InputError("TetGen could not fill the surface: " + helper.ending());
    if (reply.status != 0)
        throw InputError("TetGen refused the surface (its code " + std::to_string(reply.status) +
                         (reply.status == 3 ? ": it intersects itself)" : ")"));
    TetMesh mesh;
    mesh.nodes.resize(std::size_t(std::max(0, reply.node_count)));
    mesh.tets.resize(std::size_t(std::max(0, reply.tet_count)));
    if (mesh.tets.empty()) throw InputError("TetGen returned no tetrahedra; is the surface closed?");
    if (!helper.receive_all(mesh.nodes.data(), mesh.nodes.size() * sizeof(Point), deadline) ||
        !helper.receive_all(mesh.tets.data(), mesh.tets.size() * 4 * sizeof(int), deadline))
        throw InputError("TetGen's answer broke off: " + helper.ending());
    return mesh;
}

}  // namespace palpate
