// EpisodeConfig and ClockConfig: begin and end of episodes, and the rates of simulated time. They are the same for every task.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Time at which a finished env is reset; EpisodeConfig describes the modes.
enum class AutoresetMode : std::uint8_t { next_step, same_step, disabled };
template <>
struct EnumNames<AutoresetMode> {
  static constexpr std::array kNames{"next_step", "same_step", "disabled"};
};

// How the episodes of the drones of an env belong together; EpisodeConfig describes the modes.
enum class Episodes : std::uint8_t { team, each, last };
template <>
struct EnumNames<Episodes> {
  static constexpr std::array kNames{"team", "each", "last"};
};

// Reason for the end of an episode. If several reasons hold in one step, the first in this order counts: `bad_state`, `success`,
// `contact`, `left_area`, `time`, `task`, `teammate`. engine/src/batch/episodes.cpp decides it for all tasks.
enum class EpisodeEnd : std::uint8_t {
  none,       // the episode goes on
  success,    // success according to the task
  contact,    // terminated while a drone was in contact
  left_area,  // ended because a drone left the task's area; see Score::left_area
  bad_state,  // a value was not finite; see Outputs::bad_state
  time,       // time limit
  task,       // terminated or truncated by the task for another reason
  teammate,   // the episode of another drone of the env ended
};
template <>
struct EnumNames<EpisodeEnd> {
  static constexpr std::array kNames{"none", "success", "contact", "left_area", "bad_state", "time", "task", "teammate"};
};

struct EpisodeConfig {
  static constexpr const char* kAbout = "Begin and end of episodes, the same for every task.";

  AutoresetMode autoreset_mode = AutoresetMode::next_step;
  Episodes episodes = Episodes::team;
  std::optional<int> max_episode_steps;
  int frame_skip = 1;
  bool stagger_first_episode = false;
  bool random_world = false;

  static constexpr auto fields() {
    using C = EpisodeConfig;
    return field_list(
        field("autoreset_mode", &C::autoreset_mode,
              {.about = "When the next episode begins, as `gymnasium.vector.AutoresetMode`. ``\"next_step\"``: in the next step, "
                        "which ignores the action. ``\"same_step\"``: in the step that ends the episode. ``\"disabled\"``: when "
                        "the caller resets with a mask."}),
        field("episodes", &C::episodes,
              {.about = "Episodes of an env's drones, if each is an agent. ``\"team\"``: all begin and end together. "
                        "``\"each\"``: each begins and ends by itself. ``\"last\"``: all begin together, and a drone that ends "
                        "is inactive until all have ended."}),
        field("max_episode_steps", &C::max_episode_steps,
              {.about = "Time limit in control steps, after which episodes are truncated. 0: no limit. None: the task's.",
               .limits = at_least(0)}),
        field("frame_skip", &C::frame_skip,
              {.about = "`Batch.step` repeats its action this many times, or until the episode ends, and sums the reward. "
                        "Cameras capture only after the last one.",
               .limits = between(1, 1000)}),
        field("stagger_first_episode", &C::stagger_first_episode,
              {.about = "Spread the first time limits over [1, max_episode_steps], by seed, so that not all first episodes end "
                        "at once."}),
        field("random_world", &C::random_world,
              {.about = "Each reset draws one of the batch's worlds instead of keeping the env's own."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Rates in steps per second of simulated time. A tick is one step of the motion. A control step, for which the policy decides
// once, is a whole number of ticks. A sensor with a rate reads once every fixed number of ticks.
struct ClockConfig {
  static constexpr const char* kAbout = "Rates of policy, controller and physics, per second of simulated time.";

  float policy_hz = 10.0F;
  std::optional<float> physics_hz;
  std::optional<float> controller_hz;

  static constexpr auto fields() {
    using C = ClockConfig;
    return field_list(
        field(
            "policy_hz", &C::policy_hz,
            {.about = "Control steps, and decisions of the policy, per second.", .unit = "Hz", .limits = between(0.001, 100000)}),
        field("physics_hz", &C::physics_hz,
              {.about = "Ticks per second, 1 to 1000 per control step. Simulated rotors need at least 50 Hz. None: one per "
                        "control step, for simulated rotors as many as give 500 Hz or more.",
               .unit = "Hz",
               .limits = above(0)}),
        field("controller_hz", &C::controller_hz,
              {.about = "Calls of the rotors' controller per second: a multiple of ``policy_hz`` that divides ``physics_hz``. "
                        "None: one per tick.",
               .unit = "Hz",
               .limits = above(0)}));
  }

  FLOCKSTEP_API void validate() const;
  double ticks_hz() const {
    return static_cast<double>(physics_hz.value_or(policy_hz));
  }  // Hz; without physics_hz one tick per control step
  double dt_s() const { return 1.0 / ticks_hz(); }                           // s per tick
  double step_s() const { return 1.0 / static_cast<double>(policy_hz); }     // s per control step
  int substeps() const { return ticks_in(static_cast<double>(policy_hz)); }  // ticks per control step
  int control_ticks() const {                                                // ticks between calls of the controller
    return controller_hz ? ticks_in(static_cast<double>(*controller_hz)) : 1;
  }

 private:
  int ticks_in(double hz) const { return static_cast<int>(ticks_hz() / hz + 0.5); }
};

}  // namespace flockstep
