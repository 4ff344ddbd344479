#include "scenes/recording/live_tables.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "meshes/mesh_files.h"
#include "scenes/load/result_files.h"

namespace palpate {

namespace fs = std::filesystem;

namespace {
/// Row of an object's body, released or not yet; -1: it has none.
int body_of(const VirtualObject& o) { return std::max(o.body, o.held_body); }
}  // namespace

std::vector<NamedSeries> tables_of(const Simulation& s) {
    std::vector<NamedSeries> tables;
    for (std::size_t i = 0; i < s.finger_series.size(); ++i)
        tables.push_back({result_file::finger_table(s.scene.spec.fingers[i].name), &s.finger_series[i]});
    for (const VirtualObject& o : s.world.shapes)
        if (const int body = body_of(o); body >= 0)
            tables.push_back({result_file::object_table(o.name), &s.body_series[std::size_t(body)]});
    for (std::size_t k = 0; k < s.soft_series.size(); ++k)
        tables.push_back({result_file::object_table(s.world.soft.all[k].skin.name), &s.soft_series[k]});
    tables.push_back({result_file::steps, &s.step_series});
    return tables;
}

namespace {

/// A file that grows. `error` is errno of the first write that failed.
struct GrowingFile {
    fs::path path;
    int file = -1, error = 0;
    std::size_t columns = 0, taken = 0;  ///< numbers of the series that were handed over
    std::vector<double> waiting;         ///< handed over, not yet written
    std::vector<double> writing;         ///< of the thread

    void open() {
        file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
        if (file < 0) throw_unwritable(path, errno);
    }
    void append(const std::string& text) {
        for (std::size_t at = 0; at < text.size() && error == 0;) {
            const ssize_t n = ::write(file, text.data() + at, text.size() - at);
            if (n > 0) at += std::size_t(n);
            if (n <= 0 && errno != EINTR) error = n < 0 ? errno : ENOSPC;
        }
    }
};

}  // namespace

struct LiveTables::Work {
    fs::path folder;
    std::vector<GrowingFile> tables;
    std::mutex lock;  ///< of what waits; the step does not wait for it
    std::condition_variable wake;
    bool ending = false;
    std::thread writer;

    ~Work() {
        end();
        for (GrowingFile& t : tables)
            if (t.file >= 0) ::close(t.file);
    }
    void end() {
        {
            const std::lock_guard guard(lock);
            ending = true;
        }
        wake.notify_all();
        if (writer.joinable()) writer.join();
    }
    void write_all() {
        std::string text;
        for (bool last = false; !last;) {
            {
                std::unique_lock guard(lock);
                wake.wait_for(guard, std::chrono::seconds(1), [&] { return ending; });
                last = ending;
                for (GrowingFile& t : tables) t.writing.swap(t.waiting);
            }
            for (GrowingFile& t : tables) {
                text.clear();
                append_rows(text, t.writing, t.columns);
                t.append(text);
                t.writing.clear();
            }
        }
    }
    /// What a series has gained. The caller holds the lock.
    static void take(GrowingFile& t, const Series& series) {
        const auto from = series.values.begin() + std::ptrdiff_t(t.taken);
        t.waiting.insert(t.waiting.end(), from, series.values.end());
        t.taken = series.values.size();
    }
};

LiveTables::LiveTables(const fs::path& folder, const Simulation& s) : work_(std::make_unique<Work>()) {
    Work& w = *work_;
    w.folder = folder;
    write_file(
        folder / note,
        "A run of palpate is going on, or was killed: the tables here end up to a second before it did, maybe in "
        "the middle of a row.\nA run that ends moves its files to the folder above. The next run into that folder "
        "removes what is here.\n");
    for (const NamedSeries& named : tables_of(s)) {
        GrowingFile& t = w.tables.emplace_back();
        t.path = folder / named.file;
        t.columns = named.series->columns.size();
        t.open();
        std::string header;
        append_header(header, *named.series);
        t.append(header);
        t.waiting.reserve(4096 * t.columns), t.writing.reserve(4096 * t.columns);
    }
    w.writer = std::thread([&w] { w.write_all(); });
}

LiveTables::~LiveTables() = default;

void LiveTables::record(const Simulation& s) {
    Work& w = *work_;
    const std::unique_lock guard(w.lock, std::try_to_lock);
    if (!guard) return;  // the next step hands over both
    std::size_t k = 0;
    const auto take = [&](const Series& series) { Work::take(w.tables[k++], series); };
    for (const Series& series : s.finger_series) take(series);
    for (const VirtualObject& o : s.world.shapes)
        if (body_of(o) >= 0) take(s.body_series[std::size_t(body_of(o))]);
    for (const Series& series : s.soft_series) take(series);
    take(s.step_series);
}

void LiveTables::finish(const Simulation& s) {
    Work& w = *work_;
    {
        const std::lock_guard guard(w.lock);
        const std::vector<NamedSeries> tables = tables_of(s);
        for (std::size_t k = 0; k < tables.size(); ++k) Work::take(w.tables[k], *tables[k].series);
    }
    w.end();
    for (const GrowingFile& t : w.tables)
        if (t.error != 0) throw_unwritable(t.path, t.error);
    fs::remove(w.folder / note);
}

}  // namespace palpate
