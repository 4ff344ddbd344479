#include "devices/drivers/text_protocol.h"

#include <algorithm>
#include <charconv>
#include <stdexcept>

namespace palpate::text {

namespace {

constexpr std::string_view digits = "0123456789ABCDEF";

/// Text in a buffer of fixed size; `full` once something did not fit.
struct Buffer {
    std::span<char> out;
    std::size_t size = 0;
    bool full = false;
    void put(std::string_view s) noexcept {
        full |= s.size() > out.size() - size;
        if (!full) size += std::size_t(std::copy(s.begin(), s.end(), out.data() + size) - (out.data() + size));
    }
    void put(unsigned n) noexcept {
        char text[10];
        std::size_t at = sizeof text;
        do text[--at] = char('0' + n % 10);
        while (n /= 10);
        put(std::string_view(text + at, sizeof text - at));
    }
    void end_line() noexcept {
        if (full) return;
        const std::uint16_t crc = checksum({out.data(), size});
        put("*");
        for (int shift = 12; shift >= 0; shift -= 4) put(digits.substr(crc >> shift & 15, 1));
        put("\n");
    }
};

/// What stands before the checksum, if that is right.
std::optional<std::string_view> checked(std::string_view line) {
    if (line.size() < 6 || line[line.size() - 5] != '*') return {};
    unsigned expected = 0;
    for (const char c : line.substr(line.size() - 4)) {
        const auto digit = digits.find(c);
        if (digit == std::string_view::npos) return {};
        expected = expected << 4 | unsigned(digit);
    }
    line.remove_suffix(5);
    if (checksum(line) != expected) return {};
    return line;
}

std::optional<Reply> parse(std::string_view line) {
    const auto text = checked(line);
    if (!text) return {};
    Reply r;
    const char* end = text->data() + text->size();
    const auto [behind, error] = std::from_chars(text->data(), end, r.number);
    const std::string_view rest(behind, std::size_t(end - behind));
    if (error != std::errc() || r.number > 60000) return {};
    r.ok = rest == " ok" || rest.starts_with(" ok ");
    if (!r.ok && !rest.starts_with(" err ")) return {};
    r.words = rest.substr(std::min(rest.size(), std::size_t(r.ok ? 4 : 5)));
    return r;
}

}  // namespace

std::uint16_t checksum(std::string_view text) noexcept {
    unsigned crc = 0xFFFF;
    for (const char c : text) {
        crc ^= unsigned(std::uint8_t(c)) << 8;
        for (int k = 0; k < 8; ++k) crc = (crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1) & 0xFFFF;
    }
    return std::uint16_t(crc);
}

std::string line_of(unsigned number, std::string_view words) {
    char out[longest_line];
    Buffer b{out};
    b.put(number), b.put(" "), b.put(words), b.end_line();
    if (b.full) throw std::invalid_argument("a line of the text protocol has at most 180 bytes");
    return {out, b.size};
}

std::size_t encode_targets(unsigned number, std::string_view verb, std::span<const ChannelTarget> targets,
                           std::span<char> out) noexcept {
    Buffer b{out.first(std::min(out.size(), longest_line))};
    b.put(number), b.put(" "), b.put(verb);
    for (const ChannelTarget& t : targets) b.put(" "), b.put(unsigned(t.channel)), b.put("="), b.put(t.value);
    b.end_line();
    return b.full ? 0 : b.size;
}

std::string_view Reply::word(std::string_view key) const {
    for (std::string_view rest = words; !rest.empty();) {
        const std::string_view pair = rest.substr(0, rest.find(' '));
        rest.remove_prefix(std::min(rest.size(), pair.size() + 1));
        if (pair.size() > key.size() && pair.starts_with(key) && pair[key.size()] == '=')
            return pair.substr(key.size() + 1);
    }
    return {};
}

std::optional<int> Reply::value(std::string_view key) const {
    const std::string_view w = word(key);
    int v = 0;
    const auto [end, error] = std::from_chars(w.data(), w.data() + w.size(), v);
    if (w.empty() || error != std::errc() || end != w.data() + w.size()) return {};
    return v;
}

std::optional<Reply> ReplyReader::next() {
    for (auto end = waiting_.find('\n'); end != std::string::npos; end = waiting_.find('\n')) {
        std::string line = waiting_.substr(0, end);
        waiting_.erase(0, end + 1);
        if (line.ends_with('\r')) line.pop_back();
        if (line.size() <= longest_line)
            if (auto r = parse(line)) return r;
        dropped += !line.empty();
    }
    if (waiting_.size() > longest_line) waiting_.erase(0, waiting_.size() - longest_line);
    return {};
}

}  // namespace palpate::text
