#include "batch/call_lock.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "batch/growth.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep {

CallLock::CallLock() : owner_(process_id()) {}

void CallLock::require_own_process() const {
  if (process_id() == owner_) return;
  throw std::runtime_error("this Batch was made in process " + std::to_string(owner_) + " and used in its child " +
                           std::to_string(process_id()) + ": a batch does not survive fork(), make one in the child");
}

void CallLock::share(std::function<void()> before_long_call) {
  const std::scoped_lock lock(mutex_);
  before_long_call_ = std::move(before_long_call);
  is_shared_.store(true, std::memory_order_relaxed);
}

void CallLock::unshare() {
  const std::scoped_lock lock(mutex_);
  before_long_call_ = nullptr;
  is_shared_.store(false, std::memory_order_relaxed);
}

void CallLock::move_arrays(const std::function<void()>& move) {
  const std::function<void()> moved = [&] {
    move();
    ++generation_;
  };
  run_moves_ ? run_moves_(moved) : moved();
}

bool CallLock::wait() {
  constexpr std::chrono::milliseconds kPause{50};  // between two polls for interrupts
  const Waiter self = std::this_thread::get_id();
  std::unique_lock lock(mutex_);
  if (!is_shared()) {
    if (const std::optional<bool> taken = take()) return *taken;
    throw std::runtime_error("this Batch is in use by another thread: one call at a time");
  }
  queue_.push_back(self);
  // A release either finds this count or comes before the first take() below: all three are sequentially consistent.
  num_waiting_.fetch_add(1, std::memory_order_seq_cst);
  const auto leave = [&] {
    queue_.erase(std::ranges::find(queue_, self));
    num_waiting_.fetch_sub(1, std::memory_order_seq_cst);
  };
  while (queue_.front() != self || !take()) {
    if (turn_.wait_for(lock, kPause) != std::cv_status::timeout) continue;
    lock.unlock();
    try {
      Interrupt::poll();
    } catch (...) {
      lock.lock();
      leave();
      lock.unlock();
      turn_.notify_all();
      throw;
    }
    lock.lock();
  }
  leave();
  return true;
}

void CallLock::wake() {
  {
    const std::scoped_lock lock(mutex_);
  }  // a thread that is about to wait has begun to
  turn_.notify_all();
}

BatchLock::BatchLock(const Batch& batch) : lock_(batch.lock_->acquire() ? batch.lock_.get() : nullptr) {}

std::optional<BatchLock> BatchLock::try_lock(const Batch& batch) {
  batch.lock_->require_own_process();
  const std::optional<bool> taken = batch.lock_->try_acquire();
  if (!taken) return std::nullopt;
  return BatchLock(*taken ? batch.lock_.get() : nullptr);
}

std::uint64_t BatchLock::turn(const Batch& batch) { return batch.lock_->turns(); }

BatchLock::BatchLock(BatchLock&& other) noexcept : lock_(std::exchange(other.lock_, nullptr)) {}

BatchLock::~BatchLock() {
  if (lock_ != nullptr) lock_->release();
}

// ----------------------------------------------------------------------------------------------------------------- ServedBatch

ServedBatch::ServedBatch(Batch& batch, std::function<void()> before_long_call) : batch_(&batch) {
  const CallGuard guard(*batch.lock_);
  batch.lock_->share(std::move(before_long_call));
}

ServedBatch::~ServedBatch() {
  try {
    end();
  } catch (const std::runtime_error&) {  // in a child of fork(), whose batch nobody can use
  }
}

void ServedBatch::end() {
  if (batch_ == nullptr) return;
  const CallGuard guard(*batch_->lock_);
  batch_->lock_->unshare();
  batch_ = nullptr;
}

bool ServedBatch::is_served(const Batch& batch) { return batch.lock_->is_shared(); }
std::int64_t ServedBatch::generation(const Batch& batch) { return batch.lock_->generation(); }
std::shared_ptr<const void> ServedBatch::memory(const Batch& batch) { return batch.sim_; }

NextSlot ServedBatch::next_slot(const Batch& batch, std::span<const std::int64_t> env) {
  const CallGuard guard(*batch.lock_);
  const Simulation& sim = *batch.sim_;
  const SpawnPlan plan = plan_spawn(sim, {}, env, 1);
  return {.env = EnvIndex(static_cast<std::size_t>(plan.indices[0]) / plan.drones_per_env),
          .renumbers = sim.num_envs() > 1 && plan.drones_per_env != sim.drones_per_env()};
}

void ServedBatch::run_moves_with(Batch& batch, std::function<void(const std::function<void()>&)> run) {
  const CallGuard guard(*batch.lock_);
  batch.lock_->run_moves_with(std::move(run));
}

}  // namespace flockstep
