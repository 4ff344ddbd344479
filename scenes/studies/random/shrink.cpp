#include "scenes/studies/random/shrink.h"

namespace palpate {

namespace {

/// Removes entries of a list one by one, from the last, where what is left still fails.
template <class List, class Try>
bool drop_entries(List& list, std::size_t first, int& tries, Try fails_without) {
    bool dropped = false;
    for (std::size_t i = list.size(); i-- > first && tries > 0;) {
        const auto kept = list[i];
        list.erase(list.begin() + std::ptrdiff_t(i));
        --tries;
        if (fails_without()) {
            dropped = true;
            continue;
        }
        list.insert(list.begin() + std::ptrdiff_t(i), kept);
    }
    return dropped;
}

}  // namespace

RandomScene shrink_scene(RandomScene scene, const std::function<bool(const RandomScene&)>& still_fails, int tries) {
    auto fails = [&] { return still_fails(scene); };
    while (drop_entries(scene.blocks, 1, tries, fails) && tries > 0) {}
    for (std::size_t b = 1; b < scene.blocks.size(); ++b) drop_entries(scene.blocks[b], 1, tries, fails);
    return scene;
}

}  // namespace palpate
