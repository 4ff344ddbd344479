#pragma once
// Threads that steps run on. What includes this is spared oneTBB, which takes a second to compile.

#include <memory>

namespace palpate {

/// A pool of threads; no result depends on how many there are.
class Threads {
  public:
    /// As many as the machine has where `count` is 0.
    explicit Threads(int count = 0);
    ~Threads();
    Threads(const Threads&) = delete;
    Threads& operator=(const Threads&) = delete;

    int count() const;
    /// Calls work(i) for each i in [0, n), each on some thread; returns when all are done.
    template <class Work>
    void for_each(int n, const Work& work) {
        run(
            n, [](const void* w, int i) { (*static_cast<const Work*>(w))(i); }, &work);
    }

  private:
    void run(int n, void (*work)(const void*, int), const void* context);
    struct Arena;
    std::unique_ptr<Arena> arena_;
};

}  // namespace palpate
