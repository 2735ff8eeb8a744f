// Snapshots: all that the next step depends on. A header (magic, version of the format, hash of the configuration, length and
// hash of what follows), then every array as ArrayVisitor is shown it.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "batch/simulation.hpp"

namespace flockstep {

// Of everything that decides what a step does: configuration, task, worlds, drone. Worlds can be large: made when first needed.
std::uint64_t config_hash(Simulation& sim);

std::string make_snapshot(Simulation& sim);

// Throws std::invalid_argument, and changes nothing, unless these are the unchanged bytes of a snapshot of a simulation with this
// configuration.
void restore_snapshot(Simulation& sim, std::string_view blob);

}  // namespace flockstep
