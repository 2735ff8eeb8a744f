#include "base/require.hpp"
#include "flockstep/navigation.hpp"

namespace flockstep {

void NavigationReward::validate() const {
  require_finite(distance_weight, "reward.distance_weight");
  require_finite(crash_weight, "reward.crash_weight");
  require_finite(free_space_weight, "reward.free_space_weight");
  require_finite(step_weight, "reward.step_weight");
  require_finite(action_change_weight, "reward.action_change_weight");
  require_finite(overshoot_weight, "reward.overshoot_weight");
  require_finite(goal_reward, "reward.goal_reward");
  require_finite(waypoint_share, "reward.waypoint_share");
  require_positive(goal_radius_m, "reward.goal_radius_m");
  require(min_clearance > 0.0F && min_clearance < 1.0F, "reward.min_clearance", "a number in (0, 1)", min_clearance);
  require_positive(step_scale, "reward.step_scale");
}

void NavigationConfig::validate() const {
  require_positive(step_m, "task.step_m");
  require(yaw_step_deg > 0.0F && yaw_step_deg <= 180.0F, "task.yaw_step_deg", "a number in (0, 180]", yaw_step_deg);
  reward.validate();
  color.validate();
  require(color == ColorRange() || observation == ObservationKind::blob, "task.color",
          "the default where the observation is not \"blob\"", "another");
}

NavigationConfig NavigationConfig::observing(ObservationKind observation) {
  NavigationConfig config;
  config.observation = observation;
  if (observation != ObservationKind::goal) {
    config.action = ActionKind::discrete_forward;
    config.reward.overshoot_weight = 1.0F;
  }
  return config;
}

}  // namespace flockstep
