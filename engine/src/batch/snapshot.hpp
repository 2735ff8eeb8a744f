// Snapshots: the complete state that the next step depends on. A snapshot is a header (magic number, format version, hash of
// the configuration, length of the body, checksum) and a body: the hash of each part of the configuration, to name the one that
// differs, and every array in the order of the ArrayVisitor.
#pragma once

#include <string>
#include <string_view>

#include "batch/simulation.hpp"

namespace flockstep {

std::string make_snapshot(Simulation& sim);

// Throws std::invalid_argument and changes nothing if the blob is damaged or belongs to a simulation with another
// configuration.
void restore_snapshot(Simulation& sim, std::string_view blob);

}  // namespace flockstep
