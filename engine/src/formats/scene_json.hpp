// Reads and writes scene files: SceneDescriptions as the JSON that scenes/schema.json describes.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/body.hpp"
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

// --- bodies in scene files and in the extras of glTF files

// Reads a list of objects with the fields of BodyConfig. Missing fields have their defaults. A mesh is the path of a file in the
// folder, or may come from everywhere, as `files` says; a .glb file as a data: URI; or the number of an earlier body with the
// same mesh. Throws std::invalid_argument that names the source and the place: "room.json: bodies[3].motion.period_s".
std::vector<BodyConfig> read_bodies(const json::JsonField& field, const std::filesystem::path& folder, MeshFiles files);

// Leaves out the fields that have their defaults.
nlohmann::ordered_json write_bodies(const std::vector<BodyConfig>& bodies);

}  // namespace flockstep
