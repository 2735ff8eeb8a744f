// Whether a drone can fly a way, which generated worlds promise.
#pragma once

#include <span>

#include "collision/hull.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Straight from point to point, level, facing +x, touching nothing.
bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points);

}  // namespace flockstep
