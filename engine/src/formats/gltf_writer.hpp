// glTF 2.0 files written: what any viewer shows, and in `extras` the rest, so that gltf.hpp reads an equal world.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "base/text_file.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// JSON with everything embedded as base64 (.gltf), or in a chunk of bytes behind it (.glb).
enum class GltfForm : std::uint8_t { text, binary };

// Takes a description as canonical() leaves it. A primitive is a node that places and scales its tessellation, a mesh of the
// world one that has its triangles; markers are nodes by their names. What parse_gltf() would refuse for its size is refused:
// throws std::invalid_argument naming the source, what was expected and what came.
std::string write_gltf(const SceneDescription& description, GltfForm form, const std::string& source,
                       std::size_t max_bytes = static_cast<std::size_t>(kMaxFileBytes));

}  // namespace flockstep
