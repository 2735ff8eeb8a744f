// Packs descriptions of worlds for other processes of the same version, such as pickles. Meshes and textures keep their binary
// form, because JSON takes seconds for a mesh of a million triangles.
#pragma once

#include <string>
#include <string_view>

#include "flockstep/world.hpp"

namespace flockstep {

// Expects a canonical() description.
std::string pack_world(const SceneDescription& description);

// Throws std::invalid_argument if the bytes are damaged or of another version. canonical() must check the result.
SceneDescription unpack_world(std::string_view bytes);

}  // namespace flockstep
