// Workers: the threads of one batch, in a separate arena.
#pragma once

#include <cstddef>
#include <memory>

namespace flockstep {

inline constexpr int kMaxThreadsPerProcessor = 4;  // more cost memory and are no faster

// The number of threads for a requested one. 0: the physical cores that this process may run on.
int thread_count(int requested);

class Workers {
 public:
  // Starts the threads. Throws std::runtime_error, naming the limits, if the system refuses them.
  explicit Workers(int num_threads);
  ~Workers();
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  // Gives back the threads; run() must not be called any more.
  void close() noexcept;

  int num_threads() const { return num_threads_; }

  // Calls f(index, thread) for every index in [0, count), in no particular order. `thread` is in [0, num_threads) and indexes
  // per-thread data. Denormals are treated as zero. If f throws or the caller is interrupted (see Interrupt), the remaining
  // calls are skipped and the exception is rethrown; calls on other threads end at their next poll.
  template <class F>
  void run(std::size_t count, const F& f) {
    run(
        count, [](const void* call, std::size_t index, std::size_t thread) { (*static_cast<const F*>(call))(index, thread); },
        &f);
  }

 private:
  using Call = void (*)(const void* call, std::size_t index, std::size_t thread);
  struct Arena;

  void run(std::size_t count, Call f, const void* call);

  int num_threads_;
  std::unique_ptr<Arena> arena_;
};

}  // namespace flockstep
