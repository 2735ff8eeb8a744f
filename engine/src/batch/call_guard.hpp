// CallGuard: holds the lock of a batch during one call.
#pragma once

#include "batch/call_lock.hpp"

namespace flockstep {

class CallGuard {
 public:
  // Throws std::runtime_error if another thread is in a call on a batch that is not shared, or this is a child of the process
  // that made it.
  explicit CallGuard(CallLock& lock) : lock_(lock), is_outermost_(lock.acquire()) {}
  ~CallGuard() {
    if (is_outermost_) lock_.release();
  }
  CallGuard(const CallGuard&) = delete;
  CallGuard& operator=(const CallGuard&) = delete;

 protected:
  bool is_outermost() const { return is_outermost_; }

 private:
  CallLock& lock_;
  bool is_outermost_;
};

// The guard of a call that may take long and changes the state. Create it before anything of the batch is read: the function
// given to Batch::share() may change the batch first.
class LongCallGuard : public CallGuard {
 public:
  explicit LongCallGuard(CallLock& lock) : CallGuard(lock) {
    if (is_outermost()) lock.announce_long_call();
  }
};

}  // namespace flockstep
