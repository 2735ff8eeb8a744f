// Lists of indices.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <span>
#include <vector>

namespace flockstep {

// Calls f(first, count) for each run of consecutive indices in an ascending list, so that a loop over a run works on one
// contiguous part of an array.
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

// Sorts the indices of a mesh and removes duplicates. Indices must not be negative. Takes linear time if they are dense, as the
// vertices of a mesh usually are.
template <class Index>
void sort_unique(std::vector<Index>& indices) {
  if (indices.empty()) return;
  const auto [least, greatest] = std::minmax_element(indices.begin(), indices.end());
  const Index first = *least;
  const std::size_t range = static_cast<std::size_t>(*greatest - first) + 1;
  if (range / 2 > indices.size()) {
    std::sort(indices.begin(), indices.end());
    indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
    return;
  }
  std::vector<bool> is_used(range);
  for (const Index index : indices) is_used[static_cast<std::size_t>(index - first)] = true;
  std::size_t count = 0;
  for (std::size_t i = 0; i < range; ++i) {
    if (is_used[i]) indices[count++] = first + static_cast<Index>(i);
  }
  indices.resize(count);
}

}  // namespace flockstep
