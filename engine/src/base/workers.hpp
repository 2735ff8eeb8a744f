// Workers: the threads of one batch, in an arena of their own.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <cstddef>

#include "base/flush_denormals.hpp"
#include "base/thread_sanitizer.hpp"

namespace flockstep {

class Workers {
 public:
  explicit Workers(int num_threads) : num_threads_(num_threads), arena_(num_threads) {}

  int num_threads() const { return num_threads_; }

  // Calls f(index, thread) for every index in [0, count), in no particular order; thread is in [0, num_threads), and what is of
  // one thread alone goes by it. Denormals are zero.
  template <class F>
  void run(std::size_t count, const F& f) {
    if (count <= 1 || num_threads_ == 1) {  // not worth, or not able, to wake anyone
      const FlushDenormals flush;
      for (std::size_t i = 0; i < count; ++i) f(i, std::size_t{0});
      return;
    }
    static const char forked = 0;  // static: before a task has acquired it, it may read nothing of this frame
    const char joined = 0;
    thread_sanitizer::release(&forked);
    arena_.execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, count, 1),
          [&](const tbb::blocked_range<std::size_t>& range) {
            thread_sanitizer::acquire(&forked);
            const FlushDenormals flush;
            const auto thread = static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
            for (std::size_t i = range.begin(); i != range.end(); ++i) f(i, thread);
            thread_sanitizer::release(&joined);
          },
          tbb::simple_partitioner());
    });
    thread_sanitizer::acquire(&joined);
  }

 private:
  int num_threads_;
  tbb::task_arena arena_;
};

}  // namespace flockstep
