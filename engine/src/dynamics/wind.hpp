// Wind: a mean, and gusts that pass each drone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "flockstep/wind.hpp"

namespace flockstep::dynamics {

// What the gusts of a drone are made of, each with a variance of its own: along the wind, and two stages each across and upwards;
// Ornstein-Uhlenbeck has one along each axis of the world, in the first, second and fourth.
inline constexpr std::size_t kGustStates = 5;
using GustState = std::array<float, kGustStates>;
using GustNoise = std::array<float, kGustStates>;  // independent standard normal numbers

// The linear filters that white noise goes through, solved exactly over a flown step. Dryden's are those of MIL-F-8785C, 3.7.2,
// at low altitude, with the scale lengths of the same; the frozen turbulence is carried past the drone by the mean wind, at 1 m/s
// where there is less.
class Wind {
 public:
  Wind() = default;
  Wind(const WindConfig& config, double step_s);

  bool has_gusts() const { return gusts_ != Gusts::none; }
  GustState begin(const GustNoise& noise) const;                        // gusts as they are at any time
  GustState next(const GustState& gust, const GustNoise& noise) const;  // a step later
  Vec3 at(const GustState& gust) const;                                 // m/s, world frame

 private:
  // Of a first-order lag, or of two of the same one after the other with Dryden's zero.
  struct Filter {
    float keep = 0.0F;                                          // of what was, after a step
    float pass = 0.0F;                                          // from the first stage to the second
    float noise = 0.0F;                                         // to the first stage
    float shared = 0.0F, own = 0.0F;                            // to the second: of the first's noise, and of its own
    float start = 0.0F, start_shared = 0.0F, start_own = 0.0F;  // likewise, of a state that nothing is known of
  };
  static Filter first_order(double std, double time_s, double step_s);
  static Filter second_order(double std, double time_s, double step_s);

  Gusts gusts_ = Gusts::none;
  Vec3 mean_ = Vec3::Zero();
  Vec3 along_ = Vec3::UnitX(), across_ = Vec3::UnitY();  // unit, horizontal
  Filter u_, v_, w_;
};

}  // namespace flockstep::dynamics
