// WindConfig: the wind in rotor motion.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Model of the gusts.
enum class Gusts : std::uint8_t { none, ornstein_uhlenbeck, dryden };
template <>
struct EnumNames<Gusts> {
  static constexpr std::array kNames{"none", "ornstein_uhlenbeck", "dryden"};
};

// The mean wind is the same everywhere in a world. Wind is constant during a control step, and each drone has its own gusts.
struct WindConfig {
  std::array<float, 3> mean_mps{0.0F, 0.0F, 0.0F};
  Gusts gusts = Gusts::none;
  float gust_std_mps = 1.0F;
  float gust_time_s = 2.0F;
  float wind_at_6m_mps = 5.0F;
  float height_m = 5.0F;

  static constexpr auto fields() {
    using C = WindConfig;
    return field_list(
        field("mean_mps", &C::mean_mps,
              {.about = "Mean wind (x, y, z) in the world frame.", .unit = "m/s", .limits = within(1000)}),
        field("gusts", &C::gusts,
              {.about = "``\"ornstein_uhlenbeck\"``: correlated noise along each axis. ``\"dryden\"``: turbulence of MIL-F-8785C "
                        "at low altitude, carried past by the mean wind, at 1 m/s or faster."}),
        field("gust_std_mps", &C::gust_std_mps,
              {.about = "Standard deviation along each axis, for ``\"ornstein_uhlenbeck\"``.",
               .unit = "m/s",
               .limits = between(0, 1000)}),
        field("gust_time_s", &C::gust_time_s,
              {.about = "Time in which a gust falls to 1/e, for ``\"ornstein_uhlenbeck\"``.", .unit = "s", .limits = above(0)}),
        field("wind_at_6m_mps", &C::wind_at_6m_mps,
              {.about = "For ``\"dryden\"``: wind at 6.1 m (20 ft) above the ground. A tenth of it is the standard deviation of "
                        "vertical gusts.",
               .unit = "m/s",
               .limits = between(0, 1000)}),
        field("height_m", &C::height_m,
              {.about = "For ``\"dryden\"``: height above the ground. It sets the scale lengths, and the strength along and "
                        "across the wind.",
               .unit = "m",
               .limits = between(3, 300)}));
  }

  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
