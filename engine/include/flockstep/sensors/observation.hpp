// ObservationConfig: what an agent remembers, and when it learns what its task observes.
#pragma once

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

struct ObservationConfig {
  int history = 1;
  int past_actions = 0;
  float delay_s = 0.0F;
  float jitter_s = 0.0F;
  bool age = false;

  static constexpr auto fields() {
    using C = ObservationConfig;
    return field_list(
        field("history", &C::history,
              {.about = "Number of observations, the newest first, joined along their first axis. The first observation of an "
                        "episode fills all places.",
               .limits = between(1, kMaxHistory)}),
        field("past_actions", &C::past_actions,
              {.about = "Number of past actions after them, the newest first, clipped to the bounds of actions. A discrete "
                        "action is one number for each choice, 1 for the one taken. Zeros before an episode's first "
                        "action.",
               .limits = between(0, kMaxHistory)}),
        field("delay_s", &C::delay_s,
              {.about = "Time after which an observation arrives, rounded up to steps of the env. The first one of an episode "
                        "arrives at once.",
               .unit = "s",
               .limits = between(0, kMaxDelay)}),
        field("jitter_s", &C::jitter_s,
              {.about = "Greatest further delay of an observation, drawn for each. The newest one that has arrived holds. An "
                        "overtaken observation is dropped.",
               .unit = "s",
               .limits = between(0, kMaxDelay)}),
        field("age", &C::age,
              {.about = "Add the age of the newest observation that has arrived, in seconds, as the last number."}));
  }

  static constexpr int kMaxHistory = 64;     // observations, and actions
  static constexpr double kMaxDelay = 10.0;  // s

  // True if observations are those of the task.
  bool is_off() const { return history == 1 && past_actions == 0 && delay_s == 0.0F && jitter_s == 0.0F && !age; }
  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
