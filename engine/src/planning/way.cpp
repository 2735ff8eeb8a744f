#include "planning/way.hpp"

#include <cstddef>

#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {

bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points) {
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const Pose from{.position = points[i]}, to{.position = points[i + 1]};
    if (collision::sweep(prepared(world).obstacles(), hull, from, to).hit) return false;
  }
  return true;
}

}  // namespace flockstep
