#pragma once

namespace palpate {

/// Seconds of the clock that boards and device threads run on; it never goes back.
double device_clock();

}  // namespace palpate
