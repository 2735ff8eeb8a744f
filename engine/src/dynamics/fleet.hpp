// Fleet: the drones of a batch that fly by their rotors: physics, wind, and the free space that was found around each of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dynamics/flight.hpp"
#include "dynamics/wind.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// Cached obstacle-free balls: while a drone stays inside its own, the broad phase is skipped. Results do not depend on them.
struct OpenSpace {
  std::vector<float> center;        // (N, 3) m
  std::vector<float> radius;        // (N,) m; negative: unknown
  std::vector<std::int32_t> world;  // (N,) world_index
};

struct Fleet {
  Fleet(const Airframe& airframe, const DynamicsConfig& config, const ClockConfig& clock, std::size_t drones_per_env,
        std::size_t num_drones);

  std::size_t env_of(DroneIndex drone) const {  // without a division if it can be
    return drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
  }

  // Starts a drone at this velocity, with its rotors at hover speed and the gusts that its episode begins with.
  void start(State& state, DroneIndex drone, const Velocity& velocity) const;
  // Draws the gusts that the drone's episode begins with.
  void begin_gusts(State& state, DroneIndex drone) const;
  // Advances the gusts by a step, which begins ticks_ahead after the envs' present ticks.
  void update_wind(State& state, std::span<const DroneIndex> drones, int ticks_ahead) const;

  const DynamicsConfig config;
  const ClockConfig clock;
  const std::size_t drones_per_env;
  const Airframe airframe;
  const Physics physics;
  const Wind wind;
  OpenSpace open;
};

}  // namespace flockstep::dynamics
