#include "base/workers.hpp"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include "base/flush_denormals.hpp"
#include "base/thread_sanitizer.hpp"

namespace flockstep {

struct Workers::Arena {
  explicit Arena(int num_threads) : tbb(num_threads) {}
  tbb::task_arena tbb;
};

Workers::Workers(int num_threads) : num_threads_(num_threads), arena_(std::make_unique<Arena>(num_threads)) {}

Workers::~Workers() = default;

void Workers::run(std::size_t count, Call f, const void* call) {
  if (count <= 1 || num_threads_ == 1) {  // not worth, or not able, to wake anyone
    const FlushDenormals flush;
    for (std::size_t i = 0; i < count; ++i) f(call, i, 0);
    return;
  }
  static const char forked = 0;  // static: before a task has acquired it, it may read nothing of this frame
  const char joined = 0;
  thread_sanitizer::release(&forked);
  arena_->tbb.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, 1),
        [&](const tbb::blocked_range<std::size_t>& range) {
          thread_sanitizer::acquire(&forked);
          const FlushDenormals flush;
          const auto thread = static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
          for (std::size_t i = range.begin(); i != range.end(); ++i) f(call, i, thread);
          thread_sanitizer::release(&joined);
        },
        tbb::simple_partitioner());
  });
  thread_sanitizer::acquire(&joined);
}

}  // namespace flockstep
