// Counts heap allocations: the test program's operator new and delete are replaced by ones that count (allocation_counter.cpp).
// Under the thread sanitizer it counts nothing.
#pragma once

#include <cstdint>

namespace flockstep::testing {

// Calls of operator new so far, by this thread or by all threads together.
std::uint64_t allocations_of_this_thread();
std::uint64_t allocations();

}  // namespace flockstep::testing
