// CallGuard: holds the lock of a batch during one call.
#pragma once

#include "batch/call_lock.hpp"

namespace flockstep {

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
// given to Batch::share() may change the batch first.
class LongCallGuard : public CallGuard {
 public:
  explicit LongCallGuard(CallLock& lock) : CallGuard(lock, true) {}
};

}  // namespace flockstep
