// Prefetch: asks for memory before it is needed, so that nobody waits for it.
#pragma once

#include <hwy/cache_control.h>

#include <cstddef>

namespace flockstep {

// The cache lines of some bytes; no more than the first of them.
inline void prefetch(const void* first, std::size_t bytes) {
  constexpr std::size_t kLine = 64, kMost = 8 * kLine;
  const char* const from = static_cast<const char*>(first);
  for (std::size_t at = 0; at < bytes && at < kMost; at += kLine) hwy::Prefetch(from + at);
}

}  // namespace flockstep
