// AlignedVector: a vector aligned to a cache line, so that JAX and PyTorch can view its memory without a copy.
#pragma once

#include <cstddef>
#include <cstdint>
#include <new>
#include <vector>

namespace flockstep {

inline constexpr std::size_t kAlignment = 64;  // bytes

// Allocates memory aligned to kAlignment.
template <class T>
struct AlignedAllocator {
  using value_type = T;  // as the standard requires of an allocator

  AlignedAllocator() = default;
  // Converts from the allocator of another type; there is no state to copy.
  template <class U>
  AlignedAllocator(const AlignedAllocator<U>&) {}  // NOLINT: allocators convert

  // Returns memory for `count` values. Throws std::bad_alloc if there is none.
  T* allocate(std::size_t count) {
    if (count > SIZE_MAX / sizeof(T)) throw std::bad_array_new_length();
    return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t{kAlignment}));
  }
  // Frees memory from allocate().
  void deallocate(T* memory, std::size_t) { ::operator delete(memory, std::align_val_t{kAlignment}); }
  bool operator==(const AlignedAllocator&) const { return true; }  // always: any of them frees the memory of another
};

// A vector aligned to a cache line.
template <class T>
using AlignedVector = std::vector<T, AlignedAllocator<T>>;

}  // namespace flockstep
