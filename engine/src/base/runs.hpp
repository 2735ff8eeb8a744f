// Runs: indices that follow each other, so that what is done to all of them is done to a piece of an array.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace flockstep {

// f(first, count) for each run of ascending indices without a gap.
template <class F>
void for_each_run(std::span<const std::uint32_t> indices, const F& f) {
  for (std::size_t i = 0; i < indices.size();) {
    std::size_t end = i + 1;
    while (end < indices.size() && indices[end] == indices[end - 1] + 1) ++end;
    f(std::size_t{indices[i]}, end - i);
    i = end;
  }
}

// Whether any of some flags, bytes, is set.
inline bool is_any(const std::uint8_t* flags, std::size_t count) {
  std::uint8_t any = 0;
  for (std::size_t i = 0; i < count; ++i) any |= flags[i];
  return any != 0;
}

}  // namespace flockstep
