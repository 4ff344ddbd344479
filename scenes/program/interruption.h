#pragma once
// What the first Ctrl-C or SIGTERM does. Runs are ended in order: results so far are written, thimbles brought to rest.
// Before that, while scenes are read and meshed, there is nothing to end, and nobody looks whether to stop.

namespace palpate {

/// While one of these lives, the first signal ends the program at once, with exit code 130. Not while anything is armed
/// or half written.
class EndsAtOnce {
  public:
    EndsAtOnce();
    ~EndsAtOnce();
    EndsAtOnce(const EndsAtOnce&) = delete;
    EndsAtOnce& operator=(const EndsAtOnce&) = delete;
};

/// Of a signal handler: does not return where the program is to end at once.
void end_if_at_once();

}  // namespace palpate
