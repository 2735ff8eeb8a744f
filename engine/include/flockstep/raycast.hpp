// raycast: casts single rays into a world and returns all details of their hits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Hits of R rays.
struct RayHits {
  std::vector<float> t_hit;             // (R,) m along the unit direction; inf on a miss
  std::vector<Vec3> normal;             // (R,) unit, facing the ray's origin; 0 on a miss
  std::vector<float> u, v;              // (R,) weights of the second and third vertex of the triangle that was hit; 0 elsewhere
  std::vector<std::int32_t> primitive;  // (R,) index into primitives(), or primitives().size() + triangle; -1 on a miss
  std::vector<std::int32_t> material;   // (R,) index into materials(); -1 on a miss
};

// Returns the nearest hits of R rays. origins and directions are (R, 3), world frame, origins in m. Directions are normalised.
// Throws std::invalid_argument if the shapes differ, an origin is outside the world (kMaxCoordinate), a direction is not finite
// or has length 0, or max_range_m is not positive.
FLOCKSTEP_API RayHits raycast(const World& world, std::span<const float> origins, std::span<const float> directions,
                              float max_range_m);

}  // namespace flockstep
