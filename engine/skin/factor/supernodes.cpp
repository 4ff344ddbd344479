#include "engine/skin/factor/supernodes.h"

#include <algorithm>

#include "engine/skin/chunks/topology.h"

namespace palpate {

namespace {

struct Columns {
    int first, count;
    std::vector<int> rows;  ///< with its own columns
    double blocks;          ///< that are not zeros added by merging
};

/// Of one supernode: one thread factors it, and what it reads again and again fits a cache.
constexpr int most_columns = 64;
/// Size of a factor from which several threads pay.
constexpr std::size_t scalars_worth_threads = 400'000;

/// Blocks of a trapezoid of `columns` columns, the first of them `rows` high.
double trapezoid(double columns, double rows) { return columns * rows - columns * (columns - 1) / 2; }

/// Whether `later`, which follows `earlier` in the elimination, may take it in: all rows fit, and few zeros are added.
bool worth_merging(const Columns& earlier, const Columns& later) {
    if (earlier.count + later.count > most_columns) return false;
    if (int(earlier.rows.size()) == earlier.count) return false;
    const int parent = earlier.rows[std::size_t(earlier.count)];
    if (parent >= later.first + later.count) return false;
    const int width = earlier.count + later.count;
    const double all = trapezoid(width, earlier.count + double(later.rows.size()));
    const double zeros = all - earlier.blocks - later.blocks;
    return zeros <= (width <= 4 ? 0.3 : width <= 12 ? 0.15 : 0.05) * all;
}

std::vector<Columns> merged_columns(const BlockPattern& p) {
    std::vector<Columns> out;
    for (int j = 0; j < p.columns; ++j) {
        Columns next{j, 1, {p.row.begin() + p.column_start[j], p.row.begin() + p.column_start[j + 1]}, 0};
        next.blocks = double(next.rows.size());
        while (!out.empty() && worth_merging(out.back(), next)) {
            const Columns& earlier = out.back();
            std::vector<int> rows(std::size_t(earlier.count));
            for (int k = 0; k < earlier.count; ++k) rows[std::size_t(k)] = earlier.first + k;
            rows.insert(rows.end(), next.rows.begin(), next.rows.end());
            next = {earlier.first, earlier.count + next.count, std::move(rows), earlier.blocks + next.blocks};
            out.pop_back();
        }
        out.push_back(std::move(next));
    }
    return out;
}

}  // namespace

SupernodeFactor build_supernodes(const BlockPattern& p) {
    constexpr int padding = 16;  // scalars: the widest register
    SupernodeFactor f;
    std::vector<int> supernode_of(std::size_t(p.columns));
    int most_rows = 0;
    for (const Columns& c : merged_columns(p)) {
        for (int k = 0; k < c.count; ++k) supernode_of[std::size_t(c.first + k)] = int(f.supernodes.size());
        Supernode s;
        s.first_column = c.first, s.column_count = c.count;
        s.first_row = int(f.rows.size()), s.row_count = int(c.rows.size());
        s.panel = f.panel_scalars;
        // Whole registers are read and written from any row on: room for one more behind the last.
        s.stride = (3 * s.row_count + 2 * padding - 1) / padding * padding;
        f.panel_scalars += std::size_t(3 * s.column_count) * std::size_t(s.stride);
        f.rows.insert(f.rows.end(), c.rows.begin(), c.rows.end());
        most_rows = std::max(most_rows, s.row_count);
        f.supernodes.push_back(s);
    }
    f.panel_scalars += padding;
    f.work_scalars = std::size_t(3 * most_rows + 2 * padding);  // a solve's

    std::vector<std::vector<SupernodeUpdate>> updates(f.supernodes.size());
    for (int source = 0; source < int(f.supernodes.size()); ++source) {
        const Supernode& s = f.supernodes[std::size_t(source)];
        auto row = [&](int i) { return f.rows[std::size_t(s.first_row + i)]; };
        for (int begin = s.column_count; begin < s.row_count;) {
            const int target = supernode_of[std::size_t(row(begin))];
            const Supernode& t = f.supernodes[std::size_t(target)];
            int end = begin;
            while (end < s.row_count && row(end) < t.first_column + t.column_count) ++end;
            const std::size_t columns = std::size_t(3 * (end - begin));
            f.work_scalars = std::max(f.work_scalars, columns * std::size_t(3 * (s.row_count - begin) + 2 * padding));
            SupernodeUpdate update{source, begin, end, int(f.target_rows.size()), int(f.runs.size()), 0};
            auto at = f.rows.begin() + t.first_row;
            for (int i = begin; i < s.row_count; ++i) {
                at = std::find(at, f.rows.begin() + t.first_row + t.row_count, row(i));
                const int place = int(at - f.rows.begin()) - t.first_row;
                if (i > begin && place == f.target_rows.back() + 1)
                    ++f.runs.back().count;
                else
                    f.runs.push_back({i - begin, place, 1});
                f.target_rows.push_back(place);
            }
            update.run_count = int(f.runs.size()) - update.first_run;
            updates[std::size_t(target)].push_back(update);
            begin = end;
        }
    }
    if (f.panel_scalars > scalars_worth_threads) f.workers = SupernodeFactor::most_workers;
    for (std::size_t t = 0; t < updates.size(); ++t) {
        f.supernodes[t].first_update = int(f.updates.size());
        f.supernodes[t].update_count = int(updates[t].size());
        f.updates.insert(f.updates.end(), updates[t].begin(), updates[t].end());
    }
    f.block_offset.resize(std::size_t(p.block_count));
    for (int j = 0; j < p.columns; ++j) {
        const Supernode& s = f.supernodes[std::size_t(supernode_of[std::size_t(j)])];
        auto at = f.rows.begin() + s.first_row;
        for (int b = p.column_start[j]; b < p.column_start[j + 1]; ++b) {
            at = std::find(at, f.rows.begin() + s.first_row + s.row_count, p.row[std::size_t(b)]);
            f.block_offset[std::size_t(b)] = s.panel + std::size_t(3 * (j - s.first_column)) * std::size_t(s.stride) +
                                             3 * std::size_t(at - f.rows.begin() - s.first_row);
        }
    }
    return f;
}

}  // namespace palpate
