// Whether a drone touches anything in a world, asked once: with its obstacles and the drone's hull looked up anew.
#pragma once

#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep::testing {

inline collision::Contact sweep(const World& world, const DroneModel& drone, const Pose& from, const Pose& to) {
  return collision::sweep(prepared(world).obstacles(), collision::Hull(drone), from, to);
}

inline bool overlaps(const World& world, const DroneModel& drone, const Pose& pose) {
  return collision::overlaps(prepared(world).obstacles(), collision::Hull(drone), pose);
}

}  // namespace flockstep::testing
