// The hash by which one tells whether two worlds have the same content.
#pragma once

#include <cstdint>

#include "flockstep/world.hpp"

namespace flockstep {

// Of every byte of every field but the scene's name: a scene that was loaded from elsewhere, or is called otherwise, is the same
// world to all that is simulated and drawn. The names of its materials count, since programs look materials up by them. Expects
// the canonical form, in which descriptions that mean the same are the same.
std::uint64_t content_hash(const SceneDescription& description);

}  // namespace flockstep
