// CallGuard: allows calls on a batch from one thread at a time. Nested calls on that thread, such as from its task, are
// allowed.
#pragma once

#include <atomic>
#include <new>
#include <stdexcept>
#include <thread>

#include "batch/checks.hpp"
#include "batch/simulation.hpp"

namespace flockstep {

class CallGuard {
 public:
  // Throws std::runtime_error if another thread is in a call on the batch, or this is a child of the process that made it.
  explicit CallGuard(Simulation& sim) : CallGuard(sim, std::nothrow) {
    checks::own_process(sim);
    if (!granted_) throw std::runtime_error("this Batch is in use by another thread: one call at a time");
  }
  // Does not throw; check is_granted().
  CallGuard(Simulation& sim, std::nothrow_t) : user_(sim.user) {
    std::thread::id nobody;
    started_ = user_.compare_exchange_strong(nobody, std::this_thread::get_id(), std::memory_order_acquire);
    granted_ = started_ || nobody == std::this_thread::get_id();
  }
  ~CallGuard() {
    if (started_) user_.store({}, std::memory_order_release);
  }
  CallGuard(const CallGuard&) = delete;
  CallGuard& operator=(const CallGuard&) = delete;

  bool is_granted() const { return granted_; }

 private:
  std::atomic<std::thread::id>& user_;
  bool started_ = false;
  bool granted_ = false;
};

}  // namespace flockstep
