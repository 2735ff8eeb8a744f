// Counts heap allocations and can make one fail, by replacing operator new and delete of the test program
// (allocation_counter.cpp). Under the thread sanitizer they are not replaced: nothing is counted and nothing fails.
#pragma once

#include <cstdint>

namespace flockstep::testing {

// Number of calls of operator new so far, by this thread or by all threads together.
std::uint64_t allocations_of_this_thread();
std::uint64_t allocations();

// Number of allocations of all threads that are not freed yet.
std::int64_t live_allocations();

// During its lifetime, makes this thread's n-th allocation after its construction fail. n counts from 1.
class FailingAllocation {
 public:
  explicit FailingAllocation(std::uint64_t n);
  ~FailingAllocation();
  FailingAllocation(const FailingAllocation&) = delete;
  FailingAllocation& operator=(const FailingAllocation&) = delete;

  bool has_failed() const;
};

}  // namespace flockstep::testing
