#include "scenes/web/websocket.h"

#include <algorithm>
#include <bit>
#include <cctype>

namespace palpate {

namespace {

std::string trimmed(std::string_view s) {
    while (!s.empty() && (s.front() == ' ' || s.front() == '\t')) s.remove_prefix(1);
    while (!s.empty() && (s.back() == ' ' || s.back() == '\t')) s.remove_suffix(1);
    return std::string(s);
}

std::string lower_case(std::string_view s) {
    std::string out(s);
    for (char& c : out) c = char(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

/// Secure Hash Algorithm 1 (FIPS 180-4), as the handshake asks for it; it guards nothing here.
std::array<std::uint8_t, 20> sha1(std::string_view text) {
    Bytes m(text.begin(), text.end());
    const std::uint64_t bits = 8 * std::uint64_t(m.size());
    m.push_back(0x80);
    while (m.size() % 64 != 56) m.push_back(0);
    for (int shift = 56; shift >= 0; shift -= 8) m.push_back(std::uint8_t(bits >> shift));
    std::array<std::uint32_t, 5> h{0x67452301, 0xEFCDAB89, 0x98BADCFE, 0x10325476, 0xC3D2E1F0};
    for (std::size_t block = 0; block < m.size(); block += 64) {
        std::array<std::uint32_t, 80> w{};
        for (std::size_t t = 0; t < 80; ++t)
            w[t] = t < 16 ? std::uint32_t(m[block + 4 * t]) << 24 | std::uint32_t(m[block + 4 * t + 1]) << 16 |
                                std::uint32_t(m[block + 4 * t + 2]) << 8 | m[block + 4 * t + 3]
                          : std::rotl(w[t - 3] ^ w[t - 8] ^ w[t - 14] ^ w[t - 16], 1);
        auto [a, b, c, d, e] = h;
        for (std::size_t t = 0; t < 80; ++t) {
            const std::uint32_t f = t < 20   ? ((b & c) | (~b & d)) + 0x5A827999
                                    : t < 40 ? (b ^ c ^ d) + 0x6ED9EBA1
                                    : t < 60 ? ((b & c) | (b & d) | (c & d)) + 0x8F1BBCDC
                                             : (b ^ c ^ d) + 0xCA62C1D6;
            const std::uint32_t next = std::rotl(a, 5) + f + e + w[t];
            e = d, d = c, c = std::rotl(b, 30), b = a, a = next;
        }
        h[0] += a, h[1] += b, h[2] += c, h[3] += d, h[4] += e;
    }
    std::array<std::uint8_t, 20> out{};
    for (std::size_t i = 0; i < 20; ++i) out[i] = std::uint8_t(h[i / 4] >> (24 - 8 * (i % 4)));
    return out;
}

}  // namespace

std::string HttpHead::field(const std::string& name) const {
    const auto it = fields.find(name);
    return it == fields.end() ? "" : it->second;
}
std::string HttpHead::path() const { return line[1].substr(0, line[1].find('?')); }
std::string HttpHead::query() const {
    const auto at = line[1].find('?');
    return at == std::string::npos ? "" : line[1].substr(at + 1);
}

std::optional<HttpHead> parse_head(std::string_view text) {
    HttpHead head;
    for (int number = 0; !text.empty(); ++number) {
        const auto end = text.find("\r\n");
        const std::string_view line = text.substr(0, end);
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 2);
        if (number == 0) {
            const auto first = line.find(' '), second = line.find(' ', first + 1);
            if (first == std::string_view::npos || second == std::string_view::npos) return {};
            head.line = {std::string(line.substr(0, first)), std::string(line.substr(first + 1, second - first - 1)),
                         std::string(line.substr(second + 1))};
            continue;
        }
        if (line.empty()) break;
        const auto colon = line.find(':');
        if (colon == std::string_view::npos) return {};
        const std::string name = lower_case(line.substr(0, colon));
        const bool fresh = head.fields.try_emplace(name, trimmed(line.substr(colon + 1))).second;
        if (!fresh && (name == "host" || name == "origin")) return {};
    }
    if (head.line[0].empty()) return {};
    return head;
}

std::string encode_base64(std::span<const std::uint8_t> bytes) {
    constexpr std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        std::uint32_t group = 0;
        for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
        for (std::size_t k = 0; k < 4; ++k) out += i + k <= bytes.size() ? digits[group >> (18 - 6 * k) & 63] : '=';
    }
    return out;
}

std::string accept_key(std::string_view key) {
    return encode_base64(sha1(std::string(key) + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"));
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

void append_message(Bytes& out, Opcode opcode, std::span<const std::uint8_t> payload, const Mask* mask) {
    const std::size_t size = payload.size();
    const std::uint8_t masked = mask ? 0x80 : 0;
    out.push_back(std::uint8_t(0x80 | std::uint8_t(opcode)));
    const int length_bytes = size < 126 ? 0 : size < 65536 ? 2 : 8;
    out.push_back(std::uint8_t(masked | (length_bytes == 0 ? size : length_bytes == 2 ? 126 : 127)));
    for (int k = length_bytes - 1; k >= 0; --k) out.push_back(std::uint8_t(std::uint64_t(size) >> (8 * k)));
    if (!mask) {
        out.insert(out.end(), payload.begin(), payload.end());
        return;
    }
    out.insert(out.end(), mask->begin(), mask->end());
    for (std::size_t i = 0; i < size; ++i) out.push_back(payload[i] ^ (*mask)[i % 4]);
}

void MessageReader::add(std::span<const std::uint8_t> bytes) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + std::ptrdiff_t(taken_));
    taken_ = 0;
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

std::optional<MessageReader::Header> MessageReader::read_header() {
    const std::span<const std::uint8_t> in = std::span<const std::uint8_t>(buffer_).subspan(taken_);
    if (in.size() < 2) return {};
    const auto opcode = std::uint8_t(in[0] & 15);
    const bool last = (in[0] & 0x80) != 0, control = opcode >= 8;
    const int length = in[1] & 127;
    const bool reserved = (in[0] & 0x70) || (opcode > 2 && opcode < 8) || opcode > 10;
    const bool out_of_order = !control && (opcode == 0) != partial_.has_value();
    if (reserved || out_of_order || ((in[1] & 0x80) != 0) != masked_ || (control && (length > 125 || !last))) {
        wrong_ = broken_rules;
        return {};
    }
    const std::size_t length_bytes = length == 126 ? 2 : length == 127 ? 8 : 0;
    if (in.size() < 2 + length_bytes) return {};
    std::uint64_t size = length_bytes ? 0 : std::uint64_t(length);
    for (std::size_t k = 0; k < length_bytes; ++k) size = size << 8 | in[2 + k];
    if (size > largest_ - (control || !partial_ ? 0 : partial_->payload.size())) {  // known from its head alone
        wrong_ = too_large;
        return {};
    }
    const std::size_t begin = 2 + length_bytes + (masked_ ? 4 : 0);
    if (in.size() < begin + size) return {};
    return Header{Opcode(opcode), last, begin, std::size_t(size)};
}

std::string MessageReader::take_payload(const Header& h) {
    const auto begin = buffer_.begin() + std::ptrdiff_t(taken_ + h.begin);
    std::string payload(begin, begin + std::ptrdiff_t(h.size));
    if (masked_)
        for (std::size_t i = 0; i < h.size; ++i)
            payload[i] = char(std::uint8_t(payload[i]) ^ *(begin - 4 + std::ptrdiff_t(i % 4)));
    taken_ += h.begin + h.size;
    return payload;
}

std::optional<MessageReader::Message> MessageReader::next() {
    while (wrong_ == 0) {
        const auto header = read_header();
        if (!header) return {};
        std::string payload = take_payload(*header);
        if (std::uint8_t(header->opcode) >= 8) return Message{header->opcode, std::move(payload)};
        if (header->opcode == Opcode::continuation)
            partial_->payload += payload;
        else
            partial_ = {header->opcode, std::move(payload)};
        if (header->last) return std::exchange(partial_, {});
    }
    return {};
}

}  // namespace palpate
