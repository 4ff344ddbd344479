#pragma once
// Symbolic supernodal Cholesky factor: columns of nearly the same pattern, gathered into dense panels (relaxed
// supernodes: Ashcraft and Grimes 1989; elimination tree: Liu 1990).

#include <cstddef>
#include <vector>

namespace palpate {

struct BlockPattern;

/// Consecutive block columns that share their rows. Its panel holds the rows below each other as one dense,
/// column-major array of scalars, whose first 3 x 3 x column_count x column_count part is the lower triangle of its
/// diagonal.
struct Supernode {
    int first_column = 0, column_count = 0;
    int first_row = 0, row_count = 0;  ///< range of block rows in `rows`; the first are its own columns
    std::size_t panel = 0;             ///< offset of the panel [scalars]
    int stride = 0;                    ///< scalars from one column of the panel to the next
    int first_update = 0, update_count = 0;
};

/// How an earlier supernode changes a later one.
struct SupernodeUpdate {
    int source;                ///< supernode
    int begin, end;            ///< block rows of the source that lie in the target's columns
    int first_target_row;      ///< in `target_rows`: where the source's rows from `begin` on lie in the target
    int first_run, run_count;  ///< in `runs`: the same
};

/// Consecutive block rows of a source, from SupernodeUpdate::begin on, that are consecutive in the target, too.
struct RowRun {
    int source, target, count;
};

struct SupernodeFactor {
    std::vector<Supernode> supernodes;
    std::vector<int> rows;
    std::vector<SupernodeUpdate> updates;  ///< by target, sources ascending
    std::vector<int> target_rows;
    std::vector<RowRun> runs;
    std::vector<std::size_t> block_offset;  ///< [block of the pattern] its place in the panels [scalars]
    std::size_t panel_scalars = 0;          ///< size of all panels
    std::size_t work_scalars = 0;           ///< size of the work memory of a factorisation or a solve
    static constexpr int most_workers = 4;
    int workers = 1;  ///< threads that it pays to factor it with (supernode_threads.h): one, where it is small
};

/// Size of the work memory of all threads that may factor it at once.
inline std::size_t panel_work_scalars(const SupernodeFactor& f) { return std::size_t(f.workers) * f.work_scalars; }

/// Supernodes of a factor. Where a few zeros more let two of them merge, they do.
SupernodeFactor build_supernodes(const BlockPattern& pattern);

}  // namespace palpate
