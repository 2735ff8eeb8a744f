// Splits an index list into runs of consecutive indices, so that a loop over a run works on one contiguous part of an array.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>

namespace flockstep {

// Calls f(first, count) for each run of consecutive indices in an ascending list.
template <class Indices, class F>
void for_each_contiguous(const Indices& indices, const F& f) {
  const auto* const first = std::data(indices);
  const std::size_t size = std::size(indices);
  for (std::size_t i = 0; i < size;) {
    std::size_t end = i + 1;
    while (end < size && first[end] == first[end - 1] + 1) ++end;
    f(std::size_t{first[i]}, end - i);
    i = end;
  }
}

// Returns whether any of the flags (bytes) is set.
inline bool is_any(const std::uint8_t* flags, std::size_t count) {
  std::uint8_t any = 0;
  for (std::size_t i = 0; i < count; ++i) any |= flags[i];
  return any != 0;
}

}  // namespace flockstep
