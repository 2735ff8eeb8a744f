// raycast: what single rays hit in a world, with all that is known of a hit.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct RayHits {
  std::vector<float> t_hit;             // (R,) m along the unit direction; inf on a miss
  std::vector<Vec3> normal;             // (R,) unit, facing the ray's origin; 0 on a miss
  std::vector<float> u, v;              // (R,) where on a triangle: the weights of its second and third vertex; 0 elsewhere
  std::vector<std::int32_t> primitive;  // (R,) index into primitives(), then primitives().size() + triangle; -1 on a miss
  std::vector<std::int32_t> material;   // (R,) index into materials(); -1 on a miss
};

// Nearest hits of R rays; origins and directions are (R, 3). Directions need not be unit (they are normalised). Throws
// std::invalid_argument on shapes that differ, on origins outside the world (kMaxCoordinate), on directions that are not finite
// or of length 0, and on a max_range_m that is not positive.
FLOCKSTEP_API RayHits raycast(const World& world, std::span<const float> origins, std::span<const float> directions,
                              float max_range_m);

}  // namespace flockstep
