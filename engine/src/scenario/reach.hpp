// Whether a drone can fly between two places, without saying how; plan() says how, and takes memory for every cell of the world.
#pragma once

#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// True if the drone, level and facing +x, can fly from one place to the other straight, or by straight steps of cell_m along the
// axes on a lattice through `from`, up to whose nodes around `to` a straight step leads. Without a room the sky above the world
// and what is beside it are searched as far as the drone needs. Says false, too, where the search grows beyond some million
// nodes.
bool is_reachable(const World& world, const DroneModel& drone, const Vec3& from, const Vec3& to, float cell_m);

}  // namespace flockstep
