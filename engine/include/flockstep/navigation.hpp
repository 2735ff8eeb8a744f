// The navigation task: fly from the start over the waypoints to the goal, by LiDAR and what `observation` adds to it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/color.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"

namespace flockstep {

// What actions mean.
enum class ActionKind : std::uint8_t {
  discrete,          // 0..5: +x, -x, +y, -y, +z, -z by step_m in the body frame
  displacement,      // (3,) in [-1, 1]: times step_m, body frame
  displacement_yaw,  // (4,): the same and a yaw turn of up to yaw_step_deg, counter-clockwise positive
  discrete_forward,  // 0..2: +x, +y, -y by step_m in the body frame
};
template <>
struct EnumNames<ActionKind> {
  static constexpr std::array kNames{"discrete", "displacement", "displacement_yaw", "discrete_forward"};
};

// What is observed. The camera is the batch's first; it needs rgb, and a capture mode other than on_demand.
enum class ObservationKind : std::uint8_t {
  goal,    // unit direction to the current goal in the body frame (3), then the normalised ranges
  blob,    // offset and area of a colour in the camera's image (2), then the normalised ranges; see task/color_blob.hpp
  pixels,  // two fields: the camera's image, whose layout is chw, and the normalised ranges
};
template <>
struct EnumNames<ObservationKind> {
  static constexpr std::array kNames{"goal", "blob", "pixels"};
};

// The reward: the sum of these terms, each times its weight.
// Source: the LiDAR and camera experiments of the thesis "Drone Simulation Using Unreal Engine", chapter 6.
// l are the LiDAR ranges over max_range_m, |L| their number, M = min_clearance, R = goal_reward.
struct NavigationReward {
  float distance_weight = 1.0F;  // R at the goal; R * waypoint_share / #waypoints at a waypoint; else cm gained towards the goal
  float crash_weight = 1.0F;     // -R on a collision; else min(l) - M where min(l) < M; else 0
  float free_space_weight = 1.0F;     // sum(l / M - 1) / (|L| / M - |L|): 1 in the open
  float step_weight = 1.0F;           // -(step number) / step_scale, the first step being number 0
  float action_change_weight = 1.0F;  // -1 if the action differs from the last one; the first action counts as a change
  float overshoot_weight = 0.0F;      // -R / 10 when x exceeds the current goal's x + goal_radius_m; non-zero also ends the
                                      // episode there

  float goal_reward = 10000.0F;      // R
  float waypoint_share = 0.1F;       // of R, split among the waypoints
  float goal_radius_m = 0.5F;        // T, > 0: goal and waypoints count as reached within it
  float min_clearance = 0.2F;        // M, in (0, 1), in units of max_range_m
  float step_scale = 3000.0F;        // > 0
  bool carry_over_distance = false;  // keep the last distance when the goal changes, as the thesis's program did

  static constexpr auto fields() {
    using C = NavigationReward;
    return field_list(field("distance_weight", &C::distance_weight), field("crash_weight", &C::crash_weight),
                      field("free_space_weight", &C::free_space_weight), field("step_weight", &C::step_weight),
                      field("action_change_weight", &C::action_change_weight), field("overshoot_weight", &C::overshoot_weight),
                      field("goal_reward", &C::goal_reward), field("waypoint_share", &C::waypoint_share),
                      field("goal_radius_m", &C::goal_radius_m), field("min_clearance", &C::min_clearance),
                      field("step_scale", &C::step_scale), field("carry_over_distance", &C::carry_over_distance));
  }

  void validate() const;
};

struct NavigationConfig {
  ActionKind action = ActionKind::discrete;
  ObservationKind observation = ObservationKind::goal;
  float step_m = 0.1F;         // > 0
  float yaw_step_deg = 10.0F;  // in (0, 180]
  NavigationReward reward;
  bool random_start = false;  // start uniformly in the world's spawn box instead of at its start marker
  ColorRange color;           // which colour the blob has; by default the goal's green

  static constexpr auto fields() {
    using C = NavigationConfig;
    return field_list(field("action", &C::action), field("observation", &C::observation), field("step_m", &C::step_m),
                      field("yaw_step_deg", &C::yaw_step_deg), field("reward", &C::reward),
                      field("random_start", &C::random_start), field("color", &C::color));
  }

  // The task of the thesis that observes this: camera tasks fly ahead and to the sides alone, and end where they overshoot.
  static NavigationConfig observing(ObservationKind observation);

  void validate() const;
};

// Throws std::invalid_argument on a bad config.
std::unique_ptr<Task> make_navigation(const NavigationConfig& config);

}  // namespace flockstep
