// State: the drones and envs of a batch, as a structure of arrays. E envs of M drones are N = E M drones, ordered by env. The
// lists, fields(), give shapes, units, frames and writers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/drones/variation.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

using FlagArray = AlignedVector<std::uint8_t>;  // 0 or 1, viewed as bool

struct ContactState {  // contacts of the last motion
  FlagArray hit;
  FlagArray inside;
  std::vector<float> fraction;
  std::vector<float> point;
  std::vector<float> normal;
  std::vector<std::int32_t> body;
  std::vector<std::int32_t> drone;
  std::vector<float> surface_velocity;

  static constexpr auto fields() {
    using C = ContactState;
    constexpr const char* kWriter = "collision; cleared by a reset or a teleport";
    return field_list(
        array("hit", &C::hit, {.values = Values::flag, .writer = kWriter, .about = "True if the drone touched something"}),
        array("inside", &C::inside,
              {.values = Values::flag,
               .writer = kWriter,
               .about =
                   "True if the drone overlapped an obstacle at the beginning of the motion, or a body squeezed it at the end"}),
        array("fraction", &C::fraction,
              {.values = Values::fraction,
               .writer = kWriter,
               .about = "fraction of the motion, or of the tick that hit, flown before the contact"}),
        array("point", &C::point,
              {.columns = 3, .unit = "m", .frame = Frame::world, .writer = kWriter, .about = "contact point on the obstacle"}),
        array("normal", &C::normal,
              {.columns = 3,
               .unit = "1",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "direction from the obstacle towards the drone"}),
        array(
            "body", &C::body,
            {.values = Values::last_count, .writer = kWriter, .about = "number of the touched body in its env, -1 without one"}),
        array(
            "drone", &C::drone,
            {.values = Values::last_count, .writer = kWriter, .about = "number of the touched drone in its env, -1 without one"}),
        array("surface_velocity", &C::surface_velocity,
              {.columns = 3,
               .unit = "m/s",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "velocity of the touched body or drone at the contact point, 0 for the static world"}));
  }
};

// Bodies, E envs of B slots. See flockstep/body.hpp.
struct BodyState {
  FlagArray active;
  std::vector<float> position;
  std::vector<float> quat_wxyz;
  std::vector<float> velocity;
  std::vector<float> angular_velocity;
  FlagArray scripted;
  std::vector<std::int32_t> model;
  std::vector<std::int64_t> changes;

  static constexpr auto fields() {
    using C = BodyState;
    constexpr const char* kWriter = "the step, resets, calls of batch.bodies";
    return field_list(
        array("body_active", &C::active,
              {.rows = Rows::body, .values = Values::flag, .writer = kWriter, .about = "True if the slot holds a body"}),
        array("body_position", &C::position,
              {.rows = Rows::body, .columns = 3, .unit = "m", .frame = Frame::world, .writer = kWriter, .about = "position"}),
        array("body_quat_wxyz", &C::quat_wxyz,
              {.rows = Rows::body,
               .columns = 4,
               .unit = "1",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "orientation, body to world"}),
        array("body_velocity", &C::velocity,
              {.rows = Rows::body, .columns = 3, .unit = "m/s", .frame = Frame::world, .writer = kWriter, .about = "velocity"}),
        array("body_angular_velocity", &C::angular_velocity,
              {.rows = Rows::body,
               .columns = 3,
               .unit = "rad/s",
               .frame = Frame::body,
               .writer = kWriter,
               .about = "angular velocity"}),
        array("body_scripted", &C::scripted,
              {.rows = Rows::body,
               .values = Values::flag,
               .writer = kWriter,
               .about = "True if the body's script moves it, False after a call has moved it"}),
        array(
            "body_model", &C::model,
            {.rows = Rows::body, .access = Access::internal, .writer = kWriter, .about = "number of the body's model; -1: none"}),
        array("body_changes", &C::changes,
              {.rows = Rows::env,
               .values = Values::count,
               .access = Access::internal,
               .writer = kWriter,
               .about = "number of ticks and calls that changed what sensors see of the bodies"}));
  }
};

// State of rotor motion. With kinematic motion all of these arrays are empty.
struct FlightState {
  std::vector<float> velocity;
  std::vector<float> angular_velocity;
  std::vector<float> acceleration;
  std::vector<float> angular_acceleration;
  std::vector<float> rotor_speed;
  std::vector<float> rotor_command;
  std::vector<float> error_integral;
  std::vector<float> remainder;
  std::vector<float> wind;
  std::vector<float> gust;  // see dynamics::GustState

