#pragma once
// Files that grow by whole frames with checksums: after a kill, a crash or a full disk, everything up to the last
// complete frame can be read, and so can what lies behind damage.
//
// Layout, little-endian: 8 bytes that name format and version; then frames of u32 size, u32 kind, payload of that size,
// u32 CRC-32 of kind and payload.

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// Appends frames, each in one write. A frame that cannot be written whole is taken back, and nothing is written after
/// it.
class FrameWriter {
  public:
    /// Makes the file, or empties it, and holds a lock on it, so that no other writer does the same. Throws InputError
    /// where one does, or for a pipe that nobody reads, and as throw_unwritable (mesh_files.h) for other reasons.
    FrameWriter(std::filesystem::path path, std::string_view magic);
    ~FrameWriter();
    FrameWriter(const FrameWriter&) = delete;
    FrameWriter& operator=(const FrameWriter&) = delete;
    void append(std::uint32_t kind, const std::vector<std::uint8_t>& payload);
    /// Why no further frame could be written; empty while all is well.
    const std::string& failure() const { return failure_; }

  private:
    bool write_all(const void* bytes, std::size_t size);
    std::filesystem::path path_;
    int file_;
    int process_;             ///< whose file it is: a forked one would write between this one's frames
    std::int64_t whole_ = 0;  ///< bytes up to the end of the last complete frame
    std::string failure_;
};

struct Frame {
    std::uint32_t kind;
    const std::uint8_t* payload;
    std::size_t size;
};

/// Visits the frames of a file's bytes, `begin` bytes in, in order. Where one is damaged, looks for the next whole one,
/// and calls `gap` with the bytes between. Returns the bytes after the last whole frame.
std::size_t for_each_frame(std::string_view bytes, std::size_t begin, const std::function<void(const Frame&)>& visit,
                           const std::function<void(std::size_t)>& gap);

/// Appends a number to a payload.
template <class T>
void put(std::vector<std::uint8_t>& out, const T& value) {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(&value);
    out.insert(out.end(), bytes, bytes + sizeof value);
}

/// Reads numbers from a payload; `good` turns false where it is too short.
struct PayloadReader {
    const std::uint8_t* at;
    const std::uint8_t* end;
    bool good = true;
    explicit PayloadReader(const Frame& frame) : at(frame.payload), end(frame.payload + frame.size) {}
    std::size_t left() const { return std::size_t(end - at); }
    template <class T>
    T get() {
        T value{};
        if (left() < sizeof value) {
            good = false;
            return value;
        }
        std::memcpy(&value, at, sizeof value);
        at += sizeof value;
        return value;
    }
};

}  // namespace palpate
