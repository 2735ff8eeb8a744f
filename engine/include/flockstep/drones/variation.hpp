// DroneParameters and Variation: what may differ from drone to drone, and how it is drawn.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "flockstep/airframe.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Differences of a drone from its airframe, and what acts on it. The controller and the meaning of actions do not know them: they
// keep the airframe's own numbers, and the gains are scaled. Body frame as in Airframe.
struct DroneParameters {
  float mass_scale = 1.0F;
  std::array<float, 3> stretch{1.0F, 1.0F, 1.0F};
  std::array<float, 3> center_m{};
  float arm_scale = 1.0F;
  float payload_kg = 0.0F;
  float payload_below_m = 0.0F;
  float thrust_scale = 1.0F;
  std::array<float, kMaxRotors> rotor_thrust_scale{1.0F, 1.0F, 1.0F, 1.0F, 1.0F, 1.0F, 1.0F, 1.0F};
  float torque_scale = 1.0F;
  float lag_up_scale = 1.0F;
  float lag_down_scale = 1.0F;
  float body_drag_scale = 1.0F;
  float rotor_drag_scale = 1.0F;
  float rate_gain_scale = 1.0F;
  float attitude_gain_scale = 1.0F;
  float velocity_gain_scale = 1.0F;
  float position_gain_scale = 1.0F;
  float battery_used = 0.0F;
  float battery_life_s = 1e6F;
  float battery_fall = 0.0F;
  float battery_sag = 0.0F;
  float dead_rotor = 0.0F;
  float dead_from_s = 1e6F;
  std::array<float, 3> wind_mps{};
  std::array<float, 3> push_mps2{};
  std::array<float, 3> twist_radps2{};
  float action_delay_s = 0.0F;
  float action_jitter_s = 0.0F;
  float action_loss = 0.0F;
  float airframe = 0.0F;

  static constexpr auto fields() {
    using C = DroneParameters;
    constexpr Limits kScale = between(0.05, 20);
    return field_list(
        field("mass_scale", &C::mass_scale, {.about = "Factor of mass and inertia.", .limits = kScale}),
        field("stretch", &C::stretch,
              {.about = "Factors of the mass's distances from the centre along x, y and z. The inertia follows.",
               .limits = kScale}),
        field("center_m", &C::center_m, {.about = "Shift of the centre of mass.", .unit = "m", .limits = within(10)}),
        field("arm_scale", &C::arm_scale,
              {.about = "Factor of the rotors' distances from the centre, at the same inertia.", .limits = kScale}),
        field("payload_kg", &C::payload_kg, {.about = "Mass of a carried point.", .unit = "kg", .limits = between(0, 1e4)}),
        field("payload_below_m", &C::payload_below_m,
              {.about = "Distance of that point below the centre of mass.", .unit = "m", .limits = between(0, 10)}),
        field("thrust_scale", &C::thrust_scale, {.about = "Factor of all rotors' thrust at a speed.", .limits = kScale}),
        field("rotor_thrust_scale", &C::rotor_thrust_scale,
              {.about = "A further factor for each rotor that the drone has.", .limits = between(0, 20)}),
        field("torque_scale", &C::torque_scale, {.about = "Factor of the ratio of torque to thrust.", .limits = kScale}),
        field("lag_up_scale", &C::lag_up_scale, {.about = "Factor of the rotors' lag at rising speed.", .limits = kScale}),
        field("lag_down_scale", &C::lag_down_scale, {.about = "Factor of the rotors' lag at falling speed.", .limits = kScale}),
        field("body_drag_scale", &C::body_drag_scale, {.about = "Factor of the body's drag.", .limits = between(0, 20)}),
        field("rotor_drag_scale", &C::rotor_drag_scale,
              {.about = "Factor of the rotors' drag and lift.", .limits = between(0, 20)}),
        field("rate_gain_scale", &C::rate_gain_scale, {.about = "Factor of the controller's rate gains.", .limits = kScale}),
        field("attitude_gain_scale", &C::attitude_gain_scale,
              {.about = "Factor of the gains of tilt and heading.", .limits = kScale}),
        field("velocity_gain_scale", &C::velocity_gain_scale,
              {.about = "Factor of the gains of velocity and integral.", .limits = kScale}),
        field("position_gain_scale", &C::position_gain_scale, {.about = "Factor of the position gain.", .limits = kScale}),
        field("battery_used", &C::battery_used,
              {.about = "Share of the charge used when an episode begins.", .limits = between(0, 1)}),
        field("battery_life_s", &C::battery_life_s,
              {.about = "Hovering time of a full battery.", .unit = "s", .limits = between(1, 1e6)}),
        field("battery_fall", &C::battery_fall,
              {.about = "Share of the rotors' speed lost with an empty battery, in proportion to the used charge.",
               .limits = between(0, 0.9)}),
        field(
            "battery_sag", &C::battery_sag,
            {.about = "Share of the rotors' speed lost at full power, by the battery's resistance.", .limits = between(0, 0.9)}),
        field("dead_rotor", &C::dead_rotor,
              {.about = "Number of the rotor that dies, rounded down.",
               .limits = Limits{.least = 0, .greatest = kMaxRotors, .excludes_greatest = true}}),
        field("dead_from_s", &C::dead_from_s,
              {.about = "Time in the episode from which that rotor is dead, rounded to control steps.",
               .unit = "s",
               .limits = between(0, 1e6)}),
        field("wind_mps", &C::wind_mps,
              {.about = "Wind added to that of `WindConfig`, world frame.", .unit = "m/s", .limits = within(1000)}),
        field("push_mps2", &C::push_mps2,
              {.about = "External force over the airframe's mass, world frame.", .unit = "m/s^2", .limits = within(1000)}),
        field("twist_radps2", &C::twist_radps2,
              {.about = "External torque over the inertia, body frame.", .unit = "rad/s^2", .limits = within(1e4)}),
        field("action_delay_s", &C::action_delay_s,
              {.about = "Delay of a command, rounded to ticks. The first command of an episode has none.",
               .unit = "s",
               .limits = between(0, kMaxDelay)}),
        field("action_jitter_s", &C::action_jitter_s,
              {.about = "Greatest further delay, drawn for each command. An overtaken command has no effect.",
               .unit = "s",
               .limits = between(0, kMaxDelay)}),
        field("action_loss", &C::action_loss,
              {.about = "Probability that a command is lost. The one before it holds.", .limits = between(0, 1)}),
        field("airframe", &C::airframe, {.about = "Number of the airframe in ``airframes``.", .limits = between(0, 1 << 20)}));
  }

