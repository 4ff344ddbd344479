// What connects from outside: heads of requests, frames of WebSockets in pieces, JSON that is bounded before it is
// parsed. The first byte chooses.

#include <algorithm>
#include <nlohmann/json.hpp>

#include "scenes/web/access.h"
#include "scenes/web/bounded_json.h"
#include "scenes/web/websocket.h"

using namespace palpate;

namespace {

void read_messages(std::span<const std::uint8_t> line, bool masked, std::size_t piece) {
    MessageReader reader(1000, masked);
    std::size_t taken = 0;
    for (std::size_t at = 0; at < line.size(); at += piece) {
        reader.add(line.subspan(at, std::min(piece, line.size() - at)));
        while (const auto m = reader.next()) {
            if (m->payload.size() > 1000) __builtin_trap();
            taken += m->payload.size() + 2;
        }
    }
    if (taken > line.size()) __builtin_trap();  // more came out than went in
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size < 2) return 0;
    const std::string_view text(reinterpret_cast<const char*>(data + 2), size - 2);
    std::string wrong;
    switch (data[0] % 4) {
        case 0:
        case 1:
            read_messages({data + 2, size - 2}, data[0] % 4 == 1, 1 + data[1] % 64);
            break;
        case 2:
            if (const auto head = parse_head(text)) {
                query_value(head->query(), "token");
                is_local_origin(head->field("origin"));
                accept_key(head->field("sec-websocket-key"));
            }
            break;
        default:
            const nlohmann::json j = parse_object(text, wrong, {4096, 8});
            if (j.is_object() == !wrong.empty()) __builtin_trap();
            if (j.is_object() && (text.size() > 4096 || shown(j).size() > 40)) __builtin_trap();
    }
    return 0;
}
