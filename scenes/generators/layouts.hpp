// Helpers of generators that draw layouts: the retry loop until a drone can fly through one, and rounding.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>

#include "base/interrupt.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Rounds a coordinate to 1 cm.
inline double centimetres(double metres) { return std::floor(metres * 100.0 + 0.5) / 100.0; }

// Returns the first non-null world of make(0), make(1), ..., or null if all attempts fail.
template <class Make>
std::shared_ptr<const World> first_layout(std::uint32_t attempts, const Make& make) {
  for (std::uint32_t attempt = 0; attempt < attempts; ++attempt) {
    Interrupt::poll();
    if (std::shared_ptr<const World> world = make(attempt)) return world;
  }
  return nullptr;
}

}  // namespace flockstep