  static constexpr double kMaxDelay = 1.0;  // s

  FLOCKSTEP_API void validate() const;
};

// Law of a drawn number.
enum class Law : std::uint8_t { uniform, log_uniform, normal, choice };
template <>
struct EnumNames<Law> {
  static constexpr std::array kNames{"uniform", "log_uniform", "normal", "choice"};
};

// Time at which a number is drawn.
enum class DrawnAt : std::uint8_t { start, reset, interval };
template <>
struct EnumNames<DrawnAt> {
  static constexpr std::array kNames{"start", "reset", "interval"};
};

// How a parameter of the drones is drawn. All draws are keyed by the env's seed, the drone and the episode, so they do not depend
// on threads or on other drones.
struct Variation {
  std::string parameter;
  float low = 1.0F;
  float high = 1.0F;
  Law law = Law::uniform;
  float mean = 1.0F;
  float std = 0.1F;
  std::vector<float> choices;
  DrawnAt when = DrawnAt::reset;
  float interval_s = 1.0F;
  std::string group;

  static constexpr auto fields() {
    using C = Variation;
    return field_list(
        field("parameter", &C::parameter,
              {.about = "Name of a field of `DroneParameters`, such as ``\"mass_scale\"``. Each element of an array is drawn by "
                        "itself. ``\"stretch[2]\"`` is one element."}),
        field("low", &C::low, {.about = "Least value.", .limits = within(1e6)}),
        field("high", &C::high, {.about = "Greatest value, equal to ``low`` for a constant.", .limits = within(1e6)}),
        field("law", &C::law,
              {.about = "``\"uniform\"``, ``\"log_uniform\"`` (uniform in the logarithm), ``\"normal\"`` (clipped to [low, "
                        "high]), ``\"choice\"`` (one of ``choices``)."}),
        field("mean", &C::mean, {.about = "For ``\"normal\"``: mean before clipping.", .limits = within(1e6)}),
        field("std", &C::std, {.about = "For ``\"normal\"``: standard deviation before clipping.", .limits = between(0, 1e6)}),
        field("choices", &C::choices, {.about = "For ``\"choice\"``: the values, equally likely.", .limits = within(1e6)}),
        field("when", &C::when,
              {.about = "``\"start\"``: once, by the seed. ``\"reset\"``: for each episode. ``\"interval\"``: every "
                        "``interval_s`` of an episode, too."}),
        field("interval_s", &C::interval_s,
              {.about = "For ``\"interval\"``: time between draws, rounded to control steps.",
               .unit = "s",
               .limits = between(0.001, 1e6)}),
        field("group", &C::group,
              {.about = "Parameters of the same group have the same quantile of their laws, so that they grow together. Empty: "
                        "drawn alone."}));
  }

  FLOCKSTEP_API void validate() const;
};

// Number of floats in DroneParameters, P.
inline constexpr std::size_t kNumParameters = sizeof(DroneParameters) / sizeof(float);
// Names of the floats of DroneParameters in order: "mass_scale", "stretch[0]" and so on.
FLOCKSTEP_API const std::vector<std::string>& parameter_names();

}  // namespace flockstep
