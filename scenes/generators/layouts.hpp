// Retry loop of the generators: draw layouts until a drone can fly through one.
#pragma once

#include <cstdint>
#include <memory>

#include "base/interrupt.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

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
