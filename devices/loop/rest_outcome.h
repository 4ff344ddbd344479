#pragma once
// What is known of a thimble's rest pose once its loop was parked.

#include "devices/drivers/board.h"
#include "devices/loop/loop.h"

namespace palpate {

/// Whether a thimble is in its rest pose, as far as anybody can know.
struct RestOutcome {
    bool confirmed = false;
    std::string how;  ///< who confirmed it; or why nobody can
};

/// Whether the servos of a parked loop are where its rest pose wants them: as measured (which is waited for, for half a
/// second at most), or as taken by the controller, whose name is for the words.
RestOutcome rest_outcome(const ThimbleLoop& loop, const Board& board, const std::string& controller,
                         const std::vector<int>& channels, const std::vector<ServoCalibration>& servos);

}  // namespace palpate
