// Sorts the indices of a mesh and removes duplicates.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace flockstep {

// Indices must not be negative. Takes linear time if they are dense, as the vertices of a mesh usually are.
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
