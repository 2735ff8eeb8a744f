// The drones that a call is about.
#pragma once

#include <cstddef>
#include <cstdint>

#include "batch/simulation.hpp"

namespace flockstep {

inline bool chosen(const Simulation& sim, Batch::Mask mask, std::size_t drone) {
  return sim.state.active[drone] && (mask.empty() || mask[drone]);
}

// f(drone), on the calling thread.
template <class F>
void for_each_chosen(const Simulation& sim, Batch::Mask mask, const F& f) {
  for (std::size_t drone = 0; drone < sim.num_drones(); ++drone) {
    if (chosen(sim, mask, drone)) f(static_cast<std::uint32_t>(drone));
  }
}

}  // namespace flockstep
