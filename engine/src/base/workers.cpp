#include "base/workers.hpp"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "base/thread_sanitizer.hpp"

namespace flockstep {
namespace {

// Ends a call on a thread other than the caller's. oneTBB rethrows the exception that caused the cancellation and drops this
// one.
struct Cancelled {};
void throw_if_cancelled() {
  if (tbb::is_current_task_group_canceling()) throw Cancelled();
}

// The work of a task. oneTBB copies it and the range from thread to thread, which the sanitizer does not observe. Therefore
// nothing else reads the copies.
struct TaskBody {
  void (*run)(const void* all, std::size_t begin, std::size_t end);
  const void* all;

  FLOCKSTEP_UNCHECKED_BY_THREAD_SANITIZER void operator()(const tbb::blocked_range<std::size_t>& range) const {
    run(all, range.begin(), range.end());
  }
};

// Calls run(begin, end) for parts of [0, count) on the threads of an arena, the caller's included.
template <class Run>
void run_in(tbb::task_arena& arena, std::size_t count, const Run& run) {
  static const char forked = 0;  // static: before the acquire, a task may not read this frame
  const char joined = 0;
  const auto run_some = [&](std::size_t begin, std::size_t end) {
    run(begin, end);
    thread_sanitizer::release(&joined);
    Interrupt::poll();
  };
  thread_sanitizer::release(&forked);
  arena.execute([&] {
    const TaskBody body{[](const void* all, std::size_t begin, std::size_t end) {
                          thread_sanitizer::acquire(&forked);
                          (*static_cast<decltype(&run_some)>(all))(begin, end);
                        },
                        &run_some};
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 1), body, tbb::simple_partitioner());
  });
  thread_sanitizer::acquire(&joined);
}

// Throws std::runtime_error unless the system can start `count` threads at once. They end at once.
void try_threads(std::size_t count) {
  std::atomic<bool> is_over{false};
  std::vector<std::thread> threads;
  threads.reserve(count);
  std::string refusal;
  try {
    while (threads.size() < count) threads.emplace_back([&] { is_over.wait(false); });
  } catch (const std::system_error& error) {
    refusal = error.code().message();
  }
  const std::size_t started = threads.size();
  is_over = true;
  is_over.notify_all();
  for (std::thread& thread : threads) thread.join();
  if (started == count) return;
  throw std::runtime_error("num_threads: the system started " + std::to_string(started) + " of " + std::to_string(count) +
                           " threads (" + refusal + "); lower num_threads, or raise a limit: " + thread_limits());
}

// Lets oneTBB start `count` threads, which it keeps, and waits for them. Threads that are busy elsewhere do not come; then it
// ends after a second.
void start_threads(std::size_t count) {
  try_threads(count);
  tbb::task_arena arena(static_cast<int>(count) + 1);
  std::atomic<std::size_t> arrived{0};
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  run_in(arena, count + 1, [&](std::size_t, std::size_t) {
    ++arrived;
    while (arrived <= count && std::chrono::steady_clock::now() < end) std::this_thread::yield();
  });
}

// Keeps the arenas of closed batches for reuse, because oneTBB keeps some kilobytes of every used arena for the lifetime of the
// process. Also raises oneTBB's thread limit to the largest number that a batch requested, if that exceeds oneTBB's default.
// There is one instance per process, as for oneTBB itself.
class Arenas {
 public:
  struct Arena {
    int num_threads;
    long owner;  // id of the process that created it
    std::unique_ptr<tbb::task_arena> tbb;
  };

  static Arenas& of_process() {
    static Arenas& arenas = *std::make_unique<Arenas>().release();  // never destroyed: oneTBB may be gone at exit
    return arenas;
  }

