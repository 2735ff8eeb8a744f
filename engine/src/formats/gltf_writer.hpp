// Writes glTF 2.0 files: everything that viewers show, and the rest in `extras`, so that gltf.hpp reads an equal world.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "base/text_file.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// JSON with all data embedded as base64 (.gltf), or with a binary chunk (.glb).
enum class GltfForm : std::uint8_t { text, binary };

// Expects a canonical() description. A primitive becomes a node that places and scales its tessellation, an object a node with
// a mesh, and a marker a named node. Worlds too large for parse_gltf() are rejected: throws std::invalid_argument that names
// the source, the expected value and the actual one.
std::string write_gltf(const SceneDescription& description, GltfForm form, const std::string& source,
                       std::size_t max_bytes = static_cast<std::size_t>(kMaxFileBytes));

}  // namespace flockstep
