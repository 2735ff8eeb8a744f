// Tests paths, to guarantee that generated worlds are solvable.
#pragma once

#include <span>

#include "collision/hull.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Returns whether the drone, level and facing +x, can fly straight from point to point without touching anything.
bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points);

}  // namespace flockstep
