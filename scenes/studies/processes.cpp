#include "scenes/studies/processes.h"

#include <cstdlib>

#ifdef PALPATE_MPI
#include <mpi.h>
#endif

namespace palpate {

#ifdef PALPATE_MPI

namespace {

/// Whether a launcher has started this process; MPI_Init alone would start a service of its own for every run.
bool launched() { return std::getenv("OMPI_COMM_WORLD_SIZE") || std::getenv("PMI_SIZE") || std::getenv("PMI_RANK"); }

}  // namespace

Processes join_processes() {
    Processes s;
    int started = 0;
    MPI_Initialized(&started);
    if (!started && launched()) {
        MPI_Init(nullptr, nullptr);
        std::atexit([] { MPI_Finalize(); });
        started = 1;
    }
    if (!started) return s;
    MPI_Comm_rank(MPI_COMM_WORLD, &s.rank);
    MPI_Comm_size(MPI_COMM_WORLD, &s.size);
    return s;
}

std::vector<std::string> gather(const Processes& s, const std::string& text) {
    if (s.size == 1) return {text};
    const int mine = int(text.size());
    std::vector<int> sizes(std::size_t(s.size), 0), starts(std::size_t(s.size), 0);
    MPI_Gather(&mine, 1, MPI_INT, sizes.data(), 1, MPI_INT, 0, MPI_COMM_WORLD);
    int total = 0;
    for (std::size_t i = 0; i < sizes.size(); ++i) starts[i] = total, total += sizes[i];
    std::string all(std::size_t(total), ' ');
    MPI_Gatherv(text.data(), mine, MPI_CHAR, all.data(), sizes.data(), starts.data(), MPI_CHAR, 0, MPI_COMM_WORLD);
    std::vector<std::string> texts;
    if (s.rank == 0)
        for (std::size_t i = 0; i < sizes.size(); ++i)
            texts.push_back(all.substr(std::size_t(starts[i]), std::size_t(sizes[i])));
    return texts;
}

#else

Processes join_processes() { return {}; }
std::vector<std::string> gather(const Processes&, const std::string& text) { return {text}; }

#endif

}  // namespace palpate
