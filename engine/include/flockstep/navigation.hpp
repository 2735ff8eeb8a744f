// The navigation task: fly from the start over the waypoints to the goal, by LiDAR and what `observation` adds to it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/color.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

// Meaning of actions.
enum class ActionKind : std::uint8_t { discrete, displacement, displacement_yaw, discrete_forward };
template <>
struct EnumNames<ActionKind> {
  static constexpr std::array kNames{"discrete", "displacement", "displacement_yaw", "discrete_forward"};
};

// Observations beside the ranges. The camera is the batch's first; it needs rgb, and a capture mode other than on_demand.
enum class ObservationKind : std::uint8_t { goal, blob, pixels };
template <>
struct EnumNames<ObservationKind> {
  static constexpr std::array kNames{"goal", "blob", "pixels"};
};

// The reward: the sum of these terms, each times its weight.
// Source: the LiDAR and camera experiments of the thesis "Drone Simulation Using Unreal Engine", chapter 6.
// l are the LiDAR ranges over max_range_m, |L| their number, M = min_clearance, R = goal_reward.
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
        field(
            "distance_weight", &C::distance_weight,
            {.about = "Weight of R at the final goal; R * ``waypoint_share`` / number of waypoints at a waypoint; otherwise the "
                      "centimetres gained towards the current goal."}),
        field("crash_weight", &C::crash_weight,
              {.about = "Weight of -R on a collision; otherwise min(l) - M if min(l) < M, else 0."}),
        field("free_space_weight", &C::free_space_weight,
              {.about = "Weight of sum(l / M - 1) / (|L| / M - |L|), which is 1 in the open."}),
        field("step_weight", &C::step_weight,
              {.about = "Weight of -(step number) / ``step_scale``; the first step has number 0."}),
        field("action_change_weight", &C::action_change_weight,
              {.about = "Weight of -1 if the action differs from the last one; the first action counts as a change."}),
        field("overshoot_weight", &C::overshoot_weight,
              {.about =
                   "Weight of -R / 10 when x exceeds the current goal's x + ``goal_radius_m``; if it is not 0, the episode ends "
                   "there."}),
        field("goal_reward", &C::goal_reward, {.about = "R."}),
        field("waypoint_share", &C::waypoint_share, {.about = "Share of R that is split among the waypoints."}),
        field("goal_radius_m", &C::goal_radius_m,
              {.about = "Distance within which the goal and the waypoints count as reached.", .unit = "m", .limits = above(0)}),
        field("min_clearance", &C::min_clearance,
              {.about = "M, in units of the LiDAR's maximum range.", .limits = between_excluding(0, 1)}),
        field("step_scale", &C::step_scale, {.about = "Steps in which the step term reaches -1.", .limits = above(0)}),
        field("carry_over_distance", &C::carry_over_distance,
              {.about = "Keep the last distance when the current goal changes, as the thesis's program did."}));
  }

  FLOCKSTEP_API void validate() const;
};

struct NavigationConfig {
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
              {.about =
                   "What stands before the LiDAR ranges over the maximum range, 1 on a miss. ``\"goal\"``: the unit direction "
                   "(3,) to the current goal in the body frame, as the pose sensor has it. ``\"blob\"``: ``offset`` and ``area`` "
                   "of the `color_blob` of ``color`` in the first camera's image. ``\"pixels\"``: nothing; the image of the "
                   "first camera, whose layout is ``\"chw\"``, is a separate field."}),
        field("step_m", &C::step_m, {.about = "Distance of a full action.", .unit = "m", .limits = above(0)}),
        field("yaw_step_deg", &C::yaw_step_deg,
              {.about = "Angle of a full turn action.", .unit = "deg", .limits = above_up_to(0, 180)}),
        field("reward", &C::reward, {.about = "The terms of the reward."}),
        field("random_start", &C::random_start,
              {.about = "Start anywhere in the world's spawn box instead of at its start marker."}),
        field("color", &C::color,
              {.about = "Colour that ``observation=\"blob\"`` looks for; by default the green of the goal. Refused with another "
                        "observation."}));
  }

  // The task of the thesis that observes this: camera tasks fly ahead and to the sides alone, and end where they overshoot.
  FLOCKSTEP_API static NavigationConfig observing(ObservationKind observation);

  FLOCKSTEP_API void validate() const;
};

// Throws std::invalid_argument on a bad config.
FLOCKSTEP_API std::unique_ptr<Task> make_navigation(const NavigationConfig& config);

}  // namespace flockstep
