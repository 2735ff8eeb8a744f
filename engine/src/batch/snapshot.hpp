// Snapshots: the complete state that the next step depends on. A snapshot is a header (magic number, format version, hash of
// the configuration, length of the body, checksum) and a body with every array in the order of the ArrayVisitor.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "batch/simulation.hpp"

namespace flockstep {

// Returns the hash of everything besides the state that a step depends on: configuration, task, worlds, drone. It is computed
// when first needed, since worlds can be large.
std::uint64_t config_hash(Simulation& sim);

std::string make_snapshot(Simulation& sim);

// Throws std::invalid_argument and changes nothing if the blob is damaged or belongs to a simulation with another
// configuration.
void restore_snapshot(Simulation& sim, std::string_view blob);

}  // namespace flockstep
