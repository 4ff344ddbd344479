#pragma once
// The whole state of a simulation as bytes: put back, it goes on with the same bits, in this simulation or in another
// one that was made of the same scene with the same settings.

#include <cstdint>
#include <string>
#include <vector>

#include "scenes/run/simulation.h"

namespace palpate {

/// By which damage is found.
std::uint64_t checksum(const std::uint8_t* bytes, std::size_t size);

/// Appends everything that outlives a step. Thimbles on real controllers and live hands are not part of it.
void append_state(std::vector<std::uint8_t>& out, Simulation& simulation);

/// Puts it back from [bytes, bytes + size). False with a sentence in `why` where these are no state of such a
/// simulation; nothing has changed then, unless the bytes were forged (a checksum finds damage).
bool restore_state(Simulation& simulation, const std::uint8_t* bytes, std::size_t size, std::string& why);

}  // namespace palpate
