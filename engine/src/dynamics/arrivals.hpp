// Arrivals: the commands of a group of drones that take effect within a leg, when some are late.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "dynamics/flight.hpp"

namespace flockstep::dynamics {

class Arrivals {
 public:
  void clear() { used_ = 0; }

  // Adds the setpoint of a lane that takes effect at this tick of the step. count: its earlier setpoints of the leg; the first
  // one becomes the flock's.
  void add(const Setpoint& setpoint, float tick, std::size_t lane, std::size_t count, Flock& flock) {
    if (count == 0) {
      for (std::size_t k = 0; k < setpoint.size(); ++k) flock.setpoint[k][lane] = setpoint[k];
      return;
    }
    if (count > rows_.size()) rows_.emplace_back();
    if (count > used_) rows_[used_++].tick.fill(std::numeric_limits<float>::infinity());
    Arrival& row = rows_[count - 1];
    row.tick[lane] = tick;
    for (std::size_t k = 0; k < setpoint.size(); ++k) row.setpoint[k][lane] = setpoint[k];
  }

  // All of them, valid until the next clear().
  std::span<Arrival> rows() { return std::span(rows_).first(used_); }

 private:
  std::vector<Arrival> rows_;
  std::size_t used_ = 0;
};

}  // namespace flockstep::dynamics
