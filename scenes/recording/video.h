#pragma once
// A run as a film: WebM, GIF or MP4 by ffmpeg where that is installed, else its pictures in a folder.

#include <sys/types.h>

#include <exception>

#include "scenes/picture/still.h"

namespace palpate {

class Video {
  public:
    /// Throws InputError for endings that are none of .webm, .gif, .mp4.
    Video(std::filesystem::path path, PictureSettings settings, double rate = 30);
    ~Video();
    Video(const Video&) = delete;
    Video& operator=(const Video&) = delete;
    /// Call after every step: paints at most `rate` pictures per simulated second, and waits for ffmpeg to take them.
    /// What goes wrong ends the film, not the run: finish() throws it.
    void record(const Simulation& simulation);
    /// Ends it, and says in a sentence what there is now. Throws what went wrong.
    std::string finish();

  private:
    void begin();
    void add(const Image& image);
    std::filesystem::path path_, folder_;
    PictureSettings settings_;
    std::unique_ptr<Painter> painter_;
    double rate_, next_ = 0;
    std::exception_ptr failure_;
    int count_ = 0, pipe_ = -1;
    pid_t process_ = 0;
};

}  // namespace palpate
