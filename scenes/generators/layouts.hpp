// Generators try layout after layout until a drone can fly through one.
#pragma once

#include <cstdint>
#include <memory>

#include "base/interrupt.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// The first world that make(attempt) returns for attempt 0, 1, ...; null if each of so many attempts returns null.
template <class Make>
std::shared_ptr<const World> first_layout(std::uint32_t attempts, const Make& make) {
  for (std::uint32_t attempt = 0; attempt < attempts; ++attempt) {
    Interrupt::poll();
    if (std::shared_ptr<const World> world = make(attempt)) return world;
  }
  return nullptr;
}

}  // namespace flockstep
