// Recipe: everything that a batch is built from, as one value that converts to JSON and back.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "flockstep/batch.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {

// The drone of a recipe: the name of a bundled airframe, the path of a JSON file, or a model. An empty string means "t650".
using DroneChoice = std::variant<std::string, DroneModel>;

struct Recipe {
  TaskConfig task;                  // std::monostate: none
  std::vector<std::string> worlds;  // names of sets or scenes, or paths of scene files; see flockstep/scenes.hpp
  DroneChoice drone;                // body and flight model
  BatchConfig batch;                // sensors, clock, episodes and dynamics

  // Returns the recipe with the defaults of a task: its worlds, drone, sensors, dynamics and rates.
  FLOCKSTEP_API static Recipe for_task(TaskConfig task);
  // Takes the defaults of a task that no configuration describes, in place of the worlds, the drone and the batch.
  FLOCKSTEP_API void take(const TaskDefaults& defaults);

  // The JSON text is an object with the members "flockstep_recipe" (the version of the format, 1), "task" (null, or an object
  // with the task's "name" and the fields of its configuration), "worlds", "drone" (a string, or an object in the format of
  // DroneModel::from_json()) and the fields of BatchConfig. Missing members have the defaults of the task. from_json() opens no
  // file. It throws std::invalid_argument naming the place, the expected value and the actual one, and suggests the nearest name
  // for a misspelt one.
  FLOCKSTEP_API std::string to_json() const;
  FLOCKSTEP_API static Recipe from_json(const std::string& text);  // see to_json()
};

// Files that a recipe may open, and worlds that it may build. The default is safe for a recipe from a file or the network: only
// bundled scenes, bundled drones and a limited number of generated scenes.
struct RecipeAccess {
  std::filesystem::path scenes;     // folder of the bundled scenes, whose files may be opened
  bool allows_files = false;        // scene and drone files may be anywhere
  std::size_t max_worlds = 10'000;  // what all worlds may cost, in playgrounds: see cost_of_scenes()
};

// Throws std::invalid_argument if a path in the recipe, or the number of its worlds, is not allowed.
FLOCKSTEP_API void check_access(const Recipe& recipe, const RecipeAccess& access);

// Builds the batch of a recipe. Throws std::invalid_argument if the recipe is invalid, its task is a RegisteredTask, or
// check_access() refuses it.
FLOCKSTEP_API std::unique_ptr<Batch> make_batch(const Recipe& recipe, const RecipeAccess& access);

// Loads the drone of a recipe. Throws std::invalid_argument if there is none of this name.
FLOCKSTEP_API DroneModel load_drone(const DroneChoice& drone);

// Makes the task of a recipe; null without one. Throws std::invalid_argument if it is a RegisteredTask.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const TaskConfig& task);

}  // namespace flockstep
