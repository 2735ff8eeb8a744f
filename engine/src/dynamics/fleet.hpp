// Fleet: the rotor-driven drones of a batch, with their physics, the wind and the free space known around each drone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "dynamics/downwash.hpp"
#include "dynamics/flight.hpp"
#include "dynamics/wind.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// A cached obstacle-free ball for each drone. Inside it the broad phase is skipped. Results do not depend on the cache.
struct OpenSpace {
  std::vector<float> center;        // (N, 3) m
  std::vector<float> radius;        // (N,) m; negative: unknown
  std::vector<std::int32_t> world;  // (N,) world_index
};

struct Fleet {
  // One airframe for all drones. Both constructors reject an airframe that cannot be integrated with these ticks.
  Fleet(const Airframe& airframe, const DynamicsConfig& config, const ClockConfig& clock, std::size_t drones_per_env,
        std::size_t num_drones);
  // A table of airframes. airframe_index: (N,) the row of each drone's airframe. A drone's flight does not depend on the
  // airframes of its neighbours. All drones share one integrator: Integrator::automatic picks rk4 only if it suits every
  // airframe.
  Fleet(std::span<const Airframe> airframes, std::span<const std::int32_t> airframe_index, const DynamicsConfig& config,
        const ClockConfig& clock, std::size_t drones_per_env);

  std::size_t env_of(DroneIndex drone) const {  // no division for single drones
    return drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
  }

  const Airframe& airframe_of(DroneIndex drone) const { return airframes[airframe_row(drone)]; }
  std::size_t airframe_row(DroneIndex drone) const {
    return airframe_index.empty() ? 0 : static_cast<std::size_t>(airframe_index[drone]);
  }
  // Assigns another airframe of the table to a drone. Call it between steps: the drone keeps its velocity and rotor speeds.
  void set_airframe(DroneIndex drone, std::int32_t row);

  // The physics for commands of another control.
  Physics physics_for(Control control) const;

  // Starts a drone at this velocity, with its rotors at hover speed and the initial gusts of its episode.
  void start(State& state, DroneIndex drone, const Velocity& velocity) const;
  // Draws the initial gusts of the drone's episode.
  void begin_gusts(State& state, DroneIndex drone) const;
  // Advances the gusts by one step. The step begins ticks_ahead after the current tick of each env.
  void update_wind(State& state, std::span<const DroneIndex> drones, int ticks_ahead) const;

  const DynamicsConfig config;
  const ClockConfig clock;
  const std::size_t drones_per_env;
  const std::vector<Airframe> airframes;              // the table
  const std::vector<AirframeNumbers<float>> numbers;  // one for each airframe
  std::vector<std::int32_t> airframe_index;           // (N,); empty if the table has one row
  const Physics physics;                              // terms of all airframes, numbers of the first
  const std::vector<WashNumbers> wash;                // one for each airframe
  const Wind wind;
  // (N, 4) share of its thrust that each rotor keeps in the wash of other drones, written by Downwash; empty without downwash.
  std::vector<float> thrust_share;
  OpenSpace open;
};

}  // namespace flockstep::dynamics
