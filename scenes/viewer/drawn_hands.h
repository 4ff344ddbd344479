#pragma once
// The hands that the page draws around fingertips, as pictures do (scenes/picture/hand.h): a skin at rest, sent once,
// and where its bones are, in every frame.

#include <nlohmann/json_fwd.hpp>

#include "scenes/picture/hand.h"

namespace palpate {

/// Skin of a hand at rest: vertices [0.01 mm], the two bones that each follows, and the share of the second [%].
nlohmann::json hand_skin_json();
/// Per hand: its triangles, those of simulated fingertips left out.
nlohmann::json hands_json(const Scene& scene);

/// Hands of one run, posed again and again.
class DrawnHands {
  public:
    explicit DrawnHands(const Simulation& simulation);
    /// Per hand and bone: rows of its linear part 9 i16 [1/4096], then its translation 3 f32 [m] (rest hand -> world).
    void append(std::vector<std::uint8_t>& out, const Simulation& simulation);

  private:
    std::vector<HandPoser> hands_;
};

}  // namespace palpate
