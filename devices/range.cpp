#include "devices/range.h"

#include "meshes/plain_numbers.h"

namespace palpate {

void check(double value, const Range& range, const char* what, const char* unit, std::vector<std::string>& wrong) {
    if (range.holds(value)) return;
    char text[200];
    plain_snprintf(text, sizeof text, "%s must be between %g and %g%s, found %g", what, range.low, range.high, unit,
                   value);
    wrong.emplace_back(text);
}

}  // namespace palpate
