// Sensor rates: a sensor reads at its own rate, or after every flown step.
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include "base/require.hpp"
#include "flockstep/episode.hpp"

namespace flockstep::sensors {

// Returns the ticks between two readings; 0 if no rate is given. Throws std::invalid_argument if the clock cannot keep the
// rate.
inline std::int64_t period_in_ticks(const std::optional<float>& rate_hz, const ClockConfig& clock, const std::string& field) {
  if (!rate_hz) return 0;
  require_positive(*rate_hz, field);
  const double ticks = clock.ticks_hz() / static_cast<double>(*rate_hz);
  const double whole = std::round(ticks);
  require(whole >= 1.0 && whole < 1e9 && std::abs(ticks - whole) <= 1e-4 * whole, field,
          "a rate that divides the clock's " + std::to_string(clock.ticks_hz()) + " ticks per second", *rate_hz);
  return static_cast<std::int64_t>(whole);
}

// Returns whether a sensor with this period reads at this tick of an episode.
inline bool is_due(std::int64_t period, std::int64_t tick, bool step_is_over) {
  return period == 0 ? step_is_over : tick % period == 0;
}

}  // namespace flockstep::sensors
