#pragma once
// What this program is.

namespace palpate {

extern const char* const program_version;
extern const char* const program_commit;  ///< of the checkout it was built from; empty where that was none

}  // namespace palpate
