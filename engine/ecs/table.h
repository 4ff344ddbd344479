#pragma once
// Entities and component tables. An id is an index with a generation; zero is null. A table holds the
// rows of one component, for the entities that have it: what a scene does not name has no row.

#include <cstdint>
#include <vector>

namespace palpate {

struct EntityId {
    std::uint32_t index = 0;  ///< slot + 1; 0 is null
    std::uint32_t generation = 0;
    explicit operator bool() const { return index != 0; }
    friend bool operator==(EntityId, EntityId) = default;
};

/// Hands out ids; a destroyed slot is reused under a new generation, so that old ids stay invalid.
class EntityPool {
  public:
    EntityId create() {
        if (free_.empty()) {
            generations_.push_back(1);
            return {static_cast<std::uint32_t>(generations_.size()), 1};
        }
        const std::uint32_t slot = free_.back();
        free_.pop_back();
        return {slot + 1, generations_[slot]};
    }
    void destroy(EntityId id) {
        if (!alive(id)) return;
        ++generations_[id.index - 1];
        free_.push_back(id.index - 1);
    }
    bool alive(EntityId id) const {
        return id.index > 0 && id.index <= generations_.size() && generations_[id.index - 1] == id.generation;
    }

  private:
    std::vector<std::uint32_t> generations_;
    std::vector<std::uint32_t> free_;
};

/// Dense rows of a component, found by id in constant time. Rows move when one is removed: keep ids,
/// not pointers.
template <class T>
class Table {
  public:
    T& add(EntityId id, T row = {}) {
        if (sparse_.size() <= id.index) sparse_.resize(id.index + 1, 0);
        sparse_[id.index] = static_cast<std::uint32_t>(rows_.size() + 1);
        owners_.push_back(id);
        rows_.push_back(std::move(row));
        return rows_.back();
    }
    bool remove(EntityId id) {
        if (!find(id)) return false;
        const std::uint32_t row = sparse_[id.index] - 1;
        sparse_[owners_.back().index] = row + 1;
        sparse_[id.index] = 0;
        rows_[row] = std::move(rows_.back());
        owners_[row] = owners_.back();
        rows_.pop_back();
        owners_.pop_back();
        return true;
    }
    T* find(EntityId id) { return const_cast<T*>(static_cast<const Table*>(this)->find(id)); }
    const T* find(EntityId id) const {
        if (id.index == 0 || id.index >= sparse_.size() || sparse_[id.index] == 0) return nullptr;
        const std::uint32_t row = sparse_[id.index] - 1;
        return owners_[row] == id ? &rows_[row] : nullptr;
    }
    std::size_t size() const { return rows_.size(); }
    bool empty() const { return rows_.empty(); }
    EntityId owner(std::size_t row) const { return owners_[row]; }
    T& operator[](std::size_t row) { return rows_[row]; }
    const T& operator[](std::size_t row) const { return rows_[row]; }
    auto begin() { return rows_.begin(); }
    auto end() { return rows_.end(); }
    auto begin() const { return rows_.begin(); }
    auto end() const { return rows_.end(); }

  private:
    std::vector<T> rows_;
    std::vector<EntityId> owners_;
    std::vector<std::uint32_t> sparse_;  ///< id.index -> row + 1, 0 = none
};

}  // namespace palpate
