// State: the drones and envs of a batch, structure of arrays. E envs of M drones each are N = E M drones, env by env.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

using FlagArray = AlignedVector<std::uint8_t>;  // 0 or 1, viewed as bool

struct ContactState {           // of the last motion; written by collision, cleared by a reset or teleport
  FlagArray hit;                // (N,) something was touched
  FlagArray inside;             // (N,) the motion began in penetration
  std::vector<float> fraction;  // (N,) of the motion that was flown; with substeps, of the one that hit
  std::vector<float> point;     // (N, 3) m, world frame, on the obstacle
  std::vector<float> normal;    // (N, 3) unit, world frame, from the obstacle towards the drone

  static constexpr auto fields() {
    using C = ContactState;
    return field_list(field("hit", &C::hit), field("inside", &C::inside), field("fraction", &C::fraction),
                      field("point", &C::point), field("normal", &C::normal));
  }
};

// Of drones that fly by their rotors; with kinematic motion all of these are empty. Written by flight, contacts and resets.
struct FlightState {
  std::vector<float> velocity;              // (N, 3) m/s, world frame
  std::vector<float> angular_velocity;      // (N, 3) rad/s, body frame
  std::vector<float> acceleration;          // (N, 3) m/s^2, world frame: mean of the last tick, 0 where it ended in a contact
  std::vector<float> angular_acceleration;  // (N, 3) rad/s^2, body frame: likewise
  std::vector<float> rotor_speed;           // (N, 4) rad/s
  std::vector<float> rotor_command;         // (N, 4) rad/s: what the rotors were last told
  std::vector<float> error_integral;        // (N, 3) m: of the velocity, for the controller
  std::vector<float> remainder;             // (N, 3) m: of the position, what float32 has rounded off
  std::vector<float> wind;                  // (N, 3) m/s, world frame: in the last step; written before each, and by resets
  std::vector<float> gust;                  // (N, 5) what it is made of; see dynamics::GustState

  static constexpr auto fields() {
    using C = FlightState;
    return field_list(field("velocity", &C::velocity), field("angular_velocity", &C::angular_velocity),
                      field("acceleration", &C::acceleration), field("angular_acceleration", &C::angular_acceleration),
                      field("rotor_speed", &C::rotor_speed), field("rotor_command", &C::rotor_command),
                      field("error_integral", &C::error_integral), field("remainder", &C::remainder), field("wind", &C::wind),
                      field("gust", &C::gust));
  }
};

struct State {
  // of drones, hot: read and written every step
  std::vector<float> position;   // (N, 3) m, world frame; written by dynamics, collision, resets
  std::vector<float> quat_wxyz;  // (N, 4) unit, body to world; likewise
  ContactState contact;
  FlightState flight;
  FlagArray active;  // (N,) 0: the slot is removed
  // of envs
  std::vector<std::int32_t> world_index;  // (E,) into the batch's worlds
  std::vector<std::uint64_t> seed;        // (E,) key of the env's random numbers
  std::vector<std::int64_t> episode;      // (E,) which episode of its seed, from 0
  std::vector<std::int64_t> tick;         // (E,) substeps flown in this episode; written by the step and by move()
  std::vector<std::int64_t> sensed;       // (E,) number of the latest reading in this episode: 0 at its first moment, -1 before

  static constexpr auto fields() {
    using C = State;
    return field_list(field("position", &C::position), field("quat_wxyz", &C::quat_wxyz), field("contact", &C::contact),
                      field("flight", &C::flight), field("active", &C::active), field("world_index", &C::world_index),
                      field("seed", &C::seed), field("episode", &C::episode), field("tick", &C::tick),
                      field("sensed", &C::sensed));
  }
};

// The pose of a drone. The index is not checked.
inline Vec3 position_of(const State& state, DroneIndex drone) {
  const float* const p = state.position.data() + 3 * drone;
  return {p[0], p[1], p[2]};
}
inline Pose pose_of(const State& state, DroneIndex drone) {
  const float* const q = state.quat_wxyz.data() + 4 * drone;
  return {position_of(state, drone), Quat(q[0], q[1], q[2], q[3])};
}

// The episodes of a task, one after another in each env. Only batch/episodes.cpp writes them. R rows are N or E, as
// TaskSpec::row says.
struct EpisodeState {
  std::vector<std::int64_t> steps;       // (E,) flown in this episode, the step under way included
  std::vector<std::int64_t> time_limit;  // (E,) steps; 0: none
  std::vector<double> episode_return;    // (R,) sum of the rewards so far
  std::vector<double> episode_terms;     // (R, number of terms) sum of each reward term so far
  FlagArray begun;                       // (E,) the first episode has begun
  FlagArray done;                        // (E,) the episode ended and no reset has come since
  FlagArray flying;                      // (E,) takes part in the present or last step; 0: its episode was over before
  FlagArray bad;                         // (R,) a number is not finite: the episode ends in the present step
  std::vector<std::int64_t> bad_states;  // (R,) episodes that ended so, since the batch was made; see Outputs::bad_state
  FlagArray action_changed;              // (R,) the action differs from that of the step before; so does an episode's first

  static constexpr auto fields() {
    using C = EpisodeState;
    return field_list(field("steps", &C::steps), field("time_limit", &C::time_limit), field("episode_return", &C::episode_return),
                      field("episode_terms", &C::episode_terms), field("begun", &C::begun), field("done", &C::done),
                      field("flying", &C::flying), field("bad", &C::bad), field("bad_states", &C::bad_states),
                      field("action_changed", &C::action_changed));
  }
};

}  // namespace flockstep
