// Scenes: the names of the worlds that ship with flockstep, and of those that it generates.
#pragma once

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

// A name that stands for several scenes, such as "train".
struct SceneSet {
  std::string_view name;
  std::span<const std::string_view> scenes;
};
FLOCKSTEP_API std::span<const SceneSet> scene_sets();

// A scene that is generated instead of loaded, such as "indoor/office".
struct GeneratedScene {
  std::string_view name;
  std::shared_ptr<const World> (*make)();
};
FLOCKSTEP_API std::span<const GeneratedScene> generated_scenes();

// Generators make a scene from a seed: "forest/seed-7".
struct SceneGenerator {
  std::string_view name;
  std::shared_ptr<const World> (*make)(std::uint64_t seed);
};
FLOCKSTEP_API std::span<const SceneGenerator> scene_generators();

// The names of all scenes that are generated, or lie in a folder as "group/name.json"; sorted.
FLOCKSTEP_API std::vector<std::string> scene_names(const std::filesystem::path& folder);

// The names of the scenes that a name stands for: the members of a set, the seeds of a range ("forest/seed-0..99", at most
// 100,000), or the name itself. Throws std::invalid_argument at an empty or too large range.
FLOCKSTEP_API std::vector<std::string> expand_scene_name(std::string_view name);

// True for a path with one of World::suffixes(), in small letters or capitals.
FLOCKSTEP_API bool is_scene_path(std::string_view name);

// The world of a name or path. Throws std::invalid_argument at an unknown name; the message lists the names that exist.
FLOCKSTEP_API std::shared_ptr<const World> load_scene(const std::string& name, const std::filesystem::path& folder);

}  // namespace flockstep
