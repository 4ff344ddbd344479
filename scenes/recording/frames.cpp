#include "scenes/recording/frames.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

namespace palpate {

namespace {

constexpr std::uint32_t largest_frame = 1u << 28;
constexpr std::size_t envelope = 12;  ///< bytes of a frame beside its payload

std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size) {
    static const auto table = [] {
        std::array<std::uint32_t, 256> t{};
        for (std::uint32_t i = 0; i < 256; ++i) {
            t[i] = i;
            for (int k = 0; k < 8; ++k) t[i] = t[i] & 1 ? 0xEDB88320u ^ (t[i] >> 1) : t[i] >> 1;
        }
        return t;
    }();
    std::uint32_t crc = ~0u;
    for (std::size_t i = 0; i < size; ++i) crc = table[(crc ^ bytes[i]) & 255] ^ (crc >> 8);
    return ~crc;
}

/// The frame that begins `at` bytes in; false where there is no whole one. Takes what checking costs off `patience`
/// [bytes], and gives up when that is spent.
bool frame_at(std::string_view bytes, std::size_t at, std::size_t& patience, Frame& frame) {
    const std::size_t left = bytes.size() - at;
    if (left < envelope) return false;
    const auto* begin = reinterpret_cast<const std::uint8_t*>(bytes.data()) + at;
    std::uint32_t size, crc;
    std::memcpy(&size, begin, 4);
    if (size > largest_frame || left < envelope + size) return false;
    std::memcpy(&frame.kind, begin + 4, 4);
    // Random bytes seldom begin like a frame: most of them need no checksum.
    if (frame.kind > 255 || patience < size) return false;
    patience -= size;
    std::memcpy(&crc, begin + 8 + size, 4);
    if (crc32(begin + 4, 4 + std::size_t(size)) != crc) return false;
    frame.payload = begin + 8, frame.size = size;
    return true;
}

constexpr int patience_ms = 1000;  ///< with who reads a pipe

/// The file, empty, and nobody else's while it is open.
int open_alone(const std::filesystem::path& path) {
    // Without O_NONBLOCK a pipe that nobody reads would be waited for, signals or not.
    const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_NONBLOCK | O_CLOEXEC, 0666);
    if (file < 0 && errno == ENXIO)
        throw InputError(path.string() + ": is a pipe that nobody reads; give the name of a file, or read it first");
    if (file < 0) throw_unwritable(path, errno);
    struct stat about {};
    if (::fstat(file, &about) != 0 || !S_ISREG(about.st_mode)) return file;
    if (::flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        ::close(file);
        throw InputError(path.string() + ": another run is being recorded into it; give another name");
    }
    if (::ftruncate(file, 0) == 0) return file;
    const int error = errno;
    ::close(file);
    throw_unwritable(path, error);
}

}  // namespace

FrameWriter::FrameWriter(std::filesystem::path path, std::string_view magic)
    : path_(std::move(path)), file_(open_alone(path_)), process_(::getpid()) {
    if (!write_all(magic.data(), magic.size())) {
        const int error = errno;
        ::close(file_);
        throw_unwritable(path_, error);
    }
    whole_ = std::int64_t(magic.size());
}

FrameWriter::~FrameWriter() { ::close(file_); }

bool FrameWriter::write_all(const void* bytes, std::size_t size) {
    const auto* at = static_cast<const char*>(bytes);
    while (size > 0) {
        const ssize_t written = ::write(file_, at, size);
        if (written < 0 && errno == EINTR) continue;
        if (written < 0 && errno == EAGAIN) {
            pollfd pipe{file_, POLLOUT, 0};
            if (::poll(&pipe, 1, patience_ms) != 0) continue;
            errno = ETIMEDOUT;  // who reads it has stopped, and the run does not
        }
        if (written <= 0) return false;
        at += written, size -= std::size_t(written);
    }
    return true;
}

void FrameWriter::append(std::uint32_t kind, const std::vector<std::uint8_t>& payload) {
    if (!failure_.empty()) return;
    if (::getpid() != process_) {
        failure_ = path_.string() + ": is recorded by the process that this one was forked from";
        return;
    }
    std::vector<std::uint8_t> bytes;
    bytes.reserve(payload.size() + envelope);
    put(bytes, std::uint32_t(payload.size()));
    put(bytes, kind);
    bytes.insert(bytes.end(), payload.begin(), payload.end());
    put(bytes, crc32(bytes.data() + 4, bytes.size() - 4));
    if (write_all(bytes.data(), bytes.size())) {
        whole_ += std::int64_t(bytes.size());
        return;
    }
    failure_ = path_.string() + ": cannot be written any further: " +
               (errno == ETIMEDOUT ? "nobody reads the pipe any more" : std::strerror(errno));
    if (::ftruncate(file_, whole_) != 0) failure_ += "; it ends within a frame";
}

std::size_t for_each_frame(std::string_view bytes, std::size_t begin, const std::function<void(const Frame&)>& visit,
                           const std::function<void(std::size_t)>& gap) {
    std::size_t end = begin;                   // of the last whole frame
    std::size_t patience = 16 * bytes.size();  // bytes made to look like frames everywhere must not take for ever
    for (std::size_t at = begin; at + envelope <= bytes.size();) {
        Frame frame;
        if (!frame_at(bytes, at, patience, frame)) {
            ++at;
            continue;
        }
        if (at > end) gap(at - end);
        visit(frame);
        at += envelope + frame.size;
        end = at;
    }
    return bytes.size() - end;
}

}  // namespace palpate
