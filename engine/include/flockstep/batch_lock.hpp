// BatchLock: several calls on a batch without calls of other threads in between.
#pragma once

#include <cstdint>
#include <optional>

#include "flockstep/batch.hpp"
#include "flockstep/export.hpp"

namespace flockstep {

// While it exists, only its thread may call the batch, which must outlive it. It may be nested. Destroy it on the thread that
// made it.
class FLOCKSTEP_API BatchLock {
 public:
  // Waits until no other thread is in a call, if the batch is shared. If it is not, throws std::runtime_error, as a call would.
  explicit BatchLock(const Batch& batch);
  // Returns nothing, without waiting, if another thread is in a call or waits for one.
  static std::optional<BatchLock> try_lock(const Batch& batch);

  // Returns a number that changes whenever a thread takes or releases the lock of a shared batch. If it is the same as during an
  // earlier call, that call is still running.
  static std::uint64_t turn(const Batch& batch);

  // Moves the lock; the other object then holds none.
  BatchLock(BatchLock&& other) noexcept;
  BatchLock(const BatchLock&) = delete;
  BatchLock& operator=(const BatchLock&) = delete;
  ~BatchLock();

 private:
  explicit BatchLock(CallLock* lock) : lock_(lock) {}

  CallLock* lock_;  // null if nothing must be released
};

}  // namespace flockstep
