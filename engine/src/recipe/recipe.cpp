#include "flockstep/recipe.hpp"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

#include "base/excerpt.hpp"
#include "base/json_document.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "flockstep/scenes.hpp"
#include "recipe/config_json.hpp"

namespace flockstep {
namespace {

using Json = nlohmann::json;
using OrderedJson = nlohmann::ordered_json;

constexpr int kRecipeVersion = 1;
constexpr const char* kRecipeKey = "flockstep_recipe";

std::vector<std::string_view> names_of_members() {
  std::vector<std::string_view> names{kRecipeKey, "task", "worlds", "drone"};
  kFields<BatchConfig>.apply([&](const auto&... fields) { (names.emplace_back(fields.name), ...); });
  return names;
}

// Returns an object without the members of these names.
Json without(const Json& object, std::initializer_list<const char*> names) {
  Json rest = object;
  for (const char* const name : names) rest.erase(name);
  return rest;
}

std::vector<std::string> read_worlds(const Json& json) {
  constexpr const char* kExpected = "an array of names";
  if (!json.is_array()) refuse("worlds", kExpected, json::excerpt_of(json));
  std::vector<std::string> worlds;
  for (const Json& world : json) {
    if (!world.is_string()) refuse("worlds", kExpected, json::excerpt_of(json));
    worlds.push_back(world.get<std::string>());
  }
  return worlds;
}

// Returns true for text that is not the name of a scene or a drone, but may be a path without a known extension.
bool is_path(const std::string& text) { return std::filesystem::path(text).is_absolute() || text.starts_with('.'); }

// Throws if a path is not allowed. Paths in the folder of the bundled scenes are always allowed.
void check_path(const char* field, const std::string& path, const RecipeAccess& access) {
  if (access.allows_files) return;
  std::error_code failed;  // name too long, or a loop of links
  const std::filesystem::path folder = std::filesystem::weakly_canonical(access.scenes, failed);
  bool is_inside = !access.scenes.empty() && !failed;
  if (is_inside) {
    const std::filesystem::path file = std::filesystem::weakly_canonical(path, failed);
    is_inside = !failed && std::ranges::mismatch(folder, file).in1 == folder.end();
  }
  if (is_inside) return;
  throw std::invalid_argument(std::string(field) + ": this recipe may only use bundled scenes and drones, not " +
                              quoted_excerpt(path) + "; pass allow_files=True (--allow-files) to allow files");
}

Batch::Worlds load_worlds(const Recipe& recipe, const std::filesystem::path& folder) {
  Batch::Worlds worlds;
  std::map<std::string, std::shared_ptr<const World>> loaded;
  for (const std::string& name : recipe.worlds) {
    for (const std::string& scene : expand_scene_name(name)) {
      std::shared_ptr<const World>& world = loaded[scene];
      if (!world) world = load_scene(scene, folder);
      worlds.push_back(world);
    }
  }
  return worlds;
}

}  // namespace

DroneModel load_drone(const DroneChoice& drone) {
  if (const auto* const model = std::get_if<DroneModel>(&drone)) return *model;
  const auto& name = std::get<std::string>(drone);
  return name.empty() ? DroneModel::quadrotor650() : DroneModel::load(name);
}

std::unique_ptr<Task> make_task(const TaskConfig& task) {
  return std::visit(
      []<class Config>(const Config& config) -> std::unique_ptr<Task> {
        if constexpr (kIsEngineTask<Config>) {
          return make_task(config);
        } else if constexpr (std::is_same_v<Config, RegisteredTask>) {
          refuse("task.name", "one of " + names_of_tasks(),
                 quoted_excerpt(config.id) + ": only the program that registered a task under this id can make it");
        } else {
          return nullptr;
        }
      },
      task);
}

Recipe Recipe::for_task(TaskConfig task) {
  Recipe recipe;
  recipe.task = std::move(task);
  const bool has_defaults = !std::holds_alternative<RegisteredTask>(recipe.task);
  const std::unique_ptr<Task> made = has_defaults ? make_task(recipe.task) : nullptr;
  if (!made) return recipe;
  recipe.take(made->defaults());
  return recipe;
}

void Recipe::take(const TaskDefaults& defaults) {
  worlds = {defaults.worlds};
  drone = defaults.drone;
  batch = defaults.batch;
}

std::string Recipe::to_json() const {
  OrderedJson json;
  json[kRecipeKey] = kRecipeVersion;
  json["task"] = json_of(task);
  json["worlds"] = worlds;
  const auto* const model = std::get_if<DroneModel>(&drone);
  json["drone"] = model != nullptr ? OrderedJson::parse(model->to_json()) : OrderedJson(std::get<std::string>(drone));
  json.update(json_of(batch));
  return json.dump(1) + '\n';
}

Recipe Recipe::from_json(const std::string& text) {
  const auto document = json::Document::parse(text, "recipe");
  const Json& json = document->root().value;
  if (!json.is_object()) refuse("recipe", "an object", json::excerpt_of(json));
  json::check_version(document->root(), kRecipeKey, kRecipeVersion);
  const std::vector<std::string_view> known = names_of_members();
  for (const auto& [name, value] : json.items()) {
    if (std::ranges::find(known, name) != known.end()) continue;
    std::string expected;
    for (const std::string_view one : known) expected += (expected.empty() ? "one of " : ", ") + std::string(one);
    refuse("recipe", expected, quoted_excerpt(name) + did_you_mean(name, known));
  }
  Recipe recipe = for_task(json.contains("task") ? read_task(json["task"]) : TaskConfig());
  if (json.contains("worlds")) recipe.worlds = read_worlds(json["worlds"]);
  if (json.contains("drone")) {
    const Json& drone = json["drone"];
    if (!drone.is_string() && !drone.is_object()) refuse("drone", "a name or an object", json::excerpt_of(drone));
    if (drone.is_string()) {
      recipe.drone = drone.get<std::string>();
    } else {
      recipe.drone = DroneModel::from_json(drone.dump());
    }
  }
  read_config(without(json, {kRecipeKey, "task", "worlds", "drone"}), "", recipe.batch);
  return recipe;
}

void check_access(const Recipe& recipe, const RecipeAccess& access) {
  require(cost_of_scenes(recipe.worlds, access.max_worlds) <= access.max_worlds, "worlds",
          "at most " + std::to_string(access.max_worlds) +
              " worlds (max_worlds), each forest counted as 30, each office, warehouse and city as 100, or 200 if it lives",
          "more");
  for (const std::string& world : recipe.worlds) {
    if (is_scene_path(world) || is_path(world)) check_path("worlds", world, access);
  }
  const auto check_drone = [&](const char* field, const std::string& drone) {
    if (drone.ends_with(".json") || is_path(drone)) check_path(field, drone, access);
  };
  if (const auto* const drone = std::get_if<std::string>(&recipe.drone)) check_drone("drone", *drone);
  for (const std::string& frame : recipe.batch.airframes) check_drone("airframes", frame);
}

std::unique_ptr<Batch> make_batch(const Recipe& recipe, const RecipeAccess& access) {
  std::unique_ptr<Task> task = make_task(recipe.task);
  require(!recipe.worlds.empty(), "worlds", "at least one name", "none");
  check_access(recipe, access);
  DroneModel drone = load_drone(recipe.drone);
  return std::make_unique<Batch>(recipe.batch, load_worlds(recipe, access.scenes), std::move(task), std::move(drone));
}

}  // namespace flockstep
