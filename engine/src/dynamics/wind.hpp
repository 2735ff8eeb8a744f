// Wind: a mean wind, and gusts for each drone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "flockstep/wind.hpp"

namespace flockstep::dynamics {

// The filter states of a drone's gusts: one along the wind, two across and two upwards. Ornstein-Uhlenbeck uses the first,
// second and fourth, one for each axis of the world.
inline constexpr std::size_t kGustStates = 5;
using GustState = std::array<float, kGustStates>;
using GustNoise = std::array<float, kGustStates>;  // independent standard normal numbers

// Gusts as filtered white noise; the linear filters are solved exactly over a flown step. Dryden's filters and scale lengths
// are those of MIL-F-8785C, 3.7.2, at low altitude. The mean wind, or 1 m/s if it is slower, carries the frozen turbulence past
// the drone.
class Wind {
 public:
  Wind() = default;
  Wind(const WindConfig& config, double step_s);

  bool has_gusts() const { return gusts_ != Gusts::none; }
  GustState begin(const GustNoise& noise) const;                        // draw from the stationary distribution
  GustState next(const GustState& gust, const GustNoise& noise) const;  // gusts one step later
  Vec3 at(const GustState& gust) const;                                 // m/s, world frame

 private:
  // Coefficients of a first-order lag, or of two equal lags in series with Dryden's zero.
  struct Filter {
    float keep = 0.0F;                                          // share of the state kept after a step
    float pass = 0.0F;                                          // from the first stage to the second
    float noise = 0.0F;                                         // to the first stage
    float shared = 0.0F, own = 0.0F;                            // to the second stage: from the first's noise, and separate
    float start = 0.0F, start_shared = 0.0F, start_own = 0.0F;  // the same for the stationary distribution
  };
  static Filter first_order(double std, double time_s, double step_s);
  static Filter second_order(double std, double time_s, double step_s);

  Gusts gusts_ = Gusts::none;
  Vec3 mean_ = Vec3::Zero();
  Vec3 along_ = Vec3::UnitX(), across_ = Vec3::UnitY();  // unit, horizontal
  Filter u_, v_, w_;
};

}  // namespace flockstep::dynamics
