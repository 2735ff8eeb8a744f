// Counts heap allocations, and lets one fail: the test program's operator new and delete are replaced (allocation_counter.cpp).
// Under the thread sanitizer they are not: it counts nothing, and nothing fails.
#pragma once

#include <cstdint>

namespace flockstep::testing {

// Calls of operator new so far, by this thread or by all threads together.
std::uint64_t allocations_of_this_thread();
std::uint64_t allocations();

// How many of all threads' are not freed yet.
std::int64_t live_allocations();

// While one lives, the n-th allocation of this thread from its making on fails, and no other. n counts from 1.
class FailingAllocation {
 public:
  explicit FailingAllocation(std::uint64_t n);
  ~FailingAllocation();
  FailingAllocation(const FailingAllocation&) = delete;
  FailingAllocation& operator=(const FailingAllocation&) = delete;

  bool has_failed() const;
};

}  // namespace flockstep::testing
