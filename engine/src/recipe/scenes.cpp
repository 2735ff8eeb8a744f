#include "flockstep/scenes.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <set>
#include <stdexcept>

#include "base/excerpt.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "base/text_file.hpp"
#include "flockstep/generators.hpp"
#include "recipe/unknown_scene.hpp"

namespace flockstep {
namespace {

constexpr std::array<std::string_view, 5> kTrain{"playground/train-1", "playground/train-2", "playground/train-3",
                                                 "playground/train-4", "playground/train-5"};
constexpr std::array<std::string_view, 2> kValidation{"playground/validation-1", "playground/validation-2"};
constexpr std::array<std::string_view, 2> kCameraTrain{"playground/camera-train-1", "playground/camera-train-2"};
constexpr std::array<std::string_view, 2> kCameraValidation{"playground/camera-validation-1", "playground/camera-validation-2"};
constexpr std::array<std::string_view, 5> kLiving{"living_playground/seed-1", "living_playground/seed-2",
                                                  "living_playground/seed-3", "living_warehouse/seed-1", "living_office/seed-1"};
constexpr std::array<SceneSet, 5> kSets{SceneSet{"train", kTrain}, SceneSet{"validation", kValidation},
                                        SceneSet{"camera-train", kCameraTrain}, SceneSet{"camera-validation", kCameraValidation},
                                        SceneSet{"living", kLiving}};

constexpr std::array<GeneratedScene, 6> kGenerated{
    GeneratedScene{"bench/complex", bench_complex},
    GeneratedScene{"bench/simple", bench_simple},
    GeneratedScene{"indoor/office", [] { return office({.seed = 1}); }},
    GeneratedScene{"indoor/warehouse", [] { return warehouse({.seed = 1}); }},
    GeneratedScene{"outdoor/city", [] { return city({.seed = 6}); }},
    GeneratedScene{"outdoor/forest", [] { return forest({.seed = 1}); }},
};

constexpr std::array<SceneGenerator, 12> kGenerators{
    SceneGenerator{"playground", [](std::uint64_t seed) { return playground({.seed = seed}); }, 1},
    SceneGenerator{"forest", [](std::uint64_t seed) { return forest({.seed = seed}); }, 30},
    SceneGenerator{"city", [](std::uint64_t seed) { return city({.seed = seed}); }, 100},
    SceneGenerator{"office", [](std::uint64_t seed) { return office({.seed = seed}); }, 100},
    SceneGenerator{"warehouse", [](std::uint64_t seed) { return warehouse({.seed = seed}); }, 100},
    SceneGenerator{"race_track", [](std::uint64_t seed) { return race_track({.seed = seed}); }, 1},
    SceneGenerator{"guided_office", [](std::uint64_t seed) { return office({.seed = seed, .waypoints = true}); }, 100},
    SceneGenerator{"guided_warehouse", [](std::uint64_t seed) { return warehouse({.seed = seed, .waypoints = true}); }, 100},
    SceneGenerator{"living_playground", [](std::uint64_t seed) { return playground({.seed = seed, .movers = 6}); }, 1},
    SceneGenerator{"living_city", [](std::uint64_t seed) { return city({.seed = seed, .traffic = 16}); }, 200},
    SceneGenerator{"living_office", [](std::uint64_t seed) { return office({.seed = seed, .waypoints = true, .walkers = 8}); },
                   200},
    SceneGenerator{"living_warehouse",
                   [](std::uint64_t seed) { return warehouse({.seed = seed, .waypoints = true, .forklifts = 6}); }, 200},
};

constexpr std::uint64_t kMaxSeeds = 100'000;  // seeds in a range

// Parses a number of 1 to 18 digits.
std::optional<std::uint64_t> number_of(std::string_view text) {
  std::uint64_t number = 0;
  const bool has_digits =
      !text.empty() && text.size() <= 18 && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
  if (!has_digits) return std::nullopt;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

// A generated scene or a range of them: "forest/seed-7" or "forest/seed-0..99".
struct Seeded {
  const SceneGenerator* generator;
  std::uint64_t first, last;
};

std::optional<Seeded> seeded(std::string_view name) {
  constexpr std::string_view kSeed = "/seed-", kRange = "..";
  const std::size_t slash = name.find(kSeed);
  if (slash == std::string_view::npos) return std::nullopt;
  const auto generator = std::ranges::find(kGenerators, name.substr(0, slash), &SceneGenerator::name);
  if (generator == kGenerators.end()) return std::nullopt;
  const std::string_view seeds = name.substr(slash + kSeed.size());
  const std::size_t dots = seeds.find(kRange);
  const auto first = number_of(seeds.substr(0, dots));
  const auto last = dots == std::string_view::npos ? first : number_of(seeds.substr(dots + kRange.size()));
  if (!first || !last) return std::nullopt;
  return Seeded{&*generator, *first, *last};
}

template <class Items>
std::vector<std::string_view> names_of(const Items& items) {
  std::vector<std::string_view> names;
  for (const auto& item : items) names.push_back(item.name);
  return names;
}

}  // namespace

std::span<const SceneSet> scene_sets() { return kSets; }
std::span<const GeneratedScene> generated_scenes() { return kGenerated; }
std::span<const SceneGenerator> scene_generators() { return kGenerators; }

std::vector<std::string> scene_names(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  for (const GeneratedScene& scene : kGenerated) names.emplace_back(scene.name);
  std::error_code ignored;  // a missing or unreadable folder has no scenes
  for (const auto& group : std::filesystem::directory_iterator(folder, ignored)) {
    if (!group.is_directory(ignored)) continue;
    for (const auto& file : std::filesystem::directory_iterator(group.path(), ignored)) {
      if (file.path().extension() != ".json") continue;
      names.push_back(group.path().filename().string() + '/' + file.path().stem().string());
    }
  }
  std::ranges::sort(names);
  return names;
}

std::vector<std::string> expand_scene_name(std::string_view name) {
  if (const auto set = std::ranges::find(kSets, name, &SceneSet::name); set != kSets.end()) {
    return {set->scenes.begin(), set->scenes.end()};
  }
  const auto range = seeded(name);
  if (!range) return {std::string(name)};
  require(range->first <= range->last && range->last - range->first < kMaxSeeds, "worlds",
          "a range of 1 to " + std::to_string(kMaxSeeds) + " seeds", '"' + std::string(name) + '"');
  std::vector<std::string> names;
  for (std::uint64_t seed = range->first; seed <= range->last; ++seed) {
    names.push_back(std::string(range->generator->name) + "/seed-" + std::to_string(seed));
  }
  return names;
}

std::size_t cost_of_scenes(const std::vector<std::string>& names, std::size_t most) {
  std::set<std::string> known;
  std::size_t cost = 0;
  for (const std::string& name : names) {
    for (const std::string& scene : expand_scene_name(name)) {
      const auto one = known.insert(scene).second ? seeded(scene) : std::nullopt;
      cost += one ? static_cast<std::size_t>(one->generator->cost) : 1;
      if (cost > most) return cost;
    }
  }
  return cost;
}

bool is_scene_path(std::string_view name) {
  const std::vector<std::string_view> suffixes = World::suffixes();
  return std::ranges::find(suffixes, extension_of(name)) != suffixes.end();
}

std::shared_ptr<const World> load_scene(const std::string& name, const std::filesystem::path& folder) {
  if (const auto scene = std::ranges::find(kGenerated, name, &GeneratedScene::name); scene != kGenerated.end())
    return scene->make();
  if (const auto one = seeded(name); one && one->first == one->last) return one->generator->make(one->first);
  if (is_scene_path(name)) return World::load(name);
  const std::vector<std::string> names = scene_names(folder);
  if (std::ranges::find(names, name) != names.end()) return World::load(folder / (name + ".json"));
  throw std::invalid_argument("worlds: " + unknown_scene(name, names));
}

std::string unknown_scene(std::string_view name, std::span<const std::string> known) {
  const std::string shown = '\'' + excerpt(name) + '\'', extension = extension_of(name);
  const bool is_file = extension.size() > 1 && extension.size() <= 6 &&
                       std::ranges::all_of(extension.substr(1), [](char c) { return c >= 'a' && c <= 'z'; });
  if (is_file && !is_scene_path(name)) return shown + ": " + extension + " files are not supported: export glTF (.glb)";
  std::vector<std::string_view> names(known.begin(), known.end());
  for (const SceneSet& set : kSets) names.push_back(set.name);
  const std::size_t slash = name.find('/');
  const bool has_scene = slash != std::string_view::npos && !name.substr(slash).starts_with("/seed");  // in a group of scenes
  const std::string_view first = has_scene ? std::string_view() : name.substr(0, slash);
  const std::vector<std::string_view> generators = nearest_names(first, names_of(kGenerators), 1);
  constexpr std::size_t kSuggested = 3;
  std::vector<std::string> suggested;
  for (const std::string_view near : nearest_names(name, names, kSuggested - generators.size())) {
    suggested.push_back('\'' + std::string(near) + '\'');
  }
  for (const std::string_view near : generators) suggested.push_back('\'' + std::string(near) + "/seed-0'");
  std::string text = "unknown scene " + shown;
  if (suggested.empty()) text += ": expected a path, or a name such as 'arena/hall' or 'forest/seed-7'";
  for (std::size_t i = 0; i < suggested.size(); ++i) {
    text += (i == 0 ? ". Did you mean " : i + 1 == suggested.size() ? " or " : ", ") + suggested[i];
  }
  return text + (suggested.empty() ? "; " : "? ") + "flockstep.scenes.names() lists all";
}

}  // namespace flockstep
