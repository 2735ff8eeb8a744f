// WindConfig: the wind that drones fly in by their rotors.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

enum class Gusts : std::uint8_t {
  none,
  ornstein_uhlenbeck,  // each axis on its own, forgetting with gust_time_s
  dryden,              // MIL-F-8785C's turbulence near the ground
};
template <>
struct EnumNames<Gusts> {
  static constexpr std::array kNames{"none", "ornstein_uhlenbeck", "dryden"};
};

// The wind is the same all over a world and constant for a flown step; each drone has its own gusts.
struct WindConfig {
  std::array<float, 3> mean_mps{0.0F, 0.0F, 0.0F};  // world frame
  Gusts gusts = Gusts::none;
  float gust_std_mps = 1.0F;    // Ornstein-Uhlenbeck: of each axis, >= 0
  float gust_time_s = 2.0F;     // likewise: the time in which a gust falls to 1/e of itself
  float wind_at_6m_mps = 5.0F;  // Dryden: the wind at 6.1 m above the ground, which gives the strength, >= 0
  float height_m = 5.0F;        // Dryden: above the ground, in [3, 300]: it gives scale and strength

  static constexpr auto fields() {
    using C = WindConfig;
    return field_list(field("mean_mps", &C::mean_mps), field("gusts", &C::gusts), field("gust_std_mps", &C::gust_std_mps),
                      field("gust_time_s", &C::gust_time_s), field("wind_at_6m_mps", &C::wind_at_6m_mps),
                      field("height_m", &C::height_m));
  }

  void validate() const;
};

}  // namespace flockstep
