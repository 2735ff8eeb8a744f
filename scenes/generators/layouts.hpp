// Helpers of generators that draw layouts: the retry loop until a drone can fly through one, lanes, and rounding.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/world_builder.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep {

// Rounds a coordinate to 1 cm.
inline double centimetres(double metres) { return std::floor(metres * 100.0 + 0.5) / 100.0; }

// Returns the first non-null world of make(0), make(1), ..., or null if all attempts fail.
template <class Make>
std::shared_ptr<const World> first_layout(std::uint32_t attempts, const Make& make) {
  for (std::uint32_t attempt = 0; attempt < attempts; ++attempt) {
    Interrupt::poll();
    if (std::shared_ptr<const World> world = make(attempt)) return world;
  }
  return nullptr;
}

inline std::vector<Vec3> rounded(const std::vector<Vec3d>& points) {
  std::vector<Vec3> rounded;
  for (const Vec3d& point : points) rounded.push_back(point.cast<float>());
  return rounded;
}

// Sets the markers: the ends of a lane, with a spawn box around its start, and waypoints at its corners if there are to be some.
inline void mark_lane(WorldBuilder& builder, const std::vector<Vec3>& lane, double spawn_reach_m, bool has_waypoints) {
  const Vec3 reach = Vec3::Constant(static_cast<float>(spawn_reach_m));
  builder.start(lane.front());
  builder.goal(lane.back());
  for (std::size_t i = 1; has_waypoints && i + 1 < lane.size(); ++i) builder.waypoint(lane[i]);
  builder.spawn_box({lane.front() - reach, lane.front() + reach});
}

// Returns the first world whose lane is free, but not the straight way between its ends. add_movers(world, layout, attempt)
// returns it with bodies.
template <class Layout, class Config, class AddMovers>
std::shared_ptr<const World> with_crooked_lane(const Config& config, const char* seed_field, const AddMovers& add_movers) {
  constexpr std::uint32_t kAttempts = 16;
  config.validate();
  const collision::Hull hull(DroneModel::quadrotor650());
  const auto build = [&](std::uint32_t attempt) -> std::shared_ptr<const World> {
    Layout layout(config, attempt);
    auto world = layout.built().build();
    const std::vector<Vec3> lane = layout.lane(), straight{lane.front(), lane.back()};
    if (is_free_way(*world, hull, straight) || !is_free_way(*world, hull, lane)) return nullptr;
    return add_movers(world, layout, attempt);
  };
  if (auto world = first_layout(kAttempts, build)) return world;
  refuse(seed_field, "one with a free way that is not straight (none in " + std::to_string(kAttempts) + " layouts)", config.seed);
}

}  // namespace flockstep
