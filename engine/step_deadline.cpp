#include <algorithm>

#include "engine/systems.h"

namespace palpate {

namespace {

template <class Visit>
void for_each_cut(SkinChunks& chunks, BodySolve& bodies, Visit visit) {
    std::size_t k = 0;
    chunks.for_each([&](auto& c) { visit(c.cut, k++); });
    visit(bodies.cut, k);
}

}  // namespace

void begin_cuts(std::chrono::steady_clock::time_point start, double reserve, const StepDeadline& d, SkinChunks& chunks,
                BodySolve& bodies) {
    auto until = StepCut::Time::max();
    if (d.limit > 0)
        until = start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                            std::chrono::duration<double>(std::max(0.0, d.limit - reserve)));
    for_each_cut(chunks, bodies, [&](StepCut& cut, std::size_t k) {
        const bool repeats = k < d.given.size() && d.given[k] >= 0;
        cut.begin(d.given.empty() ? until : StepCut::Time::max(), repeats ? d.given[k] : -1);
    });
}

void end_cuts(StepDeadline& d, SkinChunks& chunks, BodySolve& bodies) {
    if (d.limit <= 0 && d.given.empty() && !d.cut_short) return;
    d.cuts.resize(std::size_t(chunks.count()) + 1);  // chunks are as many in every step
    d.cut_short = false;
    for_each_cut(chunks, bodies, [&](const StepCut& cut, std::size_t k) {
        d.cuts[k] = cut.at;
        d.cut_short |= cut.at >= 0;
    });
}

}  // namespace palpate
