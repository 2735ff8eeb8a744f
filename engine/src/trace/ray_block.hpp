// RayBlock: a block of rays as plain arrays, small enough for the first-level cache. Sensors fill it, a Scene traces it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace swiftlet::trace {

struct RayBlock {
  static constexpr std::size_t kRays = 256;
  static constexpr std::size_t kPadding = 16;  // whole vectors may be written past the last ray

  std::size_t count = 0;
  alignas(64) float org_x[kRays + kPadding];  // m, world frame
  alignas(64) float org_y[kRays + kPadding];
  alignas(64) float org_z[kRays + kPadding];
  alignas(64) float dir_x[kRays + kPadding];  // unit, world frame
  alignas(64) float dir_y[kRays + kPadding];
  alignas(64) float dir_z[kRays + kPadding];
  alignas(64) float range[kRays + kPadding];           // m; a hit is in [0, range]
  alignas(64) float t_hit[kRays + kPadding];           // m, inf on a miss; written by Scene::intersect
  alignas(64) std::int32_t element[kRays + kPadding];  // index as World::raycast gives it, -1 on a miss; likewise
};

}  // namespace swiftlet::trace
