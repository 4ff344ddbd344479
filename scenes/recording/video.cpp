#include "scenes/recording/video.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <sstream>

#include "meshes/input_error.h"
#include "meshes/mesh_files.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {

bool is_installed(const std::string& program) {
    const char* path = std::getenv("PATH");
    std::istringstream folders(path ? path : "/usr/bin:/bin");
    for (std::string folder; std::getline(folders, folder, ':');)
        if (::access((fs::path(folder) / program).c_str(), X_OK) == 0) return true;
    return false;
}

std::vector<std::string> ffmpeg_arguments(const fs::path& path, const PictureSettings& s, double rate) {
    std::ostringstream size, frames;
    size << s.width << "x" << s.height;
    frames << rate;
    std::vector<std::string> out{"ffmpeg", "-loglevel", "error",    "-y", "-f",         "rawvideo", "-pix_fmt",
                                 "rgb24",  "-s",        size.str(), "-r", frames.str(), "-i",       "-"};
    const std::string ending = path.extension().string();
    if (ending == ".webm")
        out.insert(out.end(), {"-c:v", "libvpx-vp9", "-crf", "34", "-b:v", "0", "-deadline", "realtime", "-cpu-used",
                               "6", "-pix_fmt", "yuv420p"});
    if (ending == ".mp4") out.insert(out.end(), {"-crf", "24", "-pix_fmt", "yuv420p"});
    if (ending == ".gif")
        out.insert(out.end(),
                   {"-vf", "fps=15,split[a][b];[a]palettegen=max_colors=96[p];[b][p]paletteuse=dither=none"});
    out.push_back(fs::absolute(path).string());
    return out;
}

}  // namespace

Video::Video(fs::path path, PictureSettings settings, double rate)
    : path_(std::move(path)), settings_(settings), rate_(rate) {
    const std::string ending = path_.extension().string();
    if (ending != ".webm" && ending != ".gif" && ending != ".mp4")
        throw InputError("--video " + path_.string() + ": ends in \"" + ending + "\"; expected .webm, .gif or .mp4");
    settings_.width &= ~1, settings_.height &= ~1;  // what codecs take
}

Video::~Video() {
    if (pipe_ >= 0) ::close(pipe_);
    if (process_ > 0) ::waitpid(process_, nullptr, 0);
}

void Video::begin() {
    if (path_.has_parent_path()) fs::create_directories(path_.parent_path());
    if (!is_installed("ffmpeg")) {
        folder_ = path_.parent_path() / (path_.stem().string() + "_frames");
        std::error_code error;
        fs::create_directories(folder_, error);
        if (error) throw_unwritable(folder_, error.value());
        return;
    }
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC) != 0) throw_unwritable(path_, errno);
    const std::vector<std::string> arguments = ffmpeg_arguments(path_, settings_, rate_);
    std::vector<char*> raw;
    for (const std::string& a : arguments) raw.push_back(const_cast<char*>(a.c_str()));
    raw.push_back(nullptr);
    process_ = ::fork();
    if (process_ == 0) {
        ::dup2(ends[0], STDIN_FILENO);
        ::setpgid(0, 0);  // Ctrl-C ends the run, and the film with the run
        ::execvp("ffmpeg", raw.data());
        ::_exit(127);
    }
    ::close(ends[0]);
    pipe_ = ends[1];
    ::signal(SIGPIPE, SIG_IGN);
}

void Video::add(const Image& image) {
    if (pipe_ < 0) {
        char name[32];
        std::snprintf(name, sizeof name, "frame_%05d.png", count_);
        write_png(folder_ / name, image);
        return;
    }
    for (std::size_t done = 0; done < image.rgb.size();) {
        const ssize_t n = ::write(pipe_, image.rgb.data() + done, image.rgb.size() - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) throw InputError("--video " + path_.string() + ": ffmpeg has ended early; its message is above");
        done += std::size_t(n);
    }
}

void Video::record(const Simulation& s) {
    if (failure_ || s.world.time + 1e-9 < next_) return;
    next_ = s.world.time + 1 / rate_ - 1e-9;
    try {
        if (!painter_) painter_ = std::make_unique<Painter>(s, settings_), begin();
        add(painter_->paint(s));
        ++count_;
    } catch (const std::exception&) { failure_ = std::current_exception(); }
}

std::string Video::finish() {
    if (failure_) std::rethrow_exception(failure_);
    if (count_ == 0) return "no picture, no film";
    if (pipe_ < 0)
        return std::to_string(count_) + " pictures in " + folder_.string() +
               ", for ffmpeg is not installed: with it they would be " + path_.filename().string();
    ::close(std::exchange(pipe_, -1));
    int status = 0;
    ::waitpid(std::exchange(process_, 0), &status, 0);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        throw InputError("--video " + path_.string() + ": ffmpeg failed; its message is above");
    return path_.string() + ": " + std::to_string(count_) + " pictures";
}

}  // namespace palpate
