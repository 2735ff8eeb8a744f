// Reads and writes scene files: SceneDescriptions as the JSON that scenes/schema.json describes.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// `source` names the text in error messages; `base_dir` is the scene's folder. Descriptions of ignored content of mesh files
// are added to `ignored`.
// Throws std::invalid_argument with the source, the JSON pointer of the offending field, the expected value and the actual one.
SceneDescription parse_scene(const std::string& text, const std::string& source, const std::filesystem::path& base_dir,
                             MeshFiles files = MeshFiles::in_folder, std::vector<std::string>* ignored = nullptr);

// Expects a canonical() description. Numbers read back with the same float32 bits. Each object becomes a mesh, which is empty
// if no triangle has that object number. Only light values that differ from the defaults are written.
std::string write_scene(const SceneDescription& description);

// Read and write parts of a scene file, for other formats that embed them. Only light values that differ from the
// defaults are written.
Markers read_markers(const json::JsonField& field);
Light read_light(const json::JsonField& field);
nlohmann::ordered_json write_markers(const Markers& markers);
nlohmann::ordered_json write_light(const Light& light);

}  // namespace flockstep
