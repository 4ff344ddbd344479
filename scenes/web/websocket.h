#pragma once
// The WebSocket protocol (RFC 6455): handshake and frames. Both ends use it; nothing here touches a socket.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace palpate {

using Bytes = std::vector<std::uint8_t>;

enum class Opcode : std::uint8_t { continuation = 0, text = 1, binary = 2, close = 8, ping = 9, pong = 10 };

/// A request or a response: its first line's parts, and its header fields by their names in lower case.
struct HttpHead {
    std::array<std::string, 3> line;  ///< "GET", "/frames?x=1", "HTTP/1.1"; or "HTTP/1.1", "101", "Switching Protocols"
    std::map<std::string, std::string> fields;
    std::string field(const std::string& name) const;  ///< empty where it is absent
    std::string path() const;                          ///< of a request's target, before its query
    std::string query() const;
};

/// Reads what stands before the empty line. Nothing where it is none, or where Host or Origin is there twice.
std::optional<HttpHead> parse_head(std::string_view text);

/// Sec-WebSocket-Accept for a Sec-WebSocket-Key (section 4.2.2).
std::string accept_key(std::string_view key);
/// A Sec-WebSocket-Key from 16 bytes.
std::string encode_base64(std::span<const std::uint8_t> bytes);

using Mask = std::array<std::uint8_t, 4>;
/// Appends a message as one frame; clients mask theirs.
void append_message(Bytes& out, Opcode opcode, std::span<const std::uint8_t> payload, const Mask* mask = nullptr);
std::span<const std::uint8_t> bytes_of(std::string_view text);

/// Whole messages from bytes in any pieces. It never keeps more than one message of `largest` bytes and what was added
/// last.
class MessageReader {
  public:
    struct Message {
        Opcode opcode;  ///< text, binary, close, ping or pong
        std::string payload;
    };
    /// `masked`: whether frames have to be (a client's), or must not be (a server's).
    MessageReader(std::size_t largest, bool masked) : largest_(largest), masked_(masked) {}
    void add(std::span<const std::uint8_t> bytes);
    /// The next message; nothing while it is incomplete, and for ever once `wrong()`.
    std::optional<Message> next();
    /// Close code by which the other end has broken the rules; 0: it has not.
    int wrong() const { return wrong_; }
    static constexpr int broken_rules = 1002, too_large = 1009;

  private:
    struct Header {
        Opcode opcode;
        bool last;
        std::size_t begin, size;  ///< of the payload, from taken_ on
    };
    std::optional<Header> read_header();
    std::string take_payload(const Header& header);
    std::size_t largest_;
    bool masked_;
    Bytes buffer_;
    std::size_t taken_ = 0;           ///< of the buffer
    std::optional<Message> partial_;  ///< fragments so far
    int wrong_ = 0;
};

}  // namespace palpate
