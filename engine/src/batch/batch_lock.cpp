#include "flockstep/batch_lock.hpp"

#include <stdexcept>
#include <utility>

#include "batch/call_guard.hpp"
#include "batch/call_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep {

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
std::int64_t ServedBatch::generation(const Batch& batch) { return batch.generation_; }
std::shared_ptr<const void> ServedBatch::memory(const Batch& batch) { return batch.sim_; }

void ServedBatch::run_moves_with(Batch& batch, std::function<void(const std::function<void()>&)> run) {
  const CallGuard guard(*batch.lock_);
  batch.run_moves_ = std::move(run);
}

}  // namespace flockstep
