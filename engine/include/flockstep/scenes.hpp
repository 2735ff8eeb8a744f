// Scenes: names of the worlds that ship with flockstep, and of the worlds that it generates.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// A name for several scenes, such as "train".
struct SceneSet {
  std::string_view name;                     // name of the set
  std::span<const std::string_view> scenes;  // names of its scenes
};
// Returns all sets of scenes.
FLOCKSTEP_API std::span<const SceneSet> scene_sets();

// A scene that is generated instead of loaded, such as "indoor/office".
struct GeneratedScene {
  std::string_view name;                   // name of the scene
  std::shared_ptr<const World> (*make)();  // makes it, the same each time
};
// Returns all scenes that are generated.
FLOCKSTEP_API std::span<const GeneratedScene> generated_scenes();

// A generator that makes a scene from a seed: "forest/seed-7".
struct SceneGenerator {
  std::string_view name;                                     // name of the generator
  std::shared_ptr<const World> (*make)(std::uint64_t seed);  // makes the scene of a seed
  int cost;                                                  // time and memory that a scene takes, in playgrounds
};
// Returns all generators.
FLOCKSTEP_API std::span<const SceneGenerator> scene_generators();

// Returns the sorted names of all generated scenes, and of all scenes stored in a folder as "group/name.json".
FLOCKSTEP_API std::vector<std::string> scene_names(const std::filesystem::path& folder);

// Returns the scenes of a name: the members of a set, the seeds of a range ("forest/seed-0..99", at most 100,000), or the name
// itself. Throws std::invalid_argument if a range is empty or too large.
FLOCKSTEP_API std::vector<std::string> expand_scene_name(std::string_view name);

// Returns what the worlds of these names cost, in playgrounds: see SceneGenerator. A world that is there already costs 1, and so
// does one without a generator. Stops beyond `most`.
FLOCKSTEP_API std::size_t cost_of_scenes(const std::vector<std::string>& names, std::size_t most);

// Returns true for a path that ends in one of World::suffixes(), in lower or upper case.
FLOCKSTEP_API bool is_scene_path(std::string_view name);

// Loads the world of a name or path. Throws std::invalid_argument if the name is unknown; the message suggests similar ones.
FLOCKSTEP_API std::shared_ptr<const World> load_scene(const std::string& name, const std::filesystem::path& folder);

}  // namespace flockstep
