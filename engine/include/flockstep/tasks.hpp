// Tasks of the engine: their configurations, and TaskConfig, the list of them.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <variant>

#include "flockstep/color.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/formation.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

// -- Navigation: fly from the start via the waypoints to the goal, with LiDAR ranges and the chosen `observation`

// Meaning of actions.
enum class ActionKind : std::uint8_t { discrete, displacement, displacement_yaw, discrete_forward };
template <>
struct EnumNames<ActionKind> {
  static constexpr std::array kNames{"discrete", "displacement", "displacement_yaw", "discrete_forward"};
};

// Observations in addition to the LiDAR ranges. blob and pixels use the batch's first camera, which needs the output rgb and a
// capture mode other than on_demand.
enum class ObservationKind : std::uint8_t { goal, blob, pixels };
template <>
struct EnumNames<ObservationKind> {
  static constexpr std::array kNames{"goal", "blob", "pixels"};
};

// The reward is the sum of these terms, each multiplied by its weight.
// Source: the LiDAR and camera experiments of the thesis "Drone Simulation Using Unreal Engine", chapter 6.
// l are the LiDAR ranges over max_range_m, |L| is their number, M = min_clearance, R = goal_reward.
struct NavigationReward {
  float distance_weight = 1.0F;
  float crash_weight = 1.0F;
  float free_space_weight = 1.0F;
  float step_weight = 1.0F;
  float action_change_weight = 1.0F;
  float overshoot_weight = 0.0F;
  float goal_reward = 10000.0F;
  float waypoint_share = 0.1F;
  float goal_radius_m = 0.5F;
  float min_clearance = 0.2F;
  float step_scale = 3000.0F;
  bool carry_over_distance = false;

