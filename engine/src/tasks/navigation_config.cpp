#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/navigation.hpp"

namespace flockstep {

void NavigationReward::validate() const { check_fields(*this, "reward."); }

void NavigationConfig::validate() const {
  check_fields(*this, "task.");
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
