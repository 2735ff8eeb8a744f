// Scene files: the JSON that scenes/schema.json describes, read into and written from a SceneDescription.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// source names the text in error messages; base_dir is the scene's folder. What its mesh files have and is not read is added to
// `ignored`, in words.
// Throws std::invalid_argument: source, JSON pointer of the offending field, what was expected, what came.
SceneDescription parse_scene(const std::string& text, const std::string& source, const std::filesystem::path& base_dir,
                             MeshFiles files = MeshFiles::in_folder, std::vector<std::string>* ignored = nullptr);

// Takes a description as canonical() leaves it. Numbers are written so that reading them again gives the same float32 bits, a
// mesh for each object (an empty one for a number that no triangle has), and of the light only what is not the default.
std::string write_scene(const SceneDescription& description);

// Parts of a scene file, in its words, for other formats that hold them. Of the light, what is not the default is written.
Markers read_markers(const json::JsonField& field);
Light read_light(const json::JsonField& field);
nlohmann::ordered_json write_markers(const Markers& markers);
nlohmann::ordered_json write_light(const Light& light);

}  // namespace flockstep