  static constexpr auto fields() {
    using C = NavigationReward;
    return field_list(
        field("distance_weight", &C::distance_weight,
              {.about = "Weight of the distance term: R at the final goal, R * ``waypoint_share`` / number of waypoints at a "
                        "waypoint, otherwise the centimetres gained towards the current goal."}),
        field("crash_weight", &C::crash_weight,
              {.about = "Weight of the crash term: -R on a collision, otherwise min(l) - M if min(l) < M, otherwise 0."}),
        field("free_space_weight", &C::free_space_weight,
              {.about = "Weight of sum(l / M - 1) / (|L| / M - |L|), which is 1 in the open."}),
        field("step_weight", &C::step_weight,
              {.about = "Weight of -(step number) / ``step_scale``; the first step has number 0."}),
        field("action_change_weight", &C::action_change_weight,
              {.about = "Weight of -1 if the action differs from the last one; the first action counts as a change."}),
        field("overshoot_weight", &C::overshoot_weight,
              {.about = "Weight of -R / 10 when x exceeds the current goal's x + ``goal_radius_m``; if the weight is not 0, the "
                        "episode ends there."}),
        field("goal_reward", &C::goal_reward, {.about = "R."}),
        field("waypoint_share", &C::waypoint_share, {.about = "Share of R that is split among the waypoints."}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which the goal and the waypoints count as reached.", .unit = "m", .limits = above(0)}),
        field("min_clearance", &C::min_clearance,
              {.about = "M, in units of the LiDAR's maximum range.", .limits = between_excluding(0, 1)}),
        field("step_scale", &C::step_scale, {.about = "Step number at which the step term reaches -1.", .limits = above(0)}),
        field("carry_over_distance", &C::carry_over_distance,
              {.about = "Keep the last distance when the current goal changes, as the thesis's program did."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Fly from the start via the waypoints to the goal, with a LiDAR and optionally a camera.
struct NavigationConfig {
  static constexpr const char* kName = "navigation";
  static constexpr const char* kAbout = "Fly from the start via the waypoints to the goal.";

  ActionKind action = ActionKind::discrete;
  ObservationKind observation = ObservationKind::goal;
  float step_m = 0.1F;
  float yaw_step_deg = 10.0F;
  NavigationReward reward;
  bool random_start = false;
  ColorRange color;

  static constexpr auto fields() {
    using C = NavigationConfig;
    return field_list(
        field("action", &C::action,
              {.about =
                   "``\"discrete\"``: 0 to 5 for +x, -x, +y, -y, +z, -z by ``step_m`` in the body frame. ``\"displacement\"``: "
                   "(3,), clipped to [-1, 1], times ``step_m``, body frame. ``\"displacement_yaw\"``: (4,), the same and a turn "
                   "of up to ``yaw_step_deg``, counter-clockwise positive. ``\"discrete_forward\"``: 0 to 2 for +x, +y, -y by "
                   "``step_m``."}),
        field("observation", &C::observation,
              {.about = "Values before the LiDAR ranges, which are divided by the maximum range and 1 on a miss. ``\"goal\"``: "
                        "the unit direction "
                        "(3,) to the current goal in the body frame, as measured by the pose sensor. ``\"blob\"``: ``offset`` "
                        "and ``area`` "
                        "of the `color_blob` of ``color`` in the first camera's image. ``\"pixels\"``: nothing; the image of the "
                        "first camera, whose layout is ``\"chw\"``, is a separate field."}),
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("yaw_step_deg", &C::yaw_step_deg,
              {.about = "Angle of a full turn action.", .unit = "deg", .limits = above_up_to(0, 180)}),
        field("reward", &C::reward, {.about = "The terms of the reward."}),
        field("random_start", &C::random_start,
              {.about = "Start anywhere in the world's spawn box instead of at its start marker."}),
        field("color", &C::color,
              {.about = "Colour that ``observation=\"blob\"`` looks for; by default the green of the goal. Not allowed with "
                        "another observation."}));
  }

  // Returns the thesis's task with this observation. Camera tasks use `discrete_forward` and end when x passes the goal.
  FLOCKSTEP_API static NavigationConfig observing(ObservationKind observation);

  FLOCKSTEP_API void validate() const;
};

// Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const NavigationConfig& config);

// -- Hover: a thrown drone has to recover and stay at a point

// The point to hold is the world's goal marker, or the centre of its bounds if it has none. Episodes begin near it, with random
// attitude and velocity. Actions are four numbers in [-1, 1] whose meaning depends on the `control` of the dynamics: 0 hovers
// or has no effect, 1 is the largest command; see FlightAction.
//
// Observation, float32 (16,), in the body frame and independent of the heading: offset to the point, m (3); velocity, m/s (3);
// the world's up vector (3); angular velocity, in units of 10 rad/s (3); rotor speeds, -1 slowest, 0 hovering, 1 fastest (4).
//
// d is the distance to the point, m. An episode ends as a crash if the drone touches something or d > max_distance_m. An
// episode without a crash is a success if d <= hold_m during its last hold_s.
struct HoverConfig {
  static constexpr const char* kName = "hover";
  static constexpr const char* kAbout = "Recover a thrown drone and hold it at a point.";

  float start_offset_m = 0.5F;
  float start_tilt_deg = 90.0F;
  float start_speed_mps = 2.0F;
  float start_rate_dps = 0.0F;
  float max_distance_m = 6.0F;
  float hold_m = 0.05F;
  float hold_s = 1.0F;
  float near_weight = 1.0F;
  float hold_weight = 2.0F;
  float speed_weight = 0.1F;
  float spin_weight = 0.1F;
  float change_weight = 0.0F;
  float crash_weight = 10.0F;

  static constexpr auto fields() {
    using C = HoverConfig;
    return field_list(
        field("start_offset_m", &C::start_offset_m,
              {.about = "Maximum offset of the start from the point along each axis. The offset, tilt, speed and rate at the "
                        "start are drawn uniformly up to their maxima.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("start_tilt_deg", &C::start_tilt_deg,
              {.about = "Maximum tilt at the start.", .unit = "deg", .limits = between(0, 180)}),
        field("start_speed_mps", &C::start_speed_mps,
              {.about = "Maximum speed at the start, in any direction.", .unit = "m/s", .limits = between(0, 1000)}),
        field(
            "start_rate_dps", &C::start_rate_dps,
            {.about = "Maximum rate at the start, about each axis of the body.", .unit = "deg/s", .limits = between(0, 100000)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the point beyond which an episode ends as a crash.", .unit = "m", .limits = above(0)}),
        field("hold_m", &C::hold_m, {.about = "Distance within which the point is held.", .unit = "m", .limits = above(0)}),
        field("hold_s", &C::hold_s,
              {.about = "Time at the end of an episode during which the drone has to hold the point.",
               .unit = "s",
               .limits = above_up_to(0, 1000000)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("hold_weight", &C::hold_weight, {.about = "Weight of the reward term 1 / (1 + (d / (2 hold_m))^2)."}),
        field("speed_weight", &C::speed_weight, {.about = "Weight of the penalty on the speed, in m/s."}),
        field("spin_weight", &C::spin_weight,
              {.about = "Weight of the penalty on the magnitude of the angular velocity, in units of 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the hover task. Defaults: "arena/hall", a crazyflie, rotor thrusts at 50 Hz, episodes of 6 s. Throws
// std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const HoverConfig& config);

// -- Track: a drone follows a point that moves along a smooth path

// Shape of the path.
enum class TrackPath : std::uint8_t { figure8, random };
template <>
struct EnumNames<TrackPath> {
  static constexpr std::array kNames{"figure8", "random"};
};

// Heading that a drone should have on the path.
enum class TrackYaw : std::uint8_t { fixed, along };
template <>
struct EnumNames<TrackYaw> {
  static constexpr std::array kNames{"fixed", "along"};
};

// Paths are centred on the world's goal marker, or on the centre of its bounds if it has none. Each episode begins at a random
// place of its path, with the path's velocity and yaw. Actions are those of the hover task.
//
// Observation, float32 (15 + 3 points,), in the body frame: offsets to the current point of the path, the point ahead_s later,
// and so on, m (3 points); velocity, m/s (3); the world's up vector (3); angular velocity, in units of 10 rad/s (3); rotor
// speeds as in the hover task (4); sine and cosine of the yaw error (2).
//
// d is the distance to the current point of the path, m. An episode ends as a crash if the drone touches something or d >
// max_distance_m. An episode without a crash is a success if the root mean square of d over all its steps is at most close_m.
struct TrackConfig {
  static constexpr const char* kName = "track";
  static constexpr const char* kAbout = "Follow a point that moves along a smooth path.";

  TrackPath path = TrackPath::figure8;
  TrackYaw yaw = TrackYaw::fixed;
  float size_m = 1.0F;
  float speed_mps = 1.5F;
  float start_offset_m = 0.1F;
  int points = 5;
  float ahead_s = 0.1F;
  float max_distance_m = 1.0F;
  float close_m = 0.05F;
  float near_weight = 1.0F;
  float close_weight = 1.0F;
  float yaw_weight = 0.2F;
  float spin_weight = 0.02F;
  float change_weight = 0.0F;
  float crash_weight = 10.0F;

  static constexpr auto fields() {
    using C = TrackConfig;
    return field_list(
        field("path", &C::path,
              {.about = "``\"figure8\"``: level, x = s cos(w t), y = s / 2 sin(2 w t) with s = ``size_m``. ``\"random\"``: along "
                        "each axis, the sum of three waves with random phases. The path stays within ``size_m`` of the centre "
                        "along x and y, and within half of that along z."}),
        field("yaw", &C::yaw, {.about = "``\"fixed\"``: along the world's x axis. ``\"along\"``: the direction of the path."}),
        field("size_m", &C::size_m, {.about = "Size of the path.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("speed_mps", &C::speed_mps,
              {.about = "Speed of the path: for a figure-8, the mean of a lap; for random paths, the root mean square.",
               .unit = "m/s",
               .limits = above_up_to(0, 1000)}),
        field("start_offset_m", &C::start_offset_m,
              {.about = "Maximum offset of the start from the path along each axis, drawn uniformly up to this.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("points", &C::points, {.about = "Number of points of the path that are observed.", .limits = between(1, 20)}),
        field("ahead_s", &C::ahead_s, {.about = "Time from one observed point to the next.", .unit = "s", .limits = at_least(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the path beyond which an episode ends as a crash.", .unit = "m", .limits = above(0)}),
        field("close_m", &C::close_m,
              {.about = "Maximum root mean square of d of a successful episode.", .unit = "m", .limits = above(0)}),
        field("near_weight", &C::near_weight, {.about = "Weight of the reward term exp(-2 d)."}),
        field("close_weight", &C::close_weight, {.about = "Weight of the reward term 1 / (1 + (d / close_m)^2)."}),
        field("yaw_weight", &C::yaw_weight, {.about = "Weight of the penalty on the yaw error, in rad."}),
        field("spin_weight", &C::spin_weight,
              {.about = "Weight of the penalty on the magnitude of the angular velocity, in units of 10 rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the track task. Defaults: "arena/hall", a crazyflie, body rates at 100 Hz, episodes of 10 s. Throws
// std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const TrackConfig& config);

// -- Race: a drone flies through the gates of its world, in their order

// Place of the start: anywhere on the way from one gate to the next, or at a gate, at rest.
enum class RaceStart : std::uint8_t { between, gate };
template <>
struct EnumNames<RaceStart> {
  static constexpr std::array kNames{"between", "gate"};
};

// Episodes begin behind a random gate of the world, and the next gate is the first to pass. Control is body_rates. Actions are
// four numbers in [-1, 1]: thrust from the least of the rotors over hovering to max_thrust_to_weight, and body rates up to
// max_rate_dps and max_yaw_rate_dps of the dynamics. 0 hovers.
//
// Observation, float32 (13 + 6 gates_ahead,), in the body frame: for each of the next gates the offset to its centre, times
// observation_scale (3), and the direction in which it is passed (3); velocity in m/s (3), times observation_scale; the world's
// up vector (3); angular velocity in rad/s (3), times observation_scale; the last action (4).
//
// A gate is passed, or missed, where the drone's path through the ticks of a step crosses the gate's plane forwards. An episode
// ends as a crash if the drone touches something, misses a gate, or leaves the area: the next gate is farther than
// max_distance_m. It ends as a success after the last gate of the last lap.
//
// v, the cap on the rewarded speed, rises in each env by cap_rise_mps after an episode if enough of the env's last cap_episodes
// episodes were clean. An episode is clean if it succeeds, or reaches its time limit after a whole lap.
struct RaceConfig {
  static constexpr const char* kName = "race";
  static constexpr const char* kAbout = "Fly through the gates of a track, lap after lap.";

  int laps = 3;
  int gates_ahead = 2;
  float max_thrust_to_weight = 4.0F;
  RaceStart start = RaceStart::between;
  float start_offset_m = 0.5F;
  float start_yaw_deg = 30.0F;
  float start_tilt_deg = 17.0F;
  float start_speed_mps = 0.5F;
  float miss_m = 3.0F;
  float max_distance_m = 30.0F;
  float observation_scale = 0.2F;
  std::array<float, 2> speed_cap_mps{8.0F, 16.0F};
  float cap_rise_mps = 1.0F;
  int cap_episodes = 4;
  float cap_success = 1.0F;
  float progress_weight = 0.3F;
  float gate_weight = 0.6F;
  float rates_weight = 0.003F;
  float change_weight = 0.024F;
  float crash_weight = 1.5F;

  static constexpr auto fields() {
    using C = RaceConfig;
    return field_list(
        field("laps", &C::laps, {.about = "Laps of a successful episode.", .limits = between(1, 1000)}),
        field("gates_ahead", &C::gates_ahead, {.about = "Number of gates that are observed.", .limits = between(1, 8)}),
        field("max_thrust_to_weight", &C::max_thrust_to_weight,
              {.about = "Largest commanded thrust over the weight, if the rotors can deliver it.", .limits = between(1.1, 100)}),
        field("start", &C::start,
              {.about = "``\"gate\"``: behind a gate, at rest. ``\"between\"``: half of the drones behind a gate, the others "
                        "anywhere in the first nine tenths of the way to the next gate."}),
        field("start_offset_m", &C::start_offset_m,
              {.about = "Maximum offset of the start along each axis. All spreads are drawn uniformly up to their maxima, and "
                        "drawn again if the drone would touch something.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("start_yaw_deg", &C::start_yaw_deg,
              {.about = "Maximum angle between the heading and the way to fly.", .unit = "deg", .limits = between(0, 180)}),
        field("start_tilt_deg", &C::start_tilt_deg,
              {.about = "Maximum roll and pitch at the start.", .unit = "deg", .limits = between(0, 90)}),
        field("start_speed_mps", &C::start_speed_mps,
              {.about = "Maximum speed along each axis of a start between gates.", .unit = "m/s", .limits = between(0, 1000)}),
        field(
            "miss_m", &C::miss_m,
            {.about = "A drone misses a gate if it crosses its plane outside the opening but within this distance of its centre.",
             .unit = "m",
             .limits = at_least(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from the next gate beyond which an episode ends as a crash.", .unit = "m", .limits = above(0)}),
        field("observation_scale", &C::observation_scale,
              {.about = "Factor of observed offsets, velocities and angular velocities.", .limits = above_up_to(0, 1000)}),
        field("speed_cap_mps", &C::speed_cap_mps,
              {.about = "First and last cap on the speed that the progress term rewards.",
               .unit = "m/s",
               .limits = above_up_to(0, 1000)}),
        field("cap_rise_mps", &C::cap_rise_mps,
              {.about = "Rise of the cap after an episode, until it has reached its last value.",
               .unit = "m/s",
               .limits = at_least(0)}),
        field("cap_episodes", &C::cap_episodes,
              {.about = "Number of last episodes of an env that decide whether its cap rises.", .limits = between(1, 8)}),
        field("cap_success", &C::cap_success,
              {.about = "Share of clean episodes among these at which the cap rises.", .limits = between(0, 1)}),
        field("progress_weight", &C::progress_weight,
              {.about =
                   "Weight of the distance gained towards the centre of the next gate, in m, at most v times the step's time."}),
        field("gate_weight", &C::gate_weight, {.about = "Reward for each gate that is passed."}),
        field("rates_weight", &C::rates_weight, {.about = "Weight of the penalty on the angular velocity, in rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the race task. Defaults: "race/figure-8", a racer5, body rates at 50 Hz, episodes of 7 s. Throws std::invalid_argument
// on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const RaceConfig& config);

// -- Dodge: fly to a goal by LiDAR, among bodies that move

// An episode begins at a random free place, and a random free place is its goal, both at the height of the world's start marker.
// The drone moves in the plane: actions are two numbers, clipped to [-1, 1], the displacement along the body's x and y in units
// of step_m. It should have a planar LiDAR.
//
// Observation, float32 (5 + 2 rays,): unit direction to the goal, x and y of the body frame (2); distance to the goal, in units
// of 10 m, at most 1; the last action (2); the LiDAR ranges over the maximum range, 1 on a miss; the ranges of the scan before,
// which show how things move, equal to the others at the start.
//
// Reward: the sum of the weighted terms. The episode ends at the goal, as a success, or at a contact.
struct DodgeConfig {
  static constexpr const char* kName = "dodge";
  static constexpr const char* kAbout = "Fly to a goal by LiDAR, among bodies that move.";

  float step_m = 0.15F;
  float goal_distance_m = 5.0F;
  float goal_radius_m = 0.5F;
  float near_m = 1.0F;
  float progress_weight = 1.0F;
  float goal_weight = 10.0F;
  float crash_weight = 10.0F;
  float near_weight = 0.1F;
  float time_weight = 0.02F;

  static constexpr auto fields() {
    using C = DodgeConfig;
    return field_list(
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("goal_distance_m", &C::goal_distance_m,
              {.about = "Minimum distance from the start to the goal. If no such place is found, the goal is the farthest free "
                        "place among those drawn.",
               .unit = "m",
               .limits = at_least(0)}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which the goal counts as reached.", .unit = "m", .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Range below which the near term grows, from 0 to 1 at range 0.", .unit = "m", .limits = above(0)}),
        field("progress_weight", &C::progress_weight, {.about = "Reward for each metre gained towards the goal."}),
        field("goal_weight", &C::goal_weight, {.about = "Reward for reaching the goal."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest range."}),
        field("time_weight", &C::time_weight, {.about = "Penalty for each step."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the dodge task. Defaults: the set of worlds "living", 72 beams all around with a range of 6 m, episodes of 400 steps.
// Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const DodgeConfig& config);

// -- Swap: drones exchange places without touching

// The drones of an env begin on a circle around the middle of the world's bounds, at the height of its start marker, facing their
// goals. The goal of drone m of M is the place of drone (m + M / 2) mod M; one drone flies to the opposite place. The drones move
// in the plane: actions are two numbers, clipped to [-1, 1], the displacement along the body's x and y in units of step_m.
//
// Observation, float32 (7 + 5 neighbors,), x and y of the body frame: unit direction to the goal (2); distance to the goal, in
// units of 10 m, at most 1; the last action (2); velocity over sqrt(2) step_m per step (2); for each of the nearest drones, the
// nearest first, its position in units of sight_m, shortened to 1 if it is farther (2), its velocity relative to the drone, over
// twice the unit above (2), and 1, or five times 0 if there are fewer.
//
// Reward: the sum of the weighted terms. The episode ends as a success for all when all drones are at their goals at once, and
// at a contact.
struct SwapConfig {
  static constexpr const char* kName = "swap";
  static constexpr const char* kAbout = "Exchange places with other drones without touching.";

  float step_m = 0.15F;
  float radius_m = 4.0F;
  float spacing_m = 1.3F;
  float jitter_m = 0.1F;
  float goal_radius_m = 0.3F;
  int neighbors = 6;
  float sight_m = 4.0F;
  float near_m = 1.5F;
  float progress_weight = 1.0F;
  float goal_weight = 10.0F;
  float crash_weight = 20.0F;
  float near_weight = 0.1F;
  float time_weight = 0.05F;

  static constexpr auto fields() {
    using C = SwapConfig;
    return field_list(
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("radius_m", &C::radius_m, {.about = "Minimum radius of the circle.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("spacing_m", &C::spacing_m,
              {.about = "Minimum distance between neighbouring places, along the circle; with many drones the circle grows.",
               .unit = "m",
               .limits = above_up_to(0, 1000)}),
        field("jitter_m", &C::jitter_m,
              {.about = "Maximum offset of a start from its place along x and y, drawn uniformly.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which a drone counts as at its goal.", .unit = "m", .limits = above(0)}),
        field("neighbors", &C::neighbors, {.about = "Number of neighbours that are observed.", .limits = between(1, 32)}),
        field("sight_m", &C::sight_m,
              {.about = "Unit of observed positions; only the direction of a farther neighbour is observed.",
               .unit = "m",
               .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Distance to the nearest drone, between the centres, below which the near term grows, from 0 to 1.",
               .unit = "m",
               .limits = above(0)}),
        field("progress_weight", &C::progress_weight, {.about = "Reward for each metre gained towards the goal."}),
        field("goal_weight", &C::goal_weight, {.about = "Reward of each drone when all are at their goals."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest drone."}),
        field("time_weight", &C::time_weight, {.about = "Penalty for each step after which the drone is not at its goal."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the swap task. Defaults: "arena/hall", 8 drones in an env that touch each other, episodes of 300 steps. Throws
// std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const SwapConfig& config);

// -- Formation: drones hold their places relative to a moving leader

// Way of the leader.
enum class FormationRoute : std::uint8_t { loop, path };
template <>
struct EnumNames<FormationRoute> {
  static constexpr std::array kNames{"loop", "path"};
};

// The leader is a point that flies along a smooth route at the beginning of which the episode begins. Drone m has place m of
// formation_places(), which turns with the leader's heading, and so do the drones. Actions are three numbers, clipped to [-1, 1],
// the displacement along the body's axes in units of step_m.
//
// Observation, float32 (12 + 7 neighbors + rays,), in the body frame: offset to the drone's place, in units of 2 m, shortened to
// 1 if it is farther (3); velocity of the place over sqrt(3) step_m per step (3); the last action (3); velocity, in the same unit
// (3); for each of the nearest drones, the nearest first, its position in units of sight_m, shortened to 1 if it is farther (3),
// its velocity relative to the drone, over twice the unit (3), and 1, or seven times 0 if there are fewer; the LiDAR ranges over
// the maximum range, 1 on a miss.
//
// Reward: the sum of the weighted terms. d is the distance to the place, m. The episode ends at a contact, if d exceeds
// max_distance_m, or when the leader has arrived at the end of a path. It is a success if it ends without a contact, and the mean
// of d over all steps is at most close_m.
struct FormationConfig {
  static constexpr const char* kName = "formation";
  static constexpr const char* kAbout = "Hold places relative to a moving leader.";

  FormationShape shape = FormationShape::v;
  float spacing_m = 1.5F;
  FormationRoute route = FormationRoute::loop;
  float loop_radius_m = 4.0F;
  float leader_speed_mps = 0.6F;
  float step_m = 0.15F;
  float jitter_m = 0.2F;
  int neighbors = 3;
  float sight_m = 4.0F;
  float max_distance_m = 3.0F;
  float close_m = 0.2F;
  float near_m = 0.8F;
  float place_weight = 0.2F;
  float crash_weight = 5.0F;
  float near_weight = 0.1F;
  float change_weight = 0.02F;

  static constexpr auto fields() {
    using C = FormationConfig;
    return field_list(
        field("shape", &C::shape,
              {.about = "Places of the drones. ``\"line\"``: abreast of the leader. ``\"column\"``: one behind the other on its "
                        "route. "
                        "``\"v\"``: behind the leader, on two lines at 45 degrees. ``\"circle\"``: around the leader."}),
        field("spacing_m", &C::spacing_m,
              {.about = "Distance between neighbouring places.", .unit = "m", .limits = above_up_to(0, 1000)}),
        field("route", &C::route,
              {.about = "``\"loop\"``: a random closed way around the middle of the world. ``\"path\"``: a planned path from the "
                        "start marker of the world over the waypoints to the goal; where the shape has no room, it narrows to a "
                        "column."}),
        field("loop_radius_m", &C::loop_radius_m,
              {.about = "Maximum distance of a loop's corners from the middle; the minimum is 0.6 times that.",
               .unit = "m",
               .limits = above_up_to(0, 1000)}),
        field("leader_speed_mps", &C::leader_speed_mps,
              {.about = "Speed of the leader on straight parts; it is lower in curves.",
               .unit = "m/s",
               .limits = between(0, 1000)}),
        field("step_m", &C::step_m, {.about = "Distance of a full action along an axis.", .unit = "m", .limits = above(0)}),
        field("jitter_m", &C::jitter_m,
              {.about = "Maximum offset of a start from its place along x and y, drawn uniformly; more if this is not free.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("neighbors", &C::neighbors, {.about = "Number of neighbours that are observed.", .limits = between(1, 32)}),
        field("sight_m", &C::sight_m,
              {.about = "Unit of observed positions; only the direction of a farther neighbour is observed.",
               .unit = "m",
               .limits = above(0)}),
        field("max_distance_m", &C::max_distance_m,
              {.about = "Distance from its place beyond which a drone has lost the formation.", .unit = "m", .limits = above(0)}),
        field("close_m", &C::close_m, {.about = "Maximum mean of d of a successful episode.", .unit = "m", .limits = above(0)}),
        field("near_m", &C::near_m,
              {.about = "Range below which the near term grows, from 0 to 1 at range 0.", .unit = "m", .limits = above(0)}),
        field("place_weight", &C::place_weight, {.about = "Weight of the reward term exp(-d)."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a contact, and for losing the formation."}),
        field("near_weight", &C::near_weight, {.about = "Weight of the penalty for the nearest range."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Makes the formation task. Defaults: "arena/hall", 4 drones in an env that see and touch each other, 36 beams all around with a
// range of 4 m, episodes of 300 steps. Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const FormationConfig& config);

// -- The list

// A task that another program registered under this id, for example in Python. The engine cannot make it.
struct RegisteredTask {
  std::string id;  // name of the task in that program
};

// Each configuration needs its own make_task. Without this deleted template, the make_task of TaskConfig in recipe.hpp would
// call itself for a configuration that has none.
template <class Config>
std::unique_ptr<Task> make_task(const Config& config) = delete;

// All tasks of the engine, plus std::monostate for none, and RegisteredTask. Recipes and the Python classes, keywords and
// environments are made from this list. A configuration has a name for recipes (kName), a sentence (kAbout), fields() and
// make_task().
using TaskConfig = std::variant<std::monostate, NavigationConfig, HoverConfig, TrackConfig, RaceConfig, DodgeConfig, SwapConfig,
                                FormationConfig, RegisteredTask>;

// True for the configuration of a task of the engine.
template <class Config>
inline constexpr bool kIsEngineTask = !std::is_same_v<Config, std::monostate> && !std::is_same_v<Config, RegisteredTask>;

// Calls visit(std::type_identity<Config>()) for each task of the engine, in the order of the list.
template <class Visit>
constexpr void for_each_task(const Visit& visit) {
  const auto visit_one = [&]<class Config>(std::type_identity<Config> type) {
    if constexpr (kIsEngineTask<Config>) visit(type);
  };
  [&]<class... Configs>(std::type_identity<std::variant<Configs...>>) {
    (visit_one(std::type_identity<Configs>()), ...);
  }(std::type_identity<TaskConfig>());
}

}  // namespace flockstep
