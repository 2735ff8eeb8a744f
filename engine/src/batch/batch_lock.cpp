#include "flockstep/batch_lock.hpp"

#include <utility>

#include "batch/call_lock.hpp"

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

}  // namespace flockstep