  Arena take(int num_threads) {
    wanted_ += static_cast<std::size_t>(num_threads) - 1;
    // If another thread holds the lock, create a new arena. Waiting could block forever in a child of a fork().
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock) {
      if (owner_ != process_id()) forget();
      allow(num_threads);
      const auto found =
          std::find_if(free_.begin(), free_.end(), [&](const Arena& arena) { return arena.num_threads == num_threads; });
      if (found != free_.end()) {
        std::swap(*found, free_.back());
        Arena arena = std::move(free_.back());
        free_.pop_back();
        return arena;
      }
      free_.reserve(++made_);  // so that give_back() never allocates
    }
    return {num_threads, process_id(), std::make_unique<tbb::task_arena>(num_threads)};
  }

  // Starts the threads of all arenas that were taken. oneTBB would start them when there is work, on its own threads, where a
  // refusal of the system ends the process. Throws std::runtime_error if the system refuses them.
  void start() {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || process_id() != made_by_) return;  // oneTBB starts no threads in a child of a fork()
    const std::size_t most = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism) - 1;
    const std::size_t count = std::min<std::size_t>(wanted_, most);
    if (count <= started_) return;
    start_threads(count);
    started_ = count;
  }

  void give_back(Arena arena) noexcept {
    wanted_ -= static_cast<std::size_t>(arena.num_threads) - 1;
    if (arena.owner != process_id()) return abandon(arena);
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (lock && owner_ == arena.owner && free_.size() < free_.capacity()) free_.push_back(std::move(arena));
  }

 private:
  void allow(int num_threads) {
    const auto parameter = tbb::global_control::max_allowed_parallelism;
    const auto threads = static_cast<std::size_t>(num_threads);
    if (threads <= allowed_ || threads <= tbb::global_control::active_value(parameter)) return;
    control_.emplace(parameter, threads);
    allowed_ = threads;
  }

  // In a child of a fork() the threads of the parent's arenas no longer exist, and destroying an arena could wait for them.
  static void abandon(Arena& arena) noexcept { static_cast<void>(arena.tbb.release()); }
  void forget() {
    std::for_each(free_.begin(), free_.end(), abandon);
    free_.clear();
    owner_ = process_id();
  }

  std::mutex mutex_;
  long owner_ = process_id();
  const long made_by_ = process_id();
  std::atomic<std::size_t> wanted_{0};  // threads of the arenas that were taken, without those of their callers
  std::size_t started_ = 0;             // workers that oneTBB has started
  std::vector<Arena> free_;
  std::size_t made_ = 0;
  std::size_t allowed_ = 0;
  std::optional<tbb::global_control> control_;
};

}  // namespace

struct Workers::Arena {
  explicit Arena(int num_threads) : taken(Arenas::of_process().take(num_threads)) {}
  ~Arena() { Arenas::of_process().give_back(std::move(taken)); }
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;

  Arenas::Arena taken;
};

int thread_count(int requested) {
  return requested > 0 ? std::min(requested, kMaxThreadsPerProcessor * logical_processors()) : physical_cores();
}

Workers::Workers(int num_threads) : num_threads_(num_threads), arena_(std::make_unique<Arena>(num_threads)) {
  if (num_threads > 1) Arenas::of_process().start();
}

Workers::~Workers() = default;

void Workers::close() noexcept { arena_.reset(); }

void Workers::run(std::size_t count, Call f, const void* call) {
  if (count <= 1 || num_threads_ == 1) {  // nothing to parallelize
    for (std::size_t i = 0; i < count; ++i) {
      if (i > 0) Interrupt::poll();
      const FlushDenormals flush;
      f(call, i, 0);
    }
    return;
  }
  const std::thread::id caller = std::this_thread::get_id();
  run_in(*arena_->taken.tbb, count, [&](std::size_t begin, std::size_t end) {
    const FlushDenormals flush;
    std::optional<Interrupt> interrupt;  // the caller already has one, if any
    if (std::this_thread::get_id() != caller) interrupt.emplace(throw_if_cancelled);
    const auto thread = static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
    for (std::size_t i = begin; i != end; ++i) f(call, i, thread);
  });
}

}  // namespace flockstep
