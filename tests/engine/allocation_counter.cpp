#include "allocation_counter.hpp"

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

#include "base/thread_sanitizer.hpp"

// Nothing is replaced under the thread sanitizer. Its own operators identify the calling library, and ignore memory that oneTBB
// and Embree pass between their threads.

namespace {

std::atomic<std::uint64_t> total{0};
std::atomic<std::int64_t> live{0};
thread_local std::uint64_t of_this_thread = 0;
thread_local std::uint64_t to_fail = 0;  // number of the allocation to fail; 0: none

#if !defined(FLOCKSTEP_THREAD_SANITIZER)
void* allocate(std::size_t size, std::size_t alignment) noexcept {
  total.fetch_add(1, std::memory_order_relaxed);
  if (++of_this_thread == to_fail) return nullptr;
  size = size == 0 ? 1 : size;
  void* const memory = alignment <= alignof(std::max_align_t)
                           ? std::malloc(size)
                           : std::aligned_alloc(alignment, (size + alignment - 1) / alignment * alignment);
  if (memory != nullptr) live.fetch_add(1, std::memory_order_relaxed);
  return memory;
}

void free_counted(void* memory) noexcept {
  if (memory != nullptr) live.fetch_sub(1, std::memory_order_relaxed);
  std::free(memory);
}

void* allocate_or_throw(std::size_t size, std::size_t alignment) {
  if (void* memory = allocate(size, alignment)) return memory;
  throw std::bad_alloc();
}
#endif

}  // namespace

namespace flockstep::testing {

std::uint64_t allocations_of_this_thread() { return of_this_thread; }
std::uint64_t allocations() { return total.load(std::memory_order_relaxed); }
std::int64_t live_allocations() { return live.load(std::memory_order_relaxed); }

FailingAllocation::FailingAllocation(std::uint64_t n) { to_fail = of_this_thread + n; }
FailingAllocation::~FailingAllocation() { to_fail = 0; }
bool FailingAllocation::has_failed() const { return of_this_thread >= to_fail; }

}  // namespace flockstep::testing

#if !defined(FLOCKSTEP_THREAD_SANITIZER)
// Replaces every form of operator new and delete ([new.delete]), so that all allocations are counted and freed consistently.
void* operator new(std::size_t size) { return allocate_or_throw(size, 0); }
void* operator new[](std::size_t size) { return allocate_or_throw(size, 0); }
void* operator new(std::size_t size, std::align_val_t a) { return allocate_or_throw(size, static_cast<std::size_t>(a)); }
void* operator new[](std::size_t size, std::align_val_t a) { return allocate_or_throw(size, static_cast<std::size_t>(a)); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept { return allocate(size, 0); }
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept { return allocate(size, 0); }
void* operator new(std::size_t size, std::align_val_t a, const std::nothrow_t&) noexcept {
  return allocate(size, static_cast<std::size_t>(a));
}
void* operator new[](std::size_t size, std::align_val_t a, const std::nothrow_t&) noexcept {
  return allocate(size, static_cast<std::size_t>(a));
}
void operator delete(void* memory) noexcept { free_counted(memory); }
void operator delete[](void* memory) noexcept { free_counted(memory); }
void operator delete(void* memory, std::size_t) noexcept { free_counted(memory); }
void operator delete[](void* memory, std::size_t) noexcept { free_counted(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { free_counted(memory); }
void operator delete[](void* memory, std::align_val_t) noexcept { free_counted(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { free_counted(memory); }
void operator delete[](void* memory, std::size_t, std::align_val_t) noexcept { free_counted(memory); }
void operator delete(void* memory, const std::nothrow_t&) noexcept { free_counted(memory); }
void operator delete[](void* memory, const std::nothrow_t&) noexcept { free_counted(memory); }
void operator delete(void* memory, std::align_val_t, const std::nothrow_t&) noexcept { free_counted(memory); }
void operator delete[](void* memory, std::align_val_t, const std::nothrow_t&) noexcept { free_counted(memory); }
#endif
