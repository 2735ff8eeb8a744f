// SingleCaller: admits one thread at a time to an object, and only the process that made it.
#pragma once

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>

#include "base/platform.hpp"

namespace flockstep::learning {

class SingleCaller {
 public:
  // Admits the calling thread during its lifetime; nested calls of the same thread are allowed. Throws std::runtime_error if
  // another thread is in a call, and in a child of the process that made the object.
  class Call {
   public:
    explicit Call(SingleCaller& callers) : callers_(callers) {
      if (process_id() != callers.owner_) {
        throw std::runtime_error("this Learner was made in process " + std::to_string(callers.owner_) +
                                 " and used in its child " + std::to_string(process_id()) +
                                 ": a learner does not survive fork(), make or load one in the child");
      }
      std::thread::id nobody;
      const std::thread::id self = std::this_thread::get_id();
      is_outermost_ = callers.thread_.compare_exchange_strong(nobody, self, std::memory_order_acquire);
      if (!is_outermost_ && nobody != self) {
        throw std::runtime_error("this Learner is in use by another thread: one call at a time");
      }
    }
    ~Call() {
      if (is_outermost_) callers_.thread_.store({}, std::memory_order_release);
    }
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

   private:
    SingleCaller& callers_;
    bool is_outermost_ = false;
  };

 private:
  std::atomic<std::thread::id> thread_{};  // in a call
  const long owner_ = process_id();
};

}  // namespace flockstep::learning
