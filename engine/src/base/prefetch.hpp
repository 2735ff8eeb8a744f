// Prefetches memory into the cache before it is needed.
#pragma once

#include <hwy/cache_control.h>

#include <cstddef>

namespace flockstep {

// Prefetches the cache lines of a range of bytes, at most the first ten.
inline void prefetch(const void* first, std::size_t bytes) {
  constexpr std::size_t kLine = 64, kMax = 10 * kLine;
  const char* const from = static_cast<const char*>(first);
  for (std::size_t at = 0; at < bytes && at < kMax; at += kLine) hwy::Prefetch(from + at);
}

}  // namespace flockstep
