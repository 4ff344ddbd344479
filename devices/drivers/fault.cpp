#include "devices/drivers/fault.h"

namespace palpate {

const char* name(FaultKind kind) {
    static constexpr const char* names[] = {"none",       "other",       "unplugged", "silent",    "refused",
                                            "bad reply",  "wrong servo", "reported",  "watchdog",  "overheated",
                                            "overloaded", "electrical",  "blocked",   "off course"};
    return names[int(kind)];
}

}  // namespace palpate