  static constexpr auto fields() {
    using C = FlightState;
    constexpr const char* kWriter = "flight, contacts, resets";
    return field_list(
        array("velocity", &C::velocity,
              {.columns = 3, .unit = "m/s", .frame = Frame::world, .writer = kWriter, .about = "velocity"}),
        array("angular_velocity", &C::angular_velocity,
              {.columns = 3, .unit = "rad/s", .frame = Frame::body, .writer = kWriter, .about = "angular velocity"}),
        array("acceleration", &C::acceleration,
              {.columns = 3,
               .unit = "m/s^2",
               .frame = Frame::world,
               .writer = kWriter,
               .about = "mean of the last tick, 0 if the tick ended in a contact"}),
        array("angular_acceleration", &C::angular_acceleration,
              {.columns = 3,
               .unit = "rad/s^2",
               .frame = Frame::body,
               .writer = kWriter,
               .about = "mean of the last tick, 0 if the tick ended in a contact"}),
        array("rotor_speed", &C::rotor_speed,
              {.per = Per::rotor,
               .unit = "rad/s",
               .writer = kWriter,
               .about = "speeds of the rotors, in the order of the airframe; 0 for those that a drone lacks"}),
        array("rotor_command", &C::rotor_command,
              {.per = Per::rotor,
               .unit = "rad/s",
               .access = Access::internal,
               .writer = kWriter,
               .about = "last commanded speeds"}),
        array("error_integral", &C::error_integral,
              {.columns = 3,
               .unit = "m",
               .frame = Frame::world,
               .access = Access::internal,
               .writer = kWriter,
               .about = "integral of the velocity error, for the controller"}),
        array("remainder", &C::remainder,
              {.columns = 3,
               .unit = "m",
               .frame = Frame::world,
               .access = Access::internal,
               .writer = kWriter,
               .about = "rounding error of the position in float32"}),
        array("wind", &C::wind,
              {.columns = 3,
               .unit = "m/s",
               .frame = Frame::world,
               .writer = "the step, before it flies; resets",
               .about = "wind of the last step. Before the first step: the wind at the start"}),
        array("gust", &C::gust,
              {.columns = 5,
               .access = Access::internal,
               .writer = "the step, before it flies; resets",
               .about = "state of the gusts"}));
  }
};

// Numbers that differ from drone to drone. Both arrays are empty without BatchConfig::variations.
struct ParameterState {
  std::vector<float> params;
  std::vector<float> battery;

  static constexpr auto fields() {
    using C = ParameterState;
    constexpr const char* kWriter = "resets, the step, set_params()";
    return field_list(
        array("params", &C::params,
              {.columns = static_cast<int>(kNumParameters),
               .writer = kWriter,
               .about = "fields of `DroneParameters`, in the order of `parameter_names`. Empty without `variations`"}),
        array("battery", &C::battery,
              {.values = Values::fraction,
               .writer = "the step, resets",
               .about = "share of the charge that is used. Empty "
                        "without `variations`"}));
  }
};

// Drones whose episodes end without those of their teammates: Episodes::each and Episodes::last with several drones in an env.
// Otherwise both arrays are empty. Only batch/episodes.cpp writes them.
struct OwnEpisodes {
  std::vector<std::int64_t> own_episodes;
  FlagArray finished;

  static constexpr auto fields() {
    using C = OwnEpisodes;
    constexpr const char* kWriter = "the step, resets";
    return field_list(array("own_episodes", &C::own_episodes,
                            {.values = Values::count,
                             .writer = kWriter,
                             .about = "episodes that the drone began alone under the env's seed, to be added to `episode`. Empty "
                                      "unless `episodes` is \"each\" or \"last\""}),
                      array("finished", &C::finished,
                            {.values = Values::flag,
                             .writer = kWriter,
                             .about = "True if the drone waits for the end of its teammates' episodes. Empty unless `episodes` "
                                      "is \"each\" or \"last\""}));
  }
};

struct State {
  // Drones, read and written every step.
  std::vector<float> position;
  std::vector<float> quat_wxyz;
  ContactState contact;       // contacts of the last motion
  FlightState flight;         // velocities, rotor speeds and wind; empty with kinematic motion
  BodyState bodies;           // empty if the batch has none
  ParameterState parameters;  // empty unless drones differ
  OwnEpisodes own;            // empty unless drones end their episodes separately
  FlagArray active;
  // Envs.
  std::vector<std::int32_t> world_index;
  std::vector<std::uint64_t> seed;
  std::vector<std::int64_t> episode;
  std::vector<std::int64_t> tick;
  std::vector<std::int64_t> sensed;

