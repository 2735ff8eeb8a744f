// Tests paths, to guarantee that generated worlds are solvable.
#pragma once

#include <span>

#include "collision/hull.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Returns whether the drone, level and facing +x, can fly straight from point to point without touching anything.
bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points);

// Returns whether a scripted body keeps clear of the static world by `margin_m` during its whole round trip, which has to be
// periodic: waypoints, an orbit, a hinge or a slider.
bool is_free_body(const World& world, const BodyConfig& body, float margin_m);

}  // namespace flockstep
