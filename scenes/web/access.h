#pragma once
// Who may connect: tokens, and the origins of web pages.

#include <string>
#include <string_view>

namespace palpate {

/// 128 random bits from the system, as 32 hexadecimal digits. Throws std::runtime_error where the system has none.
std::string random_token();

/// Whether two texts are the same, in a time that does not tell how much of them is.
bool same_token(std::string_view given, std::string_view expected);

/// Whether an Origin is a page of this machine: exactly http:// or https://, then 127.0.0.1, localhost or [::1], then
/// nothing or a port.
bool is_local_origin(std::string_view origin);

/// The value of `key` in the query of a URL ("token=1f&still=1"); empty if it has none.
std::string_view query_value(std::string_view query, std::string_view key);

}  // namespace palpate
