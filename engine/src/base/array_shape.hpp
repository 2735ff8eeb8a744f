// ArrayShape: the shape of a listed array, for NumPy and the server.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/arrays.hpp"

namespace flockstep {

// It does not allocate, because every step creates some views.
struct ArrayShape {
  std::array<std::ptrdiff_t, 5> sizes{};
  std::size_t dimensions = 1;

  void add(std::ptrdiff_t size) { sizes[dimensions++] = size; }
  std::span<const std::ptrdiff_t> span() const { return std::span(sizes).first(dimensions); }
};

inline ArrayShape shape_of(const ArrayView& array) {
  const int columns = array.info.columns;
  const ItemShape& items = array.items;
  ArrayShape shape;
  if (array.info.rows == Rows::body) shape.add(items.bodies[1]);
  if (columns > 0 && items.columns_first) shape.add(columns);
  for (std::size_t i = 0; array.info.per != Per::row && i < items.dimensions; ++i) shape.add(items.sizes[i]);
  if (columns > 0 && !items.columns_first) shape.add(columns);
  std::ptrdiff_t width = 1;
  for (std::size_t i = 1; i < shape.dimensions; ++i) width *= shape.sizes[i];
  if (array.info.rows == Rows::body) {
    shape.sizes[0] = items.bodies[0];  // the number of values does not show it if B is 0
    return shape;
  }
  shape.sizes[0] = static_cast<std::ptrdiff_t>(array.size) / std::max<std::ptrdiff_t>(width, 1);
  return shape;
}

}  // namespace flockstep
