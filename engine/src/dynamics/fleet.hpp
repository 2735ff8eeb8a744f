// Fleet: the rotor-driven drones of a batch, with their physics, the wind and the free space known around each drone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "dynamics/command_ring.hpp"
#include "dynamics/downwash.hpp"
#include "dynamics/flight.hpp"
#include "dynamics/parameters.hpp"
#include "dynamics/wind.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/aligned.hpp"
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
  // variations: what differs from drone to drone.
  Fleet(std::span<const Airframe> airframes, std::span<const std::int32_t> airframe_index, const DynamicsConfig& config,
        const ClockConfig& clock, std::size_t drones_per_env, const Variations& variations = {});

  std::size_t env_of(DroneIndex drone) const {  // no division for single drones
    return drones_per_env == 1 ? std::size_t{drone} : drone / drones_per_env;
  }

  // The drone's airframe as the controller knows it, and the true one, with the drone's parameters.
  const Airframe& airframe_of(DroneIndex drone) const { return airframes[airframe_row(drone)]; }
  const Airframe& true_airframe_of(DroneIndex drone) const {
    return true_airframes.empty() ? airframe_of(drone) : true_airframes[drone];
  }
  std::size_t airframe_row(DroneIndex drone) const {
    return airframe_index.empty() ? 0 : static_cast<std::size_t>(airframe_index[drone]);
  }
  // Assigns another airframe of the table to a drone. Call it between steps: the drone keeps its velocity and rotor speeds.
  void set_airframe(DroneIndex drone, std::int32_t row);
  // Columns of rotor speeds: the largest number of rotors of an airframe; others are 0 in the columns that they lack.
  std::size_t num_rotors() const { return physics.num_rotors; }
  // Numbers of a command, C.
  std::size_t command_size(Control control) const { return tells_rotors(control) ? num_rotors() : 4; }
  void clear_absent_rotors(State& state, DroneIndex drone) const;

  bool has_parameters() const { return !variations.empty(); }
  static DroneParameters parameters_of(const State& state, DroneIndex drone);
  // Draws the parameters of the drone's episode. redraw: those that change at the tick of a control step that is about to begin.
  void begin_parameters(State& state, DroneIndex drone);
  void redraw_parameters(State& state, std::span<const DroneIndex> drones, int ticks_ahead);
  // Replaces the laws of the next draws. Throws std::invalid_argument unless they are about the same parameters.
  void set_variations(const Variations& next);
  // Throws std::invalid_argument unless a drone may have these parameters: those that no variation lists keep their defaults.
  void check_parameters(std::span<const float> parameters) const;
  void part();  // gives each drone its own coefficients, before some are set
  // Takes over the parameters of a drone in the state.
  void apply_parameters(State& state, DroneIndex drone);
  // Takes over those of all drones from a snapshot. Throws std::invalid_argument if its numbers are not valid.
  void restored(State& state);
  // Uses up the batteries in a control step that is about to be flown.
  void drain_batteries(State& state, std::span<const DroneIndex> drones) const;
  // Share of its commanded speed that each rotor is driven to at a tick of the episode, by the battery and if it lives.
  std::array<float, kMaxRotors> speed_share(const State& state, DroneIndex drone, std::int64_t tick) const;
  // Sends the commands (N, C) of drones on their way, if they may be late. Their time is the current tick of each env.
  void send_commands(const State& state, std::span<const DroneIndex> drones, std::span<const float> command);

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
  Variations variations;
  Physics physics;                          // terms of all drones, numbers of the first airframe or of all drones alike
  std::vector<Airframe> true_airframes;     // (N,); empty if all drones are as their airframe
  AlignedVector<LaneNumbers> lane_numbers;  // of kLanes consecutive drones each; empty if all drones have the same
  const std::vector<WashNumbers> wash;      // one for each airframe
  const Wind wind;
  // (N, rotors) share of its thrust that each rotor keeps in the wash of other drones, written by Downwash; empty without
  // downwash.
  std::vector<float> thrust_share;
  CommandRing commands;  // on their way to the drones
  // Called for each drone at the start of a step, if commands may be late: its command was sent (true) or lost.
  std::function<void(DroneIndex, bool)> on_sent;
  OpenSpace open;

 private:
  // Turns on the terms that parameters in this range need.
  void turn_on(const DroneParameters& least, const DroneParameters& greatest);
  void renew(DroneIndex drone, const DroneParameters& parameters);
};

}  // namespace flockstep::dynamics
