// NearMemory: stores data that is read together side by side, so that it occupies few memory pages. The processor's TLB covers
// a few thousand pages; without this, a step in a thousand worlds touched more.
#pragma once

#include <hwy/cache_control.h>

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <memory_resource>
#include <utility>

namespace flockstep {

// Serves allocations in order from a fixed buffer until it is full, then from the heap. Freed space is not reused. Not
// thread-safe.
class NearMemory final : public std::pmr::memory_resource {
 public:
  // Deleter for an object that make_near() created.
  template <class T>
  struct Delete {
    NearMemory* memory;
    void operator()(const T* object) const {
      std::destroy_at(object);
      memory->deallocate(const_cast<T*>(object), sizeof(T), alignof(T));
    }
  };
  template <class T>
  using Pointer = std::unique_ptr<const T, Delete<T>>;

 private:
  void* do_allocate(std::size_t bytes, std::size_t alignment) override {
    void* place = room_.data() + used_;
    std::size_t left = room_.size() - used_;
    if (std::align(alignment, bytes, place, left) == nullptr) return std::pmr::new_delete_resource()->allocate(bytes, alignment);
    used_ = room_.size() - left + bytes;
    return place;
  }
  void do_deallocate(void* place, std::size_t bytes, std::size_t alignment) override {
    const std::less<const void*> before;
    if (!before(place, room_.data()) && before(place, room_.data() + room_.size())) return;
    std::pmr::new_delete_resource()->deallocate(place, bytes, alignment);
  }
  bool do_is_equal(const memory_resource& other) const noexcept override { return this == &other; }

  static constexpr std::size_t kRoom = 7 * 1024;  // bytes; scene and obstacles of a playground take about 6,000
  alignas(64) std::array<std::byte, kRoom> room_;
  std::size_t used_ = 0;
};

// Creates an object in the memory. The object receives the memory as its last constructor argument, for its own allocations.
template <class T, class... Args>
NearMemory::Pointer<T> make_near(NearMemory& memory, Args&&... args) {
  void* const place = memory.allocate(sizeof(T), alignof(T));
  try {
    return {std::construct_at(static_cast<T*>(place), std::forward<Args>(args)..., memory), {&memory}};
  } catch (...) {
    memory.deallocate(place, sizeof(T), alignof(T));
    throw;
  }
}

// Prefetches the cache lines of a range of bytes, at most the first ten, before they are needed.
inline void prefetch(const void* first, std::size_t bytes) {
  constexpr std::size_t kLine = 64, kMax = 10 * kLine;
  const char* const from = static_cast<const char*>(first);
  for (std::size_t at = 0; at < bytes && at < kMax; at += kLine) hwy::Prefetch(from + at);
}

}  // namespace flockstep
