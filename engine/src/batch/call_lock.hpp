// CallLock: admits the calls on a batch of one thread at a time. Nested calls on that thread, such as from its task, are
// allowed. It also knows what other threads have to be told of: long calls, and arrays that move.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace flockstep {

class CallLock {
 public:
  CallLock();
  CallLock(const CallLock&) = delete;
  CallLock& operator=(const CallLock&) = delete;

  // Takes the lock and returns true, or returns false if the calling thread holds it already. If another thread holds it, waits
  // while the batch is shared, and otherwise throws std::runtime_error, as in a child of the process that made the batch.
  // Threads that wait get the lock in the order of their calls. An Interrupt ends the wait.
  bool acquire() {
    require_own_process();
    const std::optional<bool> taken = is_shared() && num_waiting_.load(std::memory_order_relaxed) > 0 ? held_or_busy() : take();
    return taken ? *taken : wait();
  }
  // Like acquire(), but returns nothing instead of waiting.
  std::optional<bool> try_acquire() {
    if (is_shared() && num_waiting_.load(std::memory_order_relaxed) > 0) return held_or_busy();
    return take();
  }
  // Releases the lock. Call it once for each acquire() that returned true.
  void release() {
    if (is_shared()) {
      turns_.store(turns() + 1, std::memory_order_release);
      user_.store({}, std::memory_order_seq_cst);
      if (num_waiting_.load(std::memory_order_seq_cst) > 0) wake();
    } else {
      user_.store({}, std::memory_order_release);
      if (num_waiting_.load(std::memory_order_relaxed) > 0) wake();  // threads that began to wait before unshare()
    }
  }

  // Counts while the batch is shared, by one at each acquire() and release(): no two holds of the lock have equal numbers.
  std::uint64_t turns() const { return turns_.load(std::memory_order_acquire); }

  bool is_shared() const { return is_shared_.load(std::memory_order_relaxed); }
  // The next six need the lock.
  void share(std::function<void()> before_long_call);
  void unshare();
  void announce_long_call() const {
    if (before_long_call_) before_long_call_();
  }
  // See ServedBatch.
  void run_moves_with(std::function<void(const std::function<void()>&)> run) { run_moves_ = std::move(run); }
  std::int64_t generation() const { return generation_; }
  void move_arrays(const std::function<void()>& move);  // runs `move`, which moves the arrays of the batch

  // Number of calls that the holder is in, one within the other.
  int num_calls() const { return num_calls_; }
  void begin_call() { ++num_calls_; }
  void end_call() { --num_calls_; }

  // Throws std::runtime_error in a child of the process that made the batch.
  void require_own_process() const;

 private:
  using Waiter = std::thread::id;

  // True: took the lock. False: the calling thread holds it already. Nothing: another thread holds it.
  std::optional<bool> take() {
    std::thread::id nobody;
    const std::thread::id self = std::this_thread::get_id();
    if (user_.compare_exchange_strong(nobody, self, std::memory_order_seq_cst)) {
      if (is_shared()) turns_.store(turns() + 1, std::memory_order_release);
      return true;
    }
    return nobody == self ? std::optional(false) : std::nullopt;
  }
  std::optional<bool> held_or_busy() const {
    return user_.load(std::memory_order_relaxed) == std::this_thread::get_id() ? std::optional(false) : std::nullopt;
  }
  bool wait();
  void wake();

  std::atomic<std::thread::id> user_{};  // thread that is in a call
  std::atomic<bool> is_shared_{false};   // written with the lock and the mutex
  std::atomic<std::uint64_t> turns_{0};  // written with the lock
  std::atomic<int> num_waiting_{0};      // length of queue_
  std::mutex mutex_;                     // guards queue_
  std::condition_variable turn_;         // the lock was released, or a waiting thread left the queue
  std::deque<Waiter> queue_;             // threads that wait, first come first
  std::function<void()> before_long_call_;
  std::function<void(const std::function<void()>&)> run_moves_;
  std::int64_t generation_ = 0;
  int num_calls_ = 0;
  const long owner_;  // process that made the batch
};

// CallGuard: holds the lock of a batch during one call.
class CallGuard {
 public:
  // Throws std::runtime_error if another thread is in a call on a batch that is not shared, or this is a child of the process
  // that made it.
  explicit CallGuard(CallLock& lock) : CallGuard(lock, false) {}
  ~CallGuard() { held_.lock.end_call(); }
  CallGuard(const CallGuard&) = delete;
  CallGuard& operator=(const CallGuard&) = delete;

 protected:
  CallGuard(CallLock& lock, bool is_long) : held_(lock) {
    if (is_long && held_.is_outermost) lock.announce_long_call();
    lock.begin_call();
  }

 private:
  struct Held {
    explicit Held(CallLock& of) : lock(of), is_outermost(of.acquire()) {}
    ~Held() {
      if (is_outermost) lock.release();
    }
    Held(const Held&) = delete;
    Held& operator=(const Held&) = delete;

    CallLock& lock;
    const bool is_outermost;
  };
  const Held held_;
};

// The guard of a call that may take long and changes the state. Create it before anything of the batch is read: the function
// given to ServedBatch may change the batch first.
class LongCallGuard : public CallGuard {
 public:
  explicit LongCallGuard(CallLock& lock) : CallGuard(lock, true) {}
};

}  // namespace flockstep
