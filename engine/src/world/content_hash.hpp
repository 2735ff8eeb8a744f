// Hash that identifies worlds with the same content.
#pragma once

#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep {

// Hashes every byte of every field except the scene's name, which affects neither simulation nor rendering. Material names
// count, because programs look materials up by name. Expects the canonical form, in which equivalent descriptions are equal.
std::uint64_t content_hash(const SceneDescription& description);

}  // namespace flockstep
