// Executor: runs operations on the batch one at a time. A thread that finds nobody at work runs its operation at once, without a
// hand-over. Otherwise the operation waits in a queue. Each operation of the queue is a handler by itself: a thread that ran all
// of them would never return to its client while others keep coming.
#pragma once

#include <deque>
#include <functional>
#include <mutex>
#include <utility>

namespace flockstep::server {

class Executor {
 public:
  using Operation = std::function<void()>;

  // post: runs a function later, on any thread, but never within the call.
  explicit Executor(std::function<void(Operation)> post) : post_(std::move(post)) {}

  // Runs the operation now or later. If it throws, for example without memory, the next ones still run.
  void run(Operation operation) {
    if (!begin(operation)) return;
    const Turn turn(*this);
    operation();
  }
  // Runs the operation later.
  void run_later(Operation operation) {
    const std::scoped_lock lock(mutex_);
    queue_.push_back(std::move(operation));
    if (!std::exchange(is_busy_, true)) post_next();
  }
  // Runs the operation now if nobody is at work. If it returns false, it counts as not run.
  template <class Function>
  bool try_run(const Function& operation) {
    {
      const std::scoped_lock lock(mutex_);
      if (is_busy_) return false;
      is_busy_ = true;
    }
    const Turn turn(*this);
    return operation();
  }
  // Drops the operations in the queue, of which none will run any more.
  void clear() {
    std::deque<Operation> dropped;
    const std::scoped_lock lock(mutex_);
    dropped.swap(queue_);
  }

 private:
  // The time in which an operation runs.
  class Turn {
   public:
    explicit Turn(Executor& executor) : executor_(executor) {}
    ~Turn() { executor_.end(); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

   private:
    Executor& executor_;
  };

  // Returns false if the operation has moved into the queue.
  bool begin(Operation& operation) {
    const std::scoped_lock lock(mutex_);
    if (!std::exchange(is_busy_, true)) return true;
    queue_.push_back(std::move(operation));
    return false;
  }
  void end() {
    const std::scoped_lock lock(mutex_);
    is_busy_ = !queue_.empty();
    if (is_busy_) post_next();
  }
  void post_next() {
    post_([this] {
      Operation next;
      {
        const std::scoped_lock lock(mutex_);
        if (queue_.empty()) return;  // cleared
        next = std::move(queue_.front());
        queue_.pop_front();
      }
      const Turn turn(*this);
      next();
    });
  }

  const std::function<void(Operation)> post_;
  std::mutex mutex_;
  bool is_busy_ = false;
  std::deque<Operation> queue_;
};

}  // namespace flockstep::server