  static constexpr auto fields() {
    using C = State;
    constexpr const char* kWriter = "dynamics, collision, resets";
    return field_list(
        array("position", &C::position,
              {.columns = 3, .unit = "m", .frame = Frame::world, .writer = kWriter, .about = "position"}),
        array("quat_wxyz", &C::quat_wxyz,
              {.columns = 4, .unit = "1", .frame = Frame::world, .writer = kWriter, .about = "orientation, body to world"}),
        field("contact", &C::contact), field("flight", &C::flight), field("bodies", &C::bodies),
        field("parameters", &C::parameters), field("own", &C::own),
        array("active", &C::active,
              {.values = Values::flag,
               .writer = "spawn() and remove(); the step with episodes=\"last\"",
               .about = "True if the drone is there: neither removed nor `finished`"}),
        array("world_index", &C::world_index,
              {.rows = Rows::env,
               .writer = "resets, set_world()",
               .about = "index into `worlds`, or number of the world of a `WorldPool`"}),
        array("seed", &C::seed,
              {.rows = Rows::env,
               .access = Access::internal,
               .writer = "reset(), seed()",
               .about = "key of the env's random numbers"}),
        array("episode", &C::episode,
              {.rows = Rows::env,
               .values = Values::count,
               .writer = "resets, begin_episode()",
               .about = "number of the episode under the env's seed, from 0"}),
        array("tick", &C::tick,
              {.rows = Rows::env,
               .unit = "ticks",
               .values = Values::count,
               .writer = "the step, move(), fly()",
               .about = "ticks flown in the env's episode"}),
        array("sensed", &C::sensed,
              {.rows = Rows::env,
               .values = Values::last_count,
               .access = Access::internal,
               .writer = "the step, sense()",
               .about = "number of the latest reading in the episode: 0 at its first moment, -1 before"}));
  }
};

// Position of a drone, m, world frame. The index is not checked.
inline Vec3 position_of(const State& state, DroneIndex drone) {
  const float* const p = state.position.data() + 3 * drone;
  return {p[0], p[1], p[2]};
}
// Pose of a drone. The index is not checked.
inline Pose pose_of(const State& state, DroneIndex drone) {
  const float* const q = state.quat_wxyz.data() + 4 * drone;
  return {position_of(state, drone), Quat(q[0], q[1], q[2], q[3])};
}

// Episodes of a task, one after another in each row. Only batch/episodes.cpp writes these arrays. R rows are N or E, depending
// on TaskSpec::row. Unless Episodes says otherwise, `steps`, `time_limit`, `done` and `flying` are equal for all rows of an env.
struct EpisodeState {
  std::vector<std::int64_t> steps;
  std::vector<std::int64_t> time_limit;
  std::vector<double> episode_return;
  std::vector<double> episode_terms;
  FlagArray started;
  FlagArray done;
  FlagArray flying;
  FlagArray bad;
  std::vector<std::int64_t> bad_states;
  FlagArray action_changed;

  static constexpr auto fields() {
    using C = EpisodeState;
    constexpr const char* kWriter = "the episode logic";
    return field_list(
        array("steps", &C::steps,
              {.rows = Rows::task,
               .unit = "steps",
               .values = Values::count,
               .writer = kWriter,
               .about = "steps flown in this episode, the current step included"}),
        array("time_limit", &C::time_limit,
              {.rows = Rows::task,
               .unit = "steps",
               .values = Values::count,
               .access = Access::internal,
               .writer = kWriter,
               .about = "time limit; 0: none"}),
        array("return_so_far", &C::episode_return,
              {.rows = Rows::task, .access = Access::internal, .writer = kWriter, .about = "sum of the rewards so far"}),
        array("terms_so_far", &C::episode_terms,
              {.rows = Rows::task,
               .per = Per::term,
               .access = Access::internal,
               .writer = kWriter,
               .about = "sum of each reward term so far"}),
        array("started", &C::started,
              {.rows = Rows::env,
               .values = Values::flag,
               .access = Access::internal,
               .writer = kWriter,
               .about = "the first episode has begun"}),
        array("done", &C::done,
              {.rows = Rows::task,
               .values = Values::flag,
               .access = Access::internal,
               .writer = kWriter,
               .about = "the episode ended and no reset has come since; with Episodes::last, all of the env have ended"}),
        array("flying", &C::flying,
              {.rows = Rows::task,
               .values = Values::flag,
               .writer = kWriter,
               .about = "True if the agent took part in the last step"}),
        array("bad", &C::bad,
              {.rows = Rows::task,
               .values = Values::flag,
               .access = Access::internal,
               .writer = kWriter,
               .about = "a number is not finite: the episode ends in the current step"}),
        array("bad_states", &C::bad_states,
              {.rows = Rows::task,
               .values = Values::count,
               .writer = kWriter,
               .about = "episodes that ended in a `bad_state` since the batch was made"}),
        array("action_changed", &C::action_changed,
              {.rows = Rows::task,
               .values = Values::flag,
               .access = Access::internal,
               .writer = kWriter,
               .about = "the action differs from that of the previous step; also set at an episode's first action"}));
  }
};

}  // namespace flockstep
