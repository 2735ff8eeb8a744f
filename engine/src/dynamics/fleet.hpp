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
  // One airframe for all drones. Refuses, as the next does, an airframe that cannot be integrated with these ticks.
  Fleet(const Airframe& airframe, const DynamicsConfig& config, const ClockConfig& clock, std::size_t drones_per_env,
        std::size_t num_drones);
  // A table of airframes. airframe_index: (N,) the row of each drone's airframe. A drone flies the same whichever airframes its
  // neighbours have. All drones have one integrator: with Integrator::automatic it is rk4 only if that suits every airframe.
  Fleet(std::span<const Airframe> airframes, std::span<const std::int32_t> airframe_index, const DynamicsConfig& config,
        const ClockConfig& clock, std::size_t drones_per_env);

  std::size_t env_of(DroneIndex drone) const {  // without a division if it can be
    return drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
  }

  const Airframe& airframe_of(DroneIndex drone) const { return airframes[airframe_row(drone)]; }
  // The row of a drone's airframe.
  std::size_t airframe_row(DroneIndex drone) const {
    return airframe_index.empty() ? 0 : static_cast<std::size_t>(airframe_index[drone]);
  }
  // Gives a drone another airframe of the table. Call it between steps: the drone flies on with the speed and rotor speeds it
  // has.
  void set_airframe(DroneIndex drone, std::int32_t row);

  // Starts a drone at this velocity, with its rotors at hover speed and the gusts that its episode begins with.
  void start(State& state, DroneIndex drone, const Velocity& velocity) const;
  // Draws the gusts that the drone's episode begins with.
  void begin_gusts(State& state, DroneIndex drone) const;
  // Advances the gusts by a step, which begins ticks_ahead after the envs' present ticks.
  void update_wind(State& state, std::span<const DroneIndex> drones, int ticks_ahead) const;

  const DynamicsConfig config;
  const ClockConfig clock;
  const std::size_t drones_per_env;
  const std::vector<Airframe> airframes;              // the table
  const std::vector<AirframeNumbers<float>> numbers;  // of each airframe
  std::vector<std::int32_t> airframe_index;           // (N,); empty if the table has one row
  const Physics physics;                              // with every term that an airframe has, and the numbers of the first
  const Wind wind;
  OpenSpace open;
};

}  // namespace flockstep::dynamics
