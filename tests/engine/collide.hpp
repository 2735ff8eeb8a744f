// Single collision queries for a world and a drone. Each call looks up the obstacles and builds the hull again.
#pragma once

#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep::testing {

inline const DroneModel& quadrotor() {
  static const DroneModel model = DroneModel::quadrotor650();
  return model;
}

inline collision::Contact sweep(const World& world, const DroneModel& drone, const Pose& from, const Pose& to) {
  return collision::sweep(prepared(world).obstacles(), collision::Hull(drone), from, to);
}

inline bool overlaps(const World& world, const DroneModel& drone, const Pose& pose) {
  return collision::overlaps(prepared(world).obstacles(), collision::Hull(drone), pose);
}

}  // namespace flockstep::testing
