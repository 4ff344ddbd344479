// The offline report of a world: the page that `palpate run --report` writes.

#include "scenes/viewer/report.h"

#include <cmath>

#include "scenes/api/guard.h"
#include "scenes/api/session.h"

namespace palpate::api {

void keep_frame(Session& s) {
    if (!s.frames) s.frames = std::make_shared<ReportRecorder>(s.frames_per_second);
    s.frames->record(*s.simulation);
}

void drop_frames(Session& s) { s.frames.reset(); }

std::string report_of(const Session& s) {
    const Summary summary = summarise(*s.simulation);
    if (s.frames) return s.frames->page(*s.simulation, summary);
    ReportRecorder now;
    now.record(*s.simulation);
    return now.page(*s.simulation, summary);
}

}  // namespace palpate::api

using namespace palpate::api;

int32_t palpate_keep_frames(PalpateWorld world, double per_second) {
    Owner session(world);
    if (session.result() != PALPATE_OK) return session.result();
    if (!(per_second >= 0 && per_second <= 10000))
        return fail(PALPATE_ERROR_ARGUMENT, "per_second: expected 0 (none) to 10000 frames per simulated second");
    return guarded([&] {
        session->frames_per_second = per_second;
        drop_frames(*session);
        if (per_second > 0) keep_frame(*session);
        return int32_t(PALPATE_OK);
    });
}
