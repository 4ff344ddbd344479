#pragma once
// Work that several processes share: `mpirun palpate sweep ...`. Built with MPI where it is installed (Debian's
// libopenmpi-dev); without it, and without mpirun, there is one process.

#include <string>
#include <vector>

namespace palpate {

struct Processes {
    int rank = 0, size = 1;
};

/// Joins the others where mpirun has started this process. To be called once; the end of the process leaves them.
Processes join_processes();
/// Everyone's text, by rank, in the process with rank 0; empty in others.
std::vector<std::string> gather(const Processes& processes, const std::string& text);

}  // namespace palpate
