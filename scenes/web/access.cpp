#include "scenes/web/access.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <stdexcept>

namespace palpate {

std::string random_token() {
    std::array<std::uint8_t, 16> bytes{};
    if (getrandom(bytes.data(), bytes.size(), 0) != ssize_t(bytes.size()))
        throw std::runtime_error("the system gives no random numbers for a token");
    std::string token;
    for (const std::uint8_t b : bytes)
        for (const int digit : {b >> 4, b & 15}) token += "0123456789abcdef"[digit];
    return token;
}

bool same_token(std::string_view given, std::string_view expected) {
    unsigned different = given.size() != expected.size();
    for (std::size_t i = 0; i < expected.size(); ++i)
        different |= unsigned(std::uint8_t(expected[i])) ^ unsigned(std::uint8_t(i < given.size() ? given[i] : 0));
    return different == 0 && !expected.empty();
}

bool is_local_origin(std::string_view origin) {
    for (const std::string_view scheme : {"http://", "https://"})
        for (const std::string_view name : {"127.0.0.1", "localhost", "[::1]"}) {
            if (!origin.starts_with(scheme) || !origin.substr(scheme.size()).starts_with(name)) continue;
            const std::string_view rest = origin.substr(scheme.size() + name.size());
            if (rest.empty()) return true;
            const std::string_view port = rest.substr(1);
            return rest[0] == ':' && !port.empty() && port.size() <= 5 &&
                   std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; });
        }
    return false;
}

std::string_view query_value(std::string_view query, std::string_view key) {
    while (!query.empty()) {
        const std::string_view pair = query.substr(0, query.find('&'));
        query.remove_prefix(std::min(query.size(), pair.size() + 1));
        if (pair.size() > key.size() && pair.starts_with(key) && pair[key.size()] == '=')
            return pair.substr(key.size() + 1);
    }
    return {};
}

}  // namespace palpate
