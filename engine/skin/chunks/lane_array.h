#pragma once
// Memory of a chunk: arrays are [index][component][lane], in lines of the cache.

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <new>
#include <utility>
#include <vector>

namespace palpate {

template <class T>
struct CacheAligned {
    using value_type = T;
    CacheAligned() = default;
    template <class U>
    CacheAligned(const CacheAligned<U>&) {}
    /// With room for one number more, which loads of four may read where three are wanted (gather_triples).
    T* allocate(std::size_t n) { return static_cast<T*>(::operator new((n + 1) * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
    friend bool operator==(const CacheAligned&, const CacheAligned&) { return true; }
};
template <class T>
using LaneArray = std::vector<T, CacheAligned<T>>;

/// An array that is written at load, and may be one memory of several chunks (share_rest), or fingers. Who writes later
/// makes it its own first.
template <class T>
class RestArray {
  public:
    using value_type = T;

    RestArray() = default;
    RestArray(std::initializer_list<T> values) : memory_(std::make_shared<LaneArray<T>>(values)) { look(); }
    RestArray(const RestArray& other) : memory_(other.memory_) {
        if (!other.is_shared()) own();
        look();
    }
    RestArray(RestArray&& other) noexcept : memory_(std::move(other.memory_)) { look(), other.look(); }
    RestArray& operator=(RestArray other) noexcept {
        std::swap(memory_, other.memory_);
        look();
        return *this;
    }

    std::size_t size() const { return size_; }
    bool empty() const { return size_ == 0; }
    const T* data() const { return first_; }
    T* data() { return first_; }
    const T& operator[](std::size_t i) const { return first_[i]; }
    T& operator[](std::size_t i) { return first_[i]; }
    T* begin() { return first_; }
    T* end() { return first_ + size_; }
    const T* begin() const { return first_; }
    const T* end() const { return first_ + size_; }

    void resize(std::size_t size, T value = T()) {
        if (size == size_) return;
        own();
        memory_->resize(size, value);
        look();
    }
    void push_back(const T& value) {
        own();
        memory_->push_back(value);
        look();
    }
    void shrink_to_fit() {}

    friend bool operator==(const RestArray& a, const RestArray& b) {
        return std::equal(a.begin(), a.end(), b.begin(), b.end());
    }

    bool is_shared() const { return memory_.use_count() > 1; }
    /// How many arrays have this memory.
    long sharers() const { return std::max(memory_.use_count(), 1L); }
    void share(const RestArray& other) { memory_ = other.memory_, look(); }
    void own() {
        if (!memory_ || is_shared())
            memory_ = memory_ ? std::make_shared<LaneArray<T>>(*memory_) : std::make_shared<LaneArray<T>>();
        look();
    }

  private:
    void look() {
        first_ = memory_ ? memory_->data() : nullptr;
        size_ = memory_ ? memory_->size() : 0;
    }
    std::shared_ptr<LaneArray<T>> memory_;
    T* first_ = nullptr;
    std::size_t size_ = 0;
};

}  // namespace palpate
