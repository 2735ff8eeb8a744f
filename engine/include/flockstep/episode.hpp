// EpisodeConfig and ClockConfig: when episodes begin and end, and how time passes in them. The same for every task.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "flockstep/fields.hpp"

namespace flockstep {

// When an env whose episode ended is reset.
enum class AutoresetMode : std::uint8_t {
  next_step,  // the following step ignores the action and returns the reset observation, reward 0, flags false
  same_step,  // the ending step returns the reset observation; the last one of the episode is final_observation
  disabled,   // the caller resets with a mask; a finished env does not change until then
};
template <>
struct EnumNames<AutoresetMode> {
  static constexpr std::array kNames{"next_step", "same_step", "disabled"};
};

struct EpisodeConfig {
  AutoresetMode autoreset_mode = AutoresetMode::next_step;
  std::optional<int> max_episode_steps;  // truncation, in flown steps; 0: never; none: what the task says
  int frame_skip = 1;                    // in [1, 1000]: step() repeats its action this many times, or until the episode
                                         // ends, and returns the summed reward. All step counts are in flown steps. Cameras
                                         // capture only after the last one.
  bool stagger_first_episode = false;    // first time limits spread over [1, max_episode_steps], keyed by seed
  bool random_world = false;             // each reset draws a world at random instead of keeping the env's own

  static constexpr auto fields() {
    using C = EpisodeConfig;
    return field_list(field("autoreset_mode", &C::autoreset_mode), field("max_episode_steps", &C::max_episode_steps),
                      field("frame_skip", &C::frame_skip), field("stagger_first_episode", &C::stagger_first_episode),
                      field("random_world", &C::random_world));
  }

  void validate() const;
};

// A tick is one substep of the motion; a flown step is `substeps` of them. Sensors with a rate are due every so many ticks.
struct ClockConfig {
  float dt_s = 0.1F;  // of a tick, in [1e-5, 10]
  int substeps = 1;   // ticks in a flown step, in [1, 1000]

  static constexpr auto fields() {
    using C = ClockConfig;
    return field_list(field("dt_s", &C::dt_s), field("substeps", &C::substeps));
  }

  void validate() const;
  float step_s() const { return dt_s * static_cast<float>(substeps); }  // simulated time of a flown step
};

}  // namespace flockstep
