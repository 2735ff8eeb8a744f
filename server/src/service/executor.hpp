// Executor: runs operations on the batch one at a time, on the threads that bring them. A thread that finds another one at work
// leaves its operation in a queue, which the other one then works off. No thread waits, and an operation that finds nobody at
// work costs no hand-over.
#pragma once

#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <utility>

#include "service/workload.hpp"

namespace flockstep::server {

class Executor {
 public:
  explicit Executor(Workload& workload) : workload_(workload) {}

  // Runs the operation now or later; it must not throw.
  void run(std::function<void()> operation) {
    {
      const std::scoped_lock lock(mutex_);
      if (is_busy_) {
        queue_.push_back(std::move(operation));
        return;
      }
      is_busy_ = true;
    }
    operation();
    work_off();
  }
  // Runs the operation now if nobody is at work. It must not throw; if it returns false, it counts as not run.
  template <class Operation>
  bool try_run(const Operation& operation) {
    {
      const std::scoped_lock lock(mutex_);
      if (is_busy_) return false;
      is_busy_ = true;
    }
    const bool done = operation();
    work_off();
    return done;
  }

 private:
  void work_off() {
    constexpr int kMany = 8;  // short operations, of some microseconds
    std::optional<Workload::Mark> mark;
    for (int count = 1;; ++count) {
      std::function<void()> next;
      {
        const std::scoped_lock lock(mutex_);
        if (queue_.empty()) {
          is_busy_ = false;
          return;
        }
        next = std::move(queue_.front());
        queue_.pop_front();
      }
      if (count == kMany) mark.emplace(workload_);
      next();
    }
  }

  Workload& workload_;
  std::mutex mutex_;
  bool is_busy_ = false;
  std::deque<std::function<void()>> queue_;
};

}  // namespace flockstep::server
