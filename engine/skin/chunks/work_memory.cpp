#include "engine/skin/chunks/work_memory.h"

#include <algorithm>
#include <thread>

#include "engine/skin/chunks/fields.h"

namespace palpate {

namespace {

/// Bytes of work memory from which on chunks take turns: fewer stay in the cache, and keep their factors.
constexpr std::size_t shared_from_bytes = 4 << 20;

template <class T>
std::size_t work_bytes(SkinChunk<T>& c) {
    std::size_t bytes = 0;
    for_each_field(c, [&](const auto& a, const Field& f) {
        if (f.role == Role::work) bytes += a.size() * sizeof(a[0]);
    });
    return bytes;
}

/// A chunk with nothing but work memory, for chunks like this one.
template <class T>
SkinChunk<T> work_of(const SkinChunk<T>& like) {
    SkinChunk<T> c;
    c.topology = like.topology;
    c.material = like.material;
    c.width = c.contacts.width = like.width;
    c.contacts.capacity = like.contacts.capacity;
    c.has_limits = like.has_limits;
    for_each_field(c, [&](auto& array, const Field& f) {
        if (f.role == Role::work) array.resize(numbers_per_lane(f, 0) * std::size_t(c.width));
    });
    c.scratch.outward.resize(like.topology->samples.size() * std::size_t(like.width));
    c.scratch.changed_columns.resize(like.scratch.changed_columns.size());
    c.scratch.candidate_limits.resize(like.scratch.loaded_limits.size(), all_lanes);
    return c;
}

/// Whether the first finger of one chunk, and all of the other, have the same rest data.
template <class T>
bool are_alike(SkinChunk<T>& a, SkinChunk<T>& b) {
    bool alike = true;
    for_each_field_of_both(a, b, [&](const auto& of_a, const auto& of_b, const Field&) {
        if constexpr (requires { of_a.is_shared(); }) {
            const auto of_one = std::size_t(a.width), of_all = std::size_t(b.width);
            for (std::size_t i = 0; i < of_b.size() && alike; ++i) alike = of_b[i] == of_a[i / of_all * of_one];
        }
    });
    return alike;
}

}  // namespace

template <class T>
void share_work(std::vector<SkinChunk<T>>& chunks, std::size_t first, SkinChunks& all) {
    for (std::size_t k = first; k < chunks.size(); ++k) {
        if (!has_own_work(chunks[k]) || chunks[k].has_bodies) continue;
        std::vector<std::size_t> same;
        for (std::size_t i = k; i < chunks.size(); ++i)
            if (alike(chunks[k], chunks[i]) && chunks[k].width == chunks[i].width) same.push_back(i);
        if (same.size() * work_bytes(chunks[k]) < shared_from_bytes) continue;
        const std::size_t most = std::min(same.size(), std::size_t(std::max(1u, std::thread::hardware_concurrency())));
        all.work.resize(std::max(all.work.size(), most));
        int number = 0;
        for (WorkMemory& m : all.work) number = std::max(number, int(memory_of(m, T()).size()));
        for (WorkMemory& m : all.work) {
            auto& memory = memory_of(m, T());
            memory.resize(std::size_t(number));
            memory.push_back(work_of(chunks[k]));
        }
        for (std::size_t i : same) {
            chunks[i].shared_work = number;
            resize_fields(chunks[i]);
            for_each_field(chunks[i], [](auto& array, const Field& f) {
                if (f.size == 0) array.shrink_to_fit();
            });
        }
    }
}

template <class T>
void share_rest(std::vector<SkinChunk<T>>& chunks, std::size_t first) {
    for (std::size_t k = first; k < chunks.size(); ++k) {
        std::vector<std::size_t> same;
        bool all_alike = true;
        for (std::size_t i = first; i < chunks.size(); ++i) {
            if (!alike(chunks[k], chunks[i])) continue;
            all_alike = all_alike && i >= k && are_alike(chunks[k], chunks[i]);
            if (chunks[k].width == chunks[i].width) same.push_back(i);
        }
        if (!all_alike) continue;  // or those of its archetype share already
        for (std::size_t i : same)
            for_each_field_of_both(chunks[k], chunks[i], [](auto& a, auto& b, const Field&) {
                if constexpr (requires { a.share(b); })
                    if (&a != &b) b.share(a);
            });
    }
}

template <class T>
void trade_work(SkinChunk<T>& c, SkinChunk<T>& memory, bool with_matrix) {
    for_each_field_of_both(c, memory, [](auto& a, auto& b, const Field& f) {
        if (f.role == Role::work) std::swap(a, b);
    });
    std::swap(c.scratch.outward, memory.scratch.outward);
    std::swap(c.scratch.changed_columns, memory.scratch.changed_columns);
    std::swap(c.scratch.candidate_limits, memory.scratch.candidate_limits);
    if (!with_matrix) return;
    std::swap(c.scratch.blocks, memory.scratch.blocks);
    std::swap(c.scratch.contact_in_matrix, memory.scratch.contact_in_matrix);
}

template <class T>
bool keeps_none(const SkinChunk<T>& c) {
    for (int lane = 0; lane < c.width; ++lane)
        if (((active_lanes(c) >> lane) & 1u) && !(c.state.matrix_kept[std::size_t(lane)] < T(0))) return false;
    return true;
}

template void share_work(std::vector<SkinChunk<double>>&, std::size_t, SkinChunks&);
template void share_work(std::vector<SkinChunk<float>>&, std::size_t, SkinChunks&);
template void share_rest(std::vector<SkinChunk<double>>&, std::size_t);
template void share_rest(std::vector<SkinChunk<float>>&, std::size_t);
template void trade_work(SkinChunk<double>&, SkinChunk<double>&, bool);
template void trade_work(SkinChunk<float>&, SkinChunk<float>&, bool);
template bool keeps_none(const SkinChunk<double>&);
template bool keeps_none(const SkinChunk<float>&);

}  // namespace palpate
