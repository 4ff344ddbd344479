#pragma once
// Memory of a chunk: arrays are [index][component][lane], in lines of the cache.

#include <cstddef>
#include <new>
#include <vector>

namespace palpate {

template <class T>
struct CacheAligned {
    using value_type = T;
    CacheAligned() = default;
    template <class U>
    CacheAligned(const CacheAligned<U>&) {}
    T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
    friend bool operator==(const CacheAligned&, const CacheAligned&) { return true; }
};
template <class T>
using LaneArray = std::vector<T, CacheAligned<T>>;

}  // namespace palpate
